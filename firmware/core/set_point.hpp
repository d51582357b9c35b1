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
  bool take(const SetTension& command, const Parameters& p, uint32_t) {
    if (command.tension < 0.0f || command.tension > p[Parameter::tension_upper]) return false;
    spring_ = SetImpedance{};
    spring_.feed_forward = command.tension;
    spring_.brake = command.brake;
    return true;
  }

  bool take(const SetImpedance& command, const Parameters& p, uint32_t now_us) {
    const float most = p[Parameter::tension_upper];
    const bool inside = command.rest >= 0.0f && command.rest <= p[Parameter::length_upper] &&
                        command.stiffness >= 0.0f && command.stiffness <= p[Parameter::stiffness_limit] &&
                        command.damping >= 0.0f && command.damping <= p[Parameter::damping_limit] &&
                        magnitude(command.feed_forward) <= most && command.amplitude >= 0.0f &&
                        command.amplitude <= most && command.frequency >= 0.0f &&
                        command.frequency <= kHighestFrequency && command.phase >= 0.0f && command.phase <= 1.0f;
    if (!inside) return false;
    spring_ = command;
    phase_ = turns(command.frequency, now_us) + command.phase;
    phase_ -= static_cast<float>(static_cast<uint32_t>(phase_));
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

  // Turns of a vibration at a time of the module's clock, less the whole ones of whole seconds: a float has no
  // digits left for the phase after some minutes. In parts of 2^-22 Hz the product overflows by whole turns only.
  static float turns(float frequency, uint32_t now_us) {
    const uint32_t second = now_us / 1000000u;
    const uint32_t parts = static_cast<uint32_t>(frequency * 4194304.0f) * second & 0x3FFFFFu;
    return static_cast<float>(parts) / 4194304.0f +
           frequency * 1e-6f * static_cast<float>(now_us - 1000000u * second);
  }

  SetImpedance spring_ = {};  // a plain tension is a spring without stiffness
  float phase_ = 0.0f;        // of the vibration, in turns
};

}  // namespace firmware
}  // namespace tensionlab
