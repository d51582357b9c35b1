// The servo that lays the brake's pawl on and lifts it.
#pragma once

#include <Arduino.h>

#include "board.hpp"

namespace tensionlab {
namespace firmware {

class BrakeServo {
 public:
  // It stays where it is until the first pulse.
  bool begin() { return ledcAttach(board::kServo, board::kServoRate, board::kServoBits); }

  void move(float pulse_us) {
    constexpr float kDutyPerMicrosecond = 1e-6f * static_cast<float>(board::kServoRate << board::kServoBits);
    const uint32_t duty = static_cast<uint32_t>(pulse_us * kDutyPerMicrosecond + 0.5f);
    if (duty == duty_) return;
    ledcWrite(board::kServo, duty);
    duty_ = duty;
  }

 private:
  uint32_t duty_ = 0;
};

}  // namespace firmware
}  // namespace tensionlab
