// Monitor of the sensors: the motion of the cable, the length of a step, and faults.
#pragma once

#include "limiter.hpp"
#include "numbers.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

// What the front end measures before each step.
struct Sensors {
  uint32_t now_us;
  float angle;    // of the spool, counted over all turns, rad
  float speed;    // of the spool, rad/s
  float current;  // that makes torque, A
  // Voltage that the rotor induces: what resistance and inductance leave of the motor's voltage. `induced` is
  // along the current, positive while the cable reels in; `across` is at right angles to it, where a rotor whose
  // electrical zero is known induces nothing. V; both 0 with the driver off.
  float induced, across;
  float supply;      // V
  float thermistor;  // on the motor's housing, ohm; of no meaning where none is fitted
  bool encoder_ok;   // magnet, parity, error flag
};

// Bits of the fault word.
enum Fault : uint16_t {
  kFaultEncoder = 1,
  kFaultSupply = 2,
  kFaultSpeed = 4,
  kFaultCurrent = 8,
  kFaultLoop = 16,
  kFaultMotor = 32,
  kFaultCable = 64,
};

// A fault is so many bad samples in a row, or more than one in ten for long, as one may be noise; it is over after
// ten times as many good ones.
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

// What the driven motor does, in means over 4 ms. Means of the induced voltage and the way of the cable in the
// same time agree however fast the motion changes; samples of a filtered speed would not.
class MotorCheck {
 public:
  void restart() {
    started_ = false;
    seconds_ = induced_ = across_ = current_ = 0.0f;
    unfit_.judge(false, 2);
  }

  // A sample of a driven motor, whose cable is `length` m beyond the encoder's zero.
  void take(const Sensors& sensors, float seconds, float length, const Parameters& p) {
    if (!started_) {
      start_ = length;
      started_ = true;
      return;
    }
    seconds_ += seconds;
    induced_ += sensors.induced * seconds;
    across_ += sensors.across * seconds;
    current_ += magnitude(sensors.current) * seconds;
    if (seconds_ < kBlock) return;
    const float speed = (length - start_) / seconds_;
    unfit_.judge(!fits(speed, induced_ / seconds_, across_ / seconds_, current_ / seconds_, p), 2);
    start_ = length;
    seconds_ = induced_ = across_ = current_ = 0.0f;
  }

  // Voltage, current and speed are not those of one motor.
  bool unfit() const { return unfit_.bad(); }

 private:
  static constexpr float kBlock = 0.004f;  // s

  // A motor's newtons for each ampere tell its volts for each m/s: by amplitudes, power is 3/2 of voltage times
  // current. The bounds leave room for a winding that is warm or of another make (1 ohm, 0.75 mH at 11 pole pairs
  // and 19.5 mm), for the driver's dead time, for a quarter of N/A, and for the time in which the rotor turns on
  // while a voltage stays.
  static bool fits(float speed, float induced, float across, float current, const Parameters& p) {
    const float expected = -speed * p[Parameter::newton_per_ampere] * (2.0f / 3.0f);
    const float known = 0.3f + 0.25f * magnitude(expected);
    return magnitude(induced - expected) <= known + 1.0f * current &&
           magnitude(across) <= known + (0.42f * current + 0.2f * magnitude(speed)) * magnitude(speed);
  }

  Suspicion unfit_;
  float seconds_ = 0.0f, induced_ = 0.0f, across_ = 0.0f, current_ = 0.0f, start_ = 0.0f;
  bool started_ = false;
};

