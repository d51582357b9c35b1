// What the sensors say, and whether it can be true: the motion of the cable, the length of a step, and faults.
#pragma once

#include "limiter.hpp"
#include "numbers.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

// What the front end measures before each step.
struct Sensors {
  uint32_t now_us;
  float angle;      // of the spool, counted over all turns, rad
  float speed;      // of the spool, rad/s
  float current;    // that makes torque, A
  float supply;     // V
  bool encoder_ok;  // magnet, parity, error flag
};

// Bits of the fault word.
enum Fault : uint16_t {
  kFaultEncoder = 1,
  kFaultSupply = 2,
  kFaultSpeed = 4,
  kFaultCurrent = 8,
  kFaultLoop = 16,
};

class Monitor {
 public:
  // Takes a sample, after a step in which `asked` A were asked of the motor. Returns the seconds since the last
  // one, at most kLongestStep of them: a step that came late must not move anything further than that.
  float take(const Sensors& sensors, float asked, const Parameters& p) {
    const int32_t elapsed = started_ ? since(sensors.now_us, stepped_us_) : 0;
    late_ = elapsed > kLongestStep || elapsed < 0;
    stepped_us_ = sensors.now_us;
    started_ = true;
    longest_us_ = elapsed > longest_us_ ? elapsed : longest_us_;
    const bool readable = sensors.encoder_ok && is_finite(sensors.angle) && is_finite(sensors.speed);
    encoder_.judge(!readable, 4);
    if (readable) {
      const float radius = p[Parameter::spool_radius] * p[Parameter::motor_direction];
      paid_out_ = sensors.angle * radius;
      speed_ = sensors.speed * radius;
    }
    fast_.judge(-speed_ > 2.0f * p[Parameter::speed_limit], 4);
    const bool measured = is_finite(sensors.current);
    if (measured) current_ = sensors.current;
    strong_.judge(!measured || magnitude(current_) > 1.5f * p[Parameter::current_peak], 4);
    // A wire that is off, or a sensor that sees nothing. (Reeling in fast, the supply may not suffice either.)
    weak_.judge(asked > 0.1f && current_ < 0.5f * asked && magnitude(speed_) < 0.2f, 200);
    const float supply = sensors.supply;
    supply_.judge(!(supply >= p[Parameter::supply_lower] && supply <= p[Parameter::supply_upper]), 40);
    return 1e-6f * static_cast<float>(late_ ? (elapsed > 0 ? kLongestStep : 0) : elapsed);
  }

  // Faults that are there now.
  uint16_t faults() const {
    return static_cast<uint16_t>((encoder_.bad() ? kFaultEncoder : 0) | (supply_.bad() ? kFaultSupply : 0) |
                                 (fast_.bad() ? kFaultSpeed : 0) |
                                 (strong_.bad() || weak_.bad() ? kFaultCurrent : 0) | (late_ ? kFaultLoop : 0));
  }

  float paid_out() const { return paid_out_; }  // cable, m, where the encoder's zero is nought
  float speed() const { return speed_; }        // of paying out, m/s
  float current() const { return current_; }    // A

  // Longest time from step to step since the last call, in us.
  uint16_t take_longest_step() {
    const int32_t longest = longest_us_ < 0xFFFF ? longest_us_ : 0xFFFF;
    longest_us_ = 0;
    return static_cast<uint16_t>(longest);
  }

 private:
  // A step that comes later than this is a fault: until then the motor was left to itself.
  static constexpr int32_t kLongestStep = 5000;  // us

  // One bad sample may be noise. A fault is `enough` of them in a row, or more than one in ten for long; and it is
  // over after ten times as many good ones.
  class Suspicion {
   public:
    void judge(bool bad, int32_t enough) {
      level_ = bad ? level_ + 10 : level_ - 1;
      level_ = level_ < 0 ? 0 : (level_ > 10 * enough ? 10 * enough : level_);
      bad_ = level_ == 10 * enough || (bad_ && level_ > 0);
    }
    bool bad() const { return bad_; }

   private:
    int32_t level_ = 0;
    bool bad_ = false;
  };

  Suspicion encoder_, supply_, fast_, strong_, weak_;
  bool started_ = false, late_ = true;  // before the first step nothing is known
  uint32_t stepped_us_ = 0;
  int32_t longest_us_ = 0;
  float paid_out_ = 0.0f, speed_ = 0.0f, current_ = 0.0f;
};

}  // namespace firmware
}  // namespace tensionlab
