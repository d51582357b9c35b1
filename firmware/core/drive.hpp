// From tension to motor current: calibrated newtons for each ampere, less what friction does already.
#pragma once

#include "limiter.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

// Current for a tension, in A. While the cable pays out friction pulls with the motor, while it reels in against
// it. At rest nobody knows, and the compensation passes smoothly through zero. It never pushes, and never asks for
// more than `current_limit`.
inline float current_for(float tension, float speed, float current_limit, const Parameters& p) {
  constexpr float kCreep = 0.02f;  // m/s, the speed at which half of the dry friction is compensated
  const float dry = p[Parameter::friction_coulomb] * speed / (magnitude(speed) + kCreep);
  const float friction = dry + p[Parameter::friction_viscous] * speed;
  return clamp((tension - friction) / p[Parameter::newton_per_ampere], 0.0f, current_limit);
}

}  // namespace firmware
}  // namespace tensionlab
