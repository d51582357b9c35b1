// How much current the winding stands: a budget of squared current over time (I2t).
//
// The winding warms as one body with a time constant. Its warmth is kept as the squared current that would hold it
// there: at current_continuous² it is as warm as it may be for ever. What is left of that may be spent on more.
#pragma once

#include "numbers.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

class ThermalBudget {
 public:
  // Nobody knows what the winding went through: nothing is left to spend.
  void assume_spent(const Parameters& p) {
    warmth_ = p[Parameter::current_continuous] * p[Parameter::current_continuous];
  }

  void advance(float current, float seconds, const Parameters& p) {
    const float share = smaller(seconds / p[Parameter::thermal_time], 1.0f);
    warmth_ += share * (current * current - warmth_);
  }

  // The largest current that the winding stands for now, in A. What is left of the budget may be spent within a
  // tenth of the time constant; so the limit sinks to the continuous current smoothly, and never below it.
  float current_limit(const Parameters& p) const {
    const float continuous = p[Parameter::current_continuous];
    const float left = larger(continuous * continuous - warmth_, 0.0f);
    return smaller(square_root(continuous * continuous + kHaste * left), p[Parameter::current_peak]);
  }

  // Share of the budget that is spent, from 0 to 1.
  float spent(const Parameters& p) const {
    const float continuous = p[Parameter::current_continuous];
    return smaller(warmth_ / (continuous * continuous), 1.0f);
  }

 private:
  static constexpr float kHaste = 10.0f;

  float warmth_ = 0.0f;  // A²
};

}  // namespace firmware
}  // namespace tensionlab
