// All that the ESP32's pins lead to, simulated: bridge, motor, spool, cable, brake, supply, encoder and converter.
#pragma once

#include <cmath>
#include <cstdint>

#include "../esp32/board.hpp"
#include "bridge.hpp"
#include "current_sensing.hpp"
#include "encoder_chip.hpp"
#include "heat.hpp"
#include "spool.hpp"
#include "supply.hpp"

namespace tensionlab {
namespace plant {

struct HardwareParameters {
  PlantParameters plant = standard_plant();
  SupplyParameters supply;
  SensingParameters sensing;
  double way = 1.0;    // 1 where the encoder's angle grows while the cable pays out
  double zero = 2.0;   // electrical angle of the rotor at the encoder's zero, rad
  double start = 1.0;  // angle of the rotor at the start, rad
  int pole_pairs = firmware::board::kPolePairs;
  bool swapped = false;            // two of the motor's wires
  double bridge_resistance = 0.0;  // ohm
  double wake_time = 0.0;          // s, from the enable pin until the driver gives a voltage
  double dead_share = 0.0;         // of a period, in which both switches of a half-bridge are open
  double encoder_latency = 0.0;    // s, from the rotor to the angle that the chip sends
  double encoder_noise = 0.0;      // standard deviation, counts
};

// What can break, and be repaired.
struct HardwareFaults {
  bool driver = false;         // gives no voltage
  bool servo = false;          // does not move
  bool converter = false;      // does not answer
  double thermistor = 1.0;     // factor of its resistance: infinite where a wire is off, 0 where two touch
  bool frozen = false;         // the encoder sends the same angle for ever
  int stuck = -1;              // 0 or 1: the encoder's data line stays there
  double garbled = 0.0;        // share of the encoder's frames of which a bit is wrong
  double slip = 0.0;           // of the magnet on its shaft, rad
  double encoder_noise = 0.0;  // added, standard deviation, counts
};

class Hardware {
 public:
  Hardware(const HardwareParameters& parameters, double distance, std::uint64_t seed)
      : p_(parameters),
        noise_(seed),
        spool_(parameters.plant, distance),
        supply_(parameters.supply),
        heat_(parameters.plant),
        sensing_(parameters.sensing, seed + 1) {}

  // The far end of the cable moves on at `speed` m/s.
  void advance(double seconds, double speed) {
    constexpr double kLongest = 65e-6;  // s
    const int parts = static_cast<int>(std::ceil(seconds / kLongest));
    for (int part = 0; part < parts; ++part) advance_part(seconds / parts, speed);
  }

  std::uint16_t exchange(std::uint16_t frame) {
    if (!faults.frozen) chip_.angle = static_cast<std::uint16_t>(encoder_counts()) & 0x3FFF;
    const std::uint16_t answer = chip_.exchange(frame);
    if (faults.garbled > 0.0 && noise_.uniform() < faults.garbled) {
      return static_cast<std::uint16_t>(answer ^ (1 << static_cast<int>(16.0 * noise_.uniform())));
    }
    if (faults.stuck < 0) return answer;
    return faults.stuck == 0 ? 0x0000 : 0xFFFF;
  }

  int convert(CurrentSensing::Input input) {
    return sensing_.convert(input, {motor_.current(), supply_.voltage(), faults.thermistor * heat_.thermistor()});
  }

  // The cable's end goes where the cable is just taut.
  void take_up_slack() { distance_ = spool_.out(); }

  double distance() const { return distance_; }  // of the cable's end, m
  const Spool& spool() const { return spool_; }
  double supply_voltage() const { return supply_.voltage(); }
  Supply& supply() { return supply_; }
  Heat& heat() { return heat_; }
  GimbalMotor& motor() { return motor_; }
  CurrentSensing& sensing() { return sensing_; }
  Spool& spool() { return spool_; }

  // What the pins say.
  bool enabled = false;
  Duties duties = {0.0, 0.0, 0.0};
  double brake = 0.0;  // where the servo is to go, 0 open to 1 closed

  HardwareFaults faults;

 private:
  void advance_part(double seconds, double speed) {
    const PlantParameters& plant = p_.plant;
    const double poles = p_.pole_pairs * (p_.swapped ? -1.0 : 1.0);
    const double electrical = poles * rotor() - (p_.swapped ? -p_.zero : p_.zero);
    const double electrical_speed = poles * p_.way * spool_.speed() / plant.radius;
    const double flux = plant.torque_constant / (1.5 * p_.pole_pairs);
    enabled_for_ = enabled ? enabled_for_ + seconds : 0.0;
    const bool on = enabled && enabled_for_ > p_.wake_time && !faults.driver;
    const Vector voltage =
        bridge_voltage(duties, motor_.current(), supply_.voltage(), p_.bridge_resistance, p_.dead_share);
    motor_.advance(on ? &voltage : nullptr, electrical, electrical_speed, heat_.resistance(), plant.inductance,
                   flux, seconds);
    const Vector& current = motor_.current();
    heat_.advance(current.alpha * current.alpha + current.beta * current.beta, on, seconds);
    const double power = on ? 1.5 * (voltage.alpha * current.alpha + voltage.beta * current.beta) : 0.0;
    supply_.advance(power / std::fmax(supply_.voltage(), 1.0), seconds);
    distance_ += speed * seconds;
    spool_.place_end(distance_, speed);
    if (!faults.servo) spool_.move_servo(brake, seconds);
    // The motor turns the rotor along its electrical angle.
    spool_.advance(-p_.way * (p_.swapped ? -1.0 : 1.0) * motor_.along_q(electrical), seconds);
  }

  double rotor() const { return p_.start + p_.way * spool_.turned(); }  // rad

  int encoder_counts() {
    constexpr double kCounts = 16384.0 / 6.283185307179586;
    const double late = p_.way * spool_.speed() / p_.plant.radius * p_.encoder_latency;
    const double noise = std::hypot(p_.encoder_noise, faults.encoder_noise);
    const double counts = kCounts * (rotor() - late + faults.slip);
    return static_cast<int>(std::floor(counts + (noise > 0.0 ? noise * noise_.normal() : 0.0)));
  }

  HardwareParameters p_;
  Noise noise_;
  Spool spool_;
  Supply supply_;
  Heat heat_;
  CurrentSensing sensing_;
  GimbalMotor motor_;
  EncoderChip chip_;
  double distance_ = spool_.out();
  double enabled_for_ = 0.0;  // s
};

}  // namespace plant
}  // namespace tensionlab