class Monitor {
 public:
  // Takes a sample, after a step in which the driver was on or off and `asked` A were asked of the motor. Returns
  // the seconds since the last one, at most kLongestStep of them: a step that came late must not move anything
  // further.
  float take(const Sensors& sensors, bool driven, float asked, const Parameters& p) {
    const int32_t elapsed = started_ ? since(sensors.now_us, stepped_us_) : 0;
    late_ = elapsed > kLongestStep || elapsed < 0;
    stepped_us_ = sensors.now_us;
    started_ = true;
    longest_us_ = elapsed > longest_us_ ? elapsed : longest_us_;
    const float seconds = 1e-6f * static_cast<float>(late_ ? (elapsed > 0 ? kLongestStep : 0) : elapsed);
    const bool readable = sensors.encoder_ok && is_finite(sensors.angle) && is_finite(sensors.speed);
    encoder_.judge(!readable, 4);
    if (readable) {
      const float radius = p[Parameter::spool_radius] * p[Parameter::motor_direction];
      paid_out_ = sensors.angle * radius;
      speed_ = sensors.speed * radius;
    }
    judge_speed(p);
    judge_cable(driven, seconds, p);
    const bool measured = is_finite(sensors.current) && is_finite(sensors.induced) && is_finite(sensors.across);
    if (is_finite(sensors.current)) current_ = sensors.current;
    strong_.judge(!measured || magnitude(current_) > 1.5f * p[Parameter::current_peak], 4);
    // A wire that is off, or a sensor that sees nothing. (Reeling in fast, the supply may not suffice either.)
    weak_.judge(asked > 0.1f && current_ < 0.5f * asked && magnitude(speed_) < 0.2f, 200);
    const float supply = sensors.supply;
    supply_.judge(!(supply >= p[Parameter::supply_lower] && supply <= p[Parameter::supply_upper]), 40);
    if (driven && readable && measured && !late_) {
      motor_.take(sensors, seconds, paid_out_, p);
    } else {
      motor_.restart();
    }
    return seconds;
  }

  // Faults that are there now.
  uint16_t faults() const {
    return static_cast<uint16_t>((encoder_.bad() ? kFaultEncoder : 0) | (supply_.bad() ? kFaultSupply : 0) |
                                 (fast_in_.bad() || fast_out_.bad() ? kFaultSpeed : 0) |
                                 (strong_.bad() || weak_.bad() ? kFaultCurrent : 0) | (late_ ? kFaultLoop : 0) |
                                 (motor_.unfit() ? kFaultMotor : 0) | (loose_ ? kFaultCable : 0));
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
  // Slack that a hand makes at once: an arm's reach of 0.7 m, and the trunk that leans with it.
  static constexpr float kReach = 1.0f;  // m

  // The limiter holds a slack cable at the speed limit: what is faster is driven by something else. A hand may
  // pull the cable out at twice that, and a jerk throws the spool out faster still for a moment.
  void judge_speed(const Parameters& p) {
    const float limit = p[Parameter::speed_limit];
    fast_in_.judge(-speed_ > 1.4f * limit, 4);
    fast_out_.judge(speed_ > 2.25f * limit, 400);
  }

  // A spool that nothing holds settles between the limit and 1.25 times it, as it does while it takes up slack. A
  // cable that was taut since the driver went on has no more slack than a hand makes; before, no more than its
  // length.
  void judge_cable(bool driven, float seconds, const Parameters& p) {
    still_ = driven && magnitude(speed_) < 0.1f ? still_ + seconds : 0.0f;
    taut_ = driven && (taut_ || still_ > 0.05f);
    taken_up_ = driven && -speed_ > 1.1f * p[Parameter::speed_limit] ? taken_up_ - speed_ * seconds : 0.0f;
    loose_ = taken_up_ > (taut_ ? kReach : p[Parameter::length_upper]);
  }

  Suspicion encoder_, supply_, fast_in_, fast_out_, strong_, weak_;
  MotorCheck motor_;
  bool taut_ = false, loose_ = false, started_ = false, late_ = true;  // before the first step nothing is known
  uint32_t stepped_us_ = 0;
  int32_t longest_us_ = 0;
  float paid_out_ = 0.0f, speed_ = 0.0f, current_ = 0.0f, still_ = 0.0f, taken_up_ = 0.0f;
};

}  // namespace firmware
}  // namespace tensionlab
