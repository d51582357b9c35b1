// Finds the motor's electrical zero, and checks on the way what can be wired wrongly.
//
// The rotor is drawn along by a voltage that turns once forward and once back. Where it rests after both is the
// zero, and friction, which holds it back either way, cancels. A step at a time, so that an emergency stop is
// heard.
#pragma once

#include <stdint.h>

#include "../core/numbers.hpp"

namespace tensionlab {
namespace firmware {

class Alignment {
 public:
  enum class Result : uint8_t { running, done, not_moved, wrong_way, wrong_poles, not_back, wrong_current };

  struct Motor {
    int pole_pairs;
    float resistance;  // of a phase and its half-bridge, ohm
    float voltage;     // to align with, V
  };

  struct Measured {
    float angle;        // of the rotor, over all turns, rad
    float alpha, beta;  // currents along the axis of phase A and across it, A
  };

  // What SimpleFOC's setPhaseVoltage takes: along the rotor's q axis, were it at this electrical angle.
  struct Wanted {
    float voltage, electrical;
  };

  Alignment(const Motor& motor, uint32_t now_us) : motor_(motor), start_us_(now_us) {}

  // Call it some thousand times a second with what was measured, until it is no longer running.
  Result advance(uint32_t now_us, const Measured& measured) {
    const float seconds = 1e-6f * static_cast<float>(since(now_us, start_us_));
    const bool turns = (seconds > kTurn && seconds < kForward) || (seconds > kBack && seconds < kHome);
    if (turns) weigh(measured);
    if (seconds < kTurn) {
      begin_ = measured.angle;
    } else if (seconds < kBack) {
      far_ = measured.angle;
    } else if (seconds >= kEnd) {
      return judge(measured.angle);
    }
    wanted_.voltage = motor_.voltage * smaller(seconds / kRamp, 1.0f);
    wanted_.electrical = kThreeQuarters + kTau * way(seconds);
    return Result::running;
  }

  Wanted wanted() const { return wanted_; }

  // Once it is done: the electrical zero in rad, from 0 to 2 pi.
  float zero() const { return zero_; }
  // Share of the current that the resistance lets through which was measured; 1 if the shunt is as told.
  float current_share() const { return share_; }
  // Ways of the rotor forward and back, in pole pairs: 1 each.
  float forth() const { return forth_; }
  float back() const { return back_; }

 private:
  static constexpr float kTau = 6.2831853f, kThreeQuarters = 4.7123890f;
  // In s: the voltage has risen, is forward, rests there, is back, has rested.
  static constexpr float kRamp = 0.5f, kTurn = 0.7f, kForward = 1.7f, kBack = 2.0f, kHome = 3.0f, kEnd = 3.3f;

  // How far the voltage has turned, in turns. While it rises it comes from a quarter of a turn before: a rotor
  // that lies just opposite to a voltage that rests would stay there.
  static float way(float seconds) {
    if (seconds < kRamp) return 0.25f * (seconds / kRamp - 1.0f);
    if (seconds < kForward) return clamp((seconds - kTurn) / (kForward - kTurn), 0.0f, 1.0f);
    return clamp((kHome - seconds) / (kHome - kBack), 0.0f, 1.0f);
  }

  // Adds up the current along the voltage. Over whole turns, and only over these, a phase that is swapped or
  // inverted cancels.
  void weigh(const Measured& measured) {
    const float turns = wanted_.electrical / kTau;
    const float along_alpha = -sine_of_turns(part(turns)) * wanted_.voltage;
    const float along_beta = sine_of_turns(part(turns + 0.25f)) * wanted_.voltage;
    current_ += measured.alpha * along_alpha + measured.beta * along_beta;
    power_ += wanted_.voltage * wanted_.voltage / motor_.resistance;
  }

  static float part(float turns) { return turns - static_cast<float>(static_cast<int>(turns)); }

  Result judge(float angle) {
    const float turn = kTau / static_cast<float>(motor_.pole_pairs);
    forth_ = (far_ - begin_) / turn;
    back_ = (far_ - angle) / turn;
    share_ = power_ > 0.0f ? current_ / power_ : 0.0f;
    if (magnitude(forth_) < 0.2f) return Result::not_moved;
    if (forth_ < 0.0f) return Result::wrong_way;
    if (magnitude(forth_ - 1.0f) > 0.15f) return Result::wrong_poles;
    // A pawl on its wheel, or a taut cable, stops one way only: the mean of both rests would be no zero.
    if (magnitude(back_ - 1.0f) > 0.15f) return Result::not_back;
    if (share_ < 0.75f || share_ > 1.35f) return Result::wrong_current;
    const float rest = 0.5f * (far_ - turn + angle);
    const float turns = rest / turn;
    const float within = part(turns);
    zero_ = kTau * (within < 0.0f ? within + 1.0f : within);
    return Result::done;
  }

  Motor motor_;
  uint32_t start_us_;
  Wanted wanted_ = {0.0f, kThreeQuarters};
  float begin_ = 0.0f, far_ = 0.0f, zero_ = 0.0f;
  float current_ = 0.0f, power_ = 0.0f, share_ = 0.0f, forth_ = 0.0f, back_ = 0.0f;
};

}  // namespace firmware
}  // namespace tensionlab
