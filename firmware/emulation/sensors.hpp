// Sensors of a module whose cable a hand moves to and fro: noise, and defects of every kind that the monitor
// knows.
#pragma once

#include <limits>

#include "../core/module.hpp"
#include "bench.hpp"

namespace tensionlab {
namespace emulation {

enum class Defect {
  none,
  encoder_error,
  encoder_number,
  supply_low,
  supply_number,
  reels_in,
  pays_out,
  current_strong,
  current_missing,
  current_number,
  voltage,
  late,
  slack,
  count,
};

class SimulatedSensors {
 public:
  SimulatedSensors(Random& random, uint32_t begin_us) : random_(random) { sensors_.now_us = begin_us; }

  uint32_t now_us() const { return sensors_.now_us; }
  uint32_t wraps() const { return wraps_; }

  void begin(Defect defect) {
    defect_ = defect;
    seconds_ = 0.0F;
  }

  // A sample some time after the last, of a motor that did what was asked of it.
  const firmware::Sensors& sample(int step_us, const firmware::Actuators& asked, const firmware::Parameters& p) {
    const float seconds = 1e-6F * static_cast<float>(pass(step_us));
    move(seconds, p[firmware::Parameter::speed_limit]);
    const float radius = p[firmware::Parameter::spool_radius] * p[firmware::Parameter::motor_direction];
    const float volts = -velocity_ * p[firmware::Parameter::newton_per_ampere] * (2.0F / 3.0F);
    const bool on = asked.driver_on;
    sensors_.angle = position_ / radius;
    sensors_.speed = (velocity_ + noise(0.01F)) / radius;
    sensors_.current = asked.current + noise(0.02F);
    sensors_.induced = on ? volts + noise(0.1F) : 0.0F;
    sensors_.across = on ? noise(0.1F) : 0.0F;
    sensors_.supply = 12.0F + noise(0.3F);
    sensors_.encoder_ok = !random_.once_in(500);
    damage();
    return sensors_;
  }

 private:
  uint32_t pass(int step_us) {
    const uint32_t before = sensors_.now_us;
    const int late = defect_ == Defect::late && random_.once_in(30) ? 5000 + random_.below(5000) : 0;
    sensors_.now_us += static_cast<uint32_t>(step_us + random_.below(21) - 10 + late);
    if (sensors_.now_us < before) ++wraps_;
    return sensors_.now_us - before;
  }

  // Defects move the cable faster than the monitor allows, or slack in as fast as the limiter does.
  void move(float seconds, float speed_limit) {
    seconds_ += seconds;
    velocity_ += noise(0.02F) - 0.2F * seconds * (position_ - 1.5F);
    velocity_ = firmware::clamp(velocity_, -1.0F, 1.0F);
    if (defect_ == Defect::current_missing) velocity_ = noise(0.05F);
    if (defect_ == Defect::reels_in) velocity_ = -1.6F * speed_limit;
    if (defect_ == Defect::pays_out) velocity_ = 2.6F * speed_limit;
    if (defect_ == Defect::slack) velocity_ = seconds_ < 0.1F ? 0.0F : -1.2F * speed_limit;  // first taut
    position_ += velocity_ * seconds;
  }

  void damage() {
    constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();
    if (defect_ == Defect::encoder_error) sensors_.encoder_ok = random_.once_in(4);
    if (defect_ == Defect::encoder_number) sensors_.angle = kNoNumber;
    if (defect_ == Defect::supply_low) sensors_.supply = 5.0F;
    if (defect_ == Defect::supply_number) sensors_.supply = kNoNumber;
    if (defect_ == Defect::current_strong) sensors_.current = 5.0F;
    if (defect_ == Defect::current_missing) sensors_.current = noise(0.02F);
    if (defect_ == Defect::current_number) sensors_.current = std::numeric_limits<float>::infinity();
    if (defect_ == Defect::voltage) sensors_.across = 4.0F;
  }

  float noise(float most) { return random_.uniform(-most, most); }

  Random& random_;
  firmware::Sensors sensors_ = {};
  Defect defect_ = Defect::none;
  float seconds_ = 0.0F;                     // since the defect began
  float position_ = 1.5F, velocity_ = 0.0F;  // of the cable, m and m/s
  uint32_t wraps_ = 0;                       // of the clock
};

}  // namespace emulation
}  // namespace tensionlab
