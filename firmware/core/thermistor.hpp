// The temperature of a thermistor by its resistance, and whether it is broken or shorted.
#pragma once

#include "numbers.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

class Thermistor {
 public:
  enum class State : uint8_t { silent, good, broken, shorted };  // silent: none fitted, or nothing read yet

  // A reading, in ohm; what is no number counts as broken. Returns whether the state changed.
  bool take(float resistance, const Parameters& p) {
    const State before = state_;
    if (p[Parameter::thermistor_resistance] == 0.0f) {
      state_ = State::silent;
      return false;
    }
    const State now = judge(resistance, p);
    count_ = now == seen_ ? (count_ < kEnough ? count_ + 1 : kEnough) : 1;
    seen_ = now;
    if (count_ == kEnough) state_ = now;
    return state_ != before;
  }

  State state() const { return state_; }
  float temperature() const { return temperature_; }  // °C, if good

 private:
  static constexpr float kZero = 273.15f;  // K
  // Below and above these, a wire is off or two touch, K.
  static constexpr float kColdest = kZero - 25.0f, kHottest = kZero + 150.0f;
  static constexpr int32_t kEnough = 200;  // readings of one kind in a row, 50 ms

  // By the beta equation: 1 / T = 1 / T0 + ln(R / R0) / beta, where T0 is 25 °C.
  State judge(float resistance, const Parameters& p) {
    if (!is_finite(resistance) || resistance < 0.0f) return State::broken;
    const float ratio = larger(resistance / p[Parameter::thermistor_resistance], 1e-6f);
    const float inverse = 1.0f / (kZero + 25.0f) + natural_logarithm(ratio) / p[Parameter::thermistor_beta];
    if (inverse < 1.0f / kHottest) return State::shorted;
    if (inverse > 1.0f / kColdest) return State::broken;
    temperature_ = 1.0f / inverse - kZero;
    return State::good;
  }

  State state_ = State::silent, seen_ = State::silent;
  int32_t count_ = 0;
  float temperature_ = 0.0f;
};

}  // namespace firmware
}  // namespace tensionlab
