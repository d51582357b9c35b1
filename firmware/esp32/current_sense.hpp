// The currents of two phases, with a limit on how long the converter may take, and offsets that are followed.
#pragma once

#include <Arduino.h>
#include <SimpleFOC.h>
#include <soc/sens_reg.h>

#include "board.hpp"

namespace tensionlab {
namespace firmware {

// Reads a pin of the first converter, which the motor library has set up. The library's own reading waits for ever
// where the converter does not answer; this one gives up. Returns whether it came, and then the voltage.
inline bool convert(board::Pin pin, float& volts) {
  constexpr float kVoltsPerCount = 3.3f / 4095.0f;
  const uint32_t pad = 1u << digitalPinToAnalogChannel(pin);
  CLEAR_PERI_REG_MASK(SENS_SAR_MEAS_START1_REG, SENS_MEAS1_START_SAR_M);
  SET_PERI_REG_BITS(SENS_SAR_MEAS_START1_REG, SENS_SAR1_EN_PAD, pad, SENS_SAR1_EN_PAD_S);
  SET_PERI_REG_MASK(SENS_SAR_MEAS_START1_REG, SENS_MEAS1_START_SAR_M);
  const uint32_t begin_us = static_cast<uint32_t>(micros());
  while (GET_PERI_REG_MASK(SENS_SAR_MEAS_START1_REG, SENS_MEAS1_DONE_SAR) == 0) {
    if (static_cast<uint32_t>(micros()) - begin_us > board::kConversionTime) return false;
  }
  const uint32_t count = GET_PERI_REG_BITS2(SENS_SAR_MEAS_START1_REG, SENS_MEAS1_DATA_SAR, SENS_MEAS1_DATA_SAR_S);
  volts = kVoltsPerCount * static_cast<float>(count);
  return true;
}

class CurrentSensor : public InlineCurrentSense {
 public:
  CurrentSensor() : InlineCurrentSense(board::kVoltsPerAmpere, 1.0f, board::kSenseA, board::kSenseB) {}

  // Where the converter does not answer, the last currents stay.
  PhaseCurrent_s getPhaseCurrents() override {
    float a = 0.0f, b = 0.0f;
    ok_ = convert(board::kSenseA, a) && convert(board::kSenseB, b);
    if (ok_) last_ = {(a - offset_ia) * gain_a, (b - offset_ib) * gain_b, 0.0f};
    return last_;
  }

  // With the driver off no current flows: what is measured is offset. It moves when the radio starts, by some 25
  // mV of the converter's, which would be 4 % of 3 N.
  void follow_offsets() {
    const PhaseCurrent_s current = getPhaseCurrents();
    if (!ok_) return;
    offset_ia += kShare * current.a / gain_a;
    offset_ib += kShare * current.b / gain_b;
  }

  bool ok() const { return ok_; }

 private:
  static constexpr float kShare = 1.0f / 256.0f;  // of a turn: settled in a fraction of a second

  PhaseCurrent_s last_ = {0.0f, 0.0f, 0.0f};
  bool ok_ = true;
};

}  // namespace firmware
}  // namespace tensionlab
