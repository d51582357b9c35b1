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
  // Takes a sample. Returns the seconds since the last one, at most kLongestStep of them: a step that came late
  // must not move anything further than one that came in time.
  float take(const Sensors& sensors, const Parameters& p) {
    const int32_t elapsed = started_ ? since(sensors.now_us, stepped_us_) : 0;
    stepped_us_ = sensors.now_us;
    started_ = true;
    late_ = elapsed > kLateStep || elapsed < 0;
    longest_us_ = elapsed > longest_us_ ? elapsed : longest_us_;
    const bool numbers = is_finite(sensors.angle) && is_finite(sensors.speed) && is_finite(sensors.current) &&
                         is_finite(sensors.supply);
    encoder_.judge(!numbers || !sensors.encoder_ok, 4);
    if (numbers) {
      const float radius = p[Parameter::spool_radius] * p[Parameter::motor_direction];
      paid_out_ = sensors.angle * radius;
      speed_ = sensors.speed * radius;
      current_ = sensors.current;
      supply_.judge(sensors.supply < p[Parameter::supply_lower] || sensors.supply > p[Parameter::supply_upper],
                    40);
      fast_.judge(-speed_ > 2.0f * p[Parameter::speed_limit], 4);
      strong_.judge(magnitude(current_) > 1.5f * p[Parameter::current_peak], 4);
    }
    const int32_t counted = elapsed < 0 ? 0 : (elapsed > kLongestStep ? kLongestStep : elapsed);
    return 1e-6f * static_cast<float>(counted);
  }

  // Faults that are there now.
  uint16_t faults() const {
    return static_cast<uint16_t>((encoder_.bad() ? kFaultEncoder : 0) | (supply_.bad() ? kFaultSupply : 0) |
                                 (fast_.bad() ? kFaultSpeed : 0) | (strong_.bad() ? kFaultCurrent : 0) |
                                 (late_ ? kFaultLoop : 0));
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
  static constexpr int32_t kLongestStep = 2000, kLateStep = 20000;  // us

  // One bad sample may be noise; so many in a row are a fault.
  class Streak {
   public:
    void judge(bool bad, uint8_t enough) {
      count_ = static_cast<uint8_t>(bad ? (count_ < enough ? count_ + 1 : enough) : 0);
      bad_ = count_ >= enough;
    }
    bool bad() const { return bad_; }

   private:
    uint8_t count_ = 0;
    bool bad_ = false;
  };

  Streak encoder_, supply_, fast_, strong_;
  bool started_ = false, late_ = false;
  uint32_t stepped_us_ = 0;
  int32_t longest_us_ = 0;
  float paid_out_ = 0.0f, speed_ = 0.0f, current_ = 0.0f;
};

}  // namespace firmware
}  // namespace tensionlab
