// What the host wants of the cable: a tension, or a spring and damper that the module renders at its own rate.
#pragma once

#include "messages.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

inline bool needs_length(const SetTension&) { return false; }
inline bool needs_length(const SetImpedance& command) { return command.stiffness > 0.0f; }

class SetPoint {
 public:
  // Both refuse what lies outside the module's limits, and then leave the set-point as it was.
  bool take(const SetTension& command, const Parameters& p) {
    if (command.tension < 0.0f || command.tension > p[Parameter::tension_upper]) return false;
    spring_ = SetImpedance{};
    spring_.feed_forward = command.tension;
    spring_.brake = command.brake;
    return true;
  }

  bool take(const SetImpedance& command, const Parameters& p) {
    const float most = p[Parameter::tension_upper];
    const bool inside = command.rest >= 0.0f && command.rest <= p[Parameter::length_upper] &&
                        command.stiffness >= 0.0f && command.stiffness <= p[Parameter::stiffness_limit] &&
                        command.damping >= 0.0f && command.damping <= p[Parameter::damping_limit] &&
                        magnitude(command.feed_forward) <= most && command.amplitude >= 0.0f &&
                        command.amplitude <= most && command.frequency >= 0.0f &&
                        command.frequency <= kHighestFrequency;
    if (!inside) return false;
    if (command.frequency != spring_.frequency) phase_ = 0.0f;
    spring_ = command;
    return true;
  }

  bool brake() const { return spring_.brake; }

  // Tension wanted now, in N, before any limit. length: of the cable, m; speed: of paying out, m/s.
  float tension(float length, float speed) const {
    const float& k = spring_.stiffness;
    return spring_.feed_forward + k * larger(length - spring_.rest, 0.0f) + spring_.damping * larger(speed, 0.0f) +
           spring_.amplitude * sine_of_turns(phase_);
  }

  void advance(float seconds) {
    phase_ += spring_.frequency * seconds;
    while (phase_ >= 1.0f) phase_ -= 1.0f;
  }

 private:
  static constexpr float kHighestFrequency = 500.0f;  // Hz

  SetImpedance spring_ = {};  // a plain tension is a spring without stiffness
  float phase_ = 0.0f;        // of the vibration, in turns
};

}  // namespace firmware
}  // namespace tensionlab
