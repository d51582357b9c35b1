// The one-way brake: a pawl that a servo lays on a toothed wheel. Laid on, the cable reels in but does not pay
// out.
//
// A pawl under load does not come off: to release it the motor first reels in a little, so that the load leaves
// the pawl, and then the servo lifts it. The brake never changes faster than its dwell, so that it can't chatter.
#pragma once

#include "numbers.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

enum class BrakeState : uint8_t { open, closing, closed, releasing, opening };

class Brake {
 public:
  explicit Brake(bool closed = false) : state_(closed ? BrakeState::closed : BrakeState::open) {}

  BrakeState state() const { return state_; }
  bool is_closed() const { return state_ == BrakeState::closed || state_ == BrakeState::releasing; }

  // Whether the motor should pull at least with the release tension now: until the pawl is off the wheel.
  bool is_releasing() const { return state_ == BrakeState::releasing || state_ == BrakeState::opening; }

  float pulse_us(const Parameters& p) const {
    const bool down = state_ == BrakeState::closing || is_closed();
    return p[down ? Parameter::brake_closed_pulse : Parameter::brake_open_pulse];
  }

  // Whether the cable has paid out by more than the pawl's play, though the brake is on. `length`: of the cable,
  // m.
  bool slips(float length, const Parameters& p) const {
    return state_ == BrakeState::closed && length > shortest_ + 2.0f * p[Parameter::brake_tooth];
  }

  // driven: the motor can reel in. length: of the cable, m.
  void advance(bool wanted, bool driven, float length, uint32_t now_us, const Parameters& p) {
    const int32_t travel = static_cast<int32_t>(1000.0f * p[Parameter::brake_travel]);
    const int32_t dwell = static_cast<int32_t>(1000.0f * p[Parameter::brake_dwell]);
    // Time that has long passed must not come back when the clock wraps around.
    if (!settled_ && since(now_us, since_us_) >= larger_of(travel, dwell)) settled_ = true;
    const bool travelled = settled_ || since(now_us, since_us_) >= travel;
    const bool rested = settled_ || since(now_us, since_us_) >= dwell;
    switch (state_) {
      case BrakeState::open:
        if (wanted && rested) enter(BrakeState::closing, now_us);
        break;
      case BrakeState::closing:
        if (travelled) enter(BrakeState::closed, now_us);
        shortest_ = length;
        break;
      case BrakeState::closed:
        shortest_ = smaller(shortest_, length);
        if (!wanted && rested) {
          enter(driven ? BrakeState::releasing : BrakeState::opening, now_us);
          released_at_ = length - 0.5f * p[Parameter::brake_tooth];
        }
        break;
      case BrakeState::releasing:
        if (wanted && !driven) {  // a fault: the pawl is still on its wheel
          enter(BrakeState::closed, now_us);
        } else if (!driven || length <= released_at_ || since(now_us, since_us_) >= kReleaseTime) {
          enter(BrakeState::opening, now_us);
        }
        break;
      case BrakeState::opening:
        if (travelled) enter(BrakeState::open, now_us);
        break;
    }
  }

 private:
  // Where the load can't be reeled off, the servo tries all the same after this time.
  static constexpr int32_t kReleaseTime = 300000;

  static int32_t larger_of(int32_t x, int32_t y) { return x > y ? x : y; }

  void enter(BrakeState state, uint32_t now_us) {
    state_ = state;
    since_us_ = now_us;
    settled_ = false;
  }

  BrakeState state_;
  bool settled_ = true;
  uint32_t since_us_ = 0;
  float released_at_ = 0.0f;
  float shortest_ = 1e9f;  // length of the cable since the brake is on, m
};

}  // namespace firmware
}  // namespace tensionlab
