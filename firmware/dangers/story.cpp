#include "story.hpp"

#include <Arduino.h>

#include <algorithm>

#include "esp32/kept_heat.hpp"
#include "fakes/tasks.hpp"

namespace tensionlab {
namespace dangers {

namespace {

using fakes::board;
using firmware::Calibration;
using firmware::Parameter;
using firmware::State;

constexpr double kStep = 0.005;  // s, of the host
constexpr double kLength = 1.0;  // m of cable at the start

Story* running = nullptr;

// What the converter makes of a volt around the middle of its range.
double converter_slope(const plant::SensingParameters& p) {
  const double share = (p.middle - p.dead) / (p.full - p.dead);
  return 3.3 / (p.full - p.dead) * (1.0 + 4.0 * p.bow / p.full * (1.0 - 2.0 * share));
}

}  // namespace

Story::Story(std::uint64_t seed, int shield) : hardware(plant::with_shield(shield)), random_(seed + 1) {
  plant::PlantParameters& p = hardware.plant;
  p.resistance = between(2.5, 3.0);  // GM3506, at 20 °C
  p.inductance = between(0.5e-3, 2e-3);
  p.torque_constant = between(0.050, 0.0585);
  p.inertia = between(1.0e-5, 1.5e-5);
  p.dry_friction = between(0.02, 0.08);
  p.viscous_friction = between(0.02, 0.08);
  p.cogging = between(0.0, 0.05);
  p.stiffness = between(2500.0, 6000.0);
  p.damping = between(2.0, 5.0);
  p.servo_time = between(0.04, 0.055);
  hardware.supply.source = between(11.5, 14.5);
  hardware.supply.resistance = between(0.05, 0.3);
  hardware.supply.capacitance = between(0.47e-3, 2e-3);
  hardware.sensing.dead = between(0.0, 0.14);
  hardware.sensing.full = between(3.1, 3.3);
  hardware.sensing.bow = between(0.0, 0.03);
  hardware.sensing.noise = between(1.0, 4.0);
  hardware.way = either();
  hardware.zero = between(0.0, 6.28);
  hardware.start = between(0.0, 6.28);
  hardware.bridge_resistance *= between(0.625, 1.5);
  hardware.dead_share = between(0.002, 0.01);
  hardware.encoder_latency = between(50e-6, 150e-6);
  hardware.encoder_noise = between(0.5, 1.5);
  by_bluetooth = below(2) == 1;
  board.clock_us = seed % 3 == 0 ? 0xFFFFFFFFu - 700000u : 0;  // in a third of the runs the clock wraps around
  hand = [](double) { return 0.0; };
}

plant::Hardware& Story::plant() { return *board.hardware; }

double Story::seconds() const { return 1e-6 * static_cast<double>(fakes::now_us() - begun_us_); }

void Story::boot(double seconds) {
  board.hardware.emplace(hardware, kLength, static_cast<std::uint64_t>(below(1 << 30)));
  board.turn_us = static_cast<std::uint32_t>(between(200.0, 290.0));
  board.tick_us = static_cast<std::uint32_t>(between(1000.0, 4000.0));
  board.radio_shift = between(-0.025, 0.025);
  plant().spool().cut = true;
  warm();
  running = this;
  board.on_turn = [] { running->note_turn(); };
  setup();
  loop();
  advance(seconds);
  if (by_bluetooth) {
    board.air.connected = true;
    advance(0.01);
  }
  host_ = Host(by_bluetooth ? board.air : board.usb, 77);
  host_.hello();
  if (set_up) set_parameters();
  advance(0.02);
  plant().spool().cut = false;
  plant().take_up_slack();
  taut_us_ = fakes::now_us();
}

void Story::set_parameters() {
  const double newton_per_ampere =
      hardware.plant.torque_constant / hardware.plant.radius / converter_slope(hardware.sensing);
  const double tau = 6.283185307179586, zero = hardware.zero + zero_error;
  host_.set_parameter(Parameter::motor_direction, hardware.way * direction_error);
  host_.set_parameter(Parameter::motor_zero, zero - tau * std::floor(zero / tau));
  host_.set_parameter(Parameter::speed_limit, speed_limit);
  if (thermistor) host_.set_parameter(Parameter::thermistor_resistance, 1e4);
  host_.calibrate(Calibration::newton_per_ampere, newton_per_ampere);
  host_.calibrate(Calibration::length, kLength);
}

void Story::warm() {
  firmware::ThermalModel estimate(firmware::board::kDriverHeat);
  if (winding == Warmth::hot) {
    estimate.assume_hot(firmware::Parameters());
    plant().heat().winding = static_cast<double>(estimate.winding());
    plant().heat().housing = static_cast<double>(estimate.housing());
  }
  if (kept) firmware::keep_heat(estimate);
}

void Story::pull(double newtons, double seconds) {
  host_.refused = false;
  host_.arm();
  armed_ = true;
  tension = newtons;
  advance(seconds);
}

void Story::align() {
  plant().spool().cut = true;
  const int before = host_.acknowledged;
  begin();
  host_.calibrate(Calibration::encoder, 0.0);
  while (host_.acknowledged == before && this->seconds() < 5.0) advance(kStep);
}

void Story::begin() {
  fakes::catch_up();
  begun_us_ = fakes::now_us();
  begun_ = true;
  driven_ = plant().enabled;
  most_tension = 0.0;
  least_tension = 1e9;
  let_go_after = -1.0;
  weak_after = 0.0;
  host_.log.clear();
  reported_after = -1.0;
  accepted = !host_.refused;
  host_.refused = false;
}

void Story::watch(double seconds) {
  while (this->seconds() < seconds && let_go_after < 0.0) {
    meanwhile();
    advance(kStep);
  }
  advance(0.02);  // what the module has to say comes a little later
}

void Story::advance(double seconds) {
  for (double left = seconds; left > 1e-9; left -= kStep) {
    const double now = 1e-6 * static_cast<double>(fakes::now_us());
    board.hand_speed = taut_us_ > 0 ? hand(now - 1e-6 * static_cast<double>(taut_us_)) : 0.0;
    if (armed_ && speaking && now >= next_set_point_) {
      host_.pull(tension, brake);
      next_set_point_ = now + between(0.015, 0.025);
    }
    fakes::sleep_us(static_cast<std::uint64_t>(1e6 * std::min(left, kStep) + 0.5));
    fakes::catch_up();
    fakes::watch();
    host_.listen();
    if (begun_ && reported_after < 0.0 && !host_.log.empty()) reported_after = this->seconds();
    note_turn();
  }
}

void Story::note_turn() {
  if (!begun_ || fakes::now_us() == begun_us_) return;
  constexpr double kMinimum = 0.95;  // N: the minimum tension, and what friction adds to it
  const double now = plant().spool().tension();
  most_tension = std::max(most_tension, now);
  hottest = std::max(hottest, plant().heat().winding);
  least_tension = std::min(least_tension, now);
  if (now > kMinimum) weak_after = seconds();
  driven_ = driven_ || plant().enabled;
  if (let_go_after < 0.0 && driven_ && !plant().enabled) let_go_after = seconds();
}

}  // namespace dangers
}  // namespace tensionlab
