// From the tension that is wanted to the tension that is allowed, and what it is that limits.
#pragma once

#include "numbers.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

// What keeps the tension from being what the host wants, the one that bites most.
enum class Limit : uint8_t {
  none = 0,
  lower = 1,  // the minimum tension
  upper = 2,
  slew = 3,
  thermal = 4,
  speed = 5,      // the cable reels in too fast
  length = 6,     // the cable is reeled in, or out, as far as it may be
  releasing = 7,  // the brake is being released
  timeout = 8,
  idle = 9,  // the driver is off
};

struct CableState {
  float length;       // m
  float speed;        // of paying out, m/s
  bool length_known;  // since it was last calibrated
};

class TensionLimiter {
 public:
  float tension() const { return tension_; }
  Limit limit() const { return limit_; }

  // The driver is off: nothing pulls.
  void cut() {
    tension_ = 0.0f;
    limit_ = Limit::idle;
  }

  // Move towards `wanted`, no faster than the slew. `reason` says who wants it, if not the host. current_limit: A.
  void advance(float wanted, Limit reason, const CableState& cable, float current_limit, float seconds,
               const Parameters& p) {
    const float lower = p[Parameter::tension_lower];
    float allowed = wanted;
    limit_ = reason;
    const auto keep_below = [&](float ceiling, Limit limit) {
      if (allowed > ceiling) {
        allowed = ceiling;
        limit_ = limit;
      }
    };
    keep_below(p[Parameter::tension_upper], Limit::upper);
    keep_below(current_limit * p[Parameter::newton_per_ampere], Limit::thermal);
    const bool inside = cable.length > p[Parameter::length_lower] && cable.length < p[Parameter::length_upper];
    if (cable.length_known && !inside) keep_below(lower, Limit::length);
    if (!(allowed >= lower)) {  // less, or no number
      allowed = lower;
      limit_ = reason == Limit::none ? Limit::lower : reason;
    }
    // Even below the minimum tension: a slack cable would go on gaining speed.
    keep_below(speed_ceiling(cable.speed, p), Limit::speed);
    const float change = p[Parameter::slew] * seconds;
    if (magnitude(allowed - tension_) > change) {
      allowed = tension_ + (allowed > tension_ ? change : -change);
      if (limit_ == Limit::none) limit_ = Limit::slew;
    }
    tension_ = allowed;
  }

  // Move towards zero, which is below the minimum tension, no faster than the slew. Returns whether it is there.
  bool fade(float seconds, const Parameters& p) {
    tension_ = larger(tension_ - p[Parameter::slew] * seconds, 0.0f);
    limit_ = Limit::idle;
    return tension_ == 0.0f;
  }

 private:
  // From the speed limit on, a quarter as much again takes the tension down to nothing.
  static float speed_ceiling(float speed, const Parameters& p) {
    const float excess = -speed / p[Parameter::speed_limit] - 1.0f;
    return p[Parameter::tension_upper] * (1.0f - clamp(4.0f * excess, 0.0f, 1.0f));
  }

  float tension_ = 0.0f;
  Limit limit_ = Limit::idle;
};

}  // namespace firmware
}  // namespace tensionlab
