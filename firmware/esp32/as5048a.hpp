// The magnetic encoder AS5048A: its frames, its complaints, and its turns counted.
//
// A frame has 16 bits each way: parity (even), read or error flag, 14 bits of address or data. What a command asks
// for comes with the next frame. Source: ams, "AS5048A/AS5048B magnetic rotary encoder", data sheet, 2014.
#pragma once

#include <stdint.h>

namespace tensionlab {
namespace firmware {

class As5048a {
 public:
  static constexpr int32_t kCountsPerTurn = 16384;

  // Asks for the angle, and in turn for the diagnostics and the magnitude. transfer(uint16_t) sends a frame and
  // returns what came meanwhile. Returns whether the angle came without an error, from a magnet in range.
  template <class Transfer>
  bool read(const Transfer& transfer) {
    // With this frame comes what the last frame of the previous call asked for; with the next one the angle.
    const bool told = note(asked_, transfer(command(kAngle)));
    asked_ = complains_ ? kClearError : (asked_ == kDiagnostics ? kMagnitude : kDiagnostics);
    const uint16_t answer = transfer(command(asked_));
    if (!good(answer)) return false;
    count_turns(answer & kData);
    return told && magnet_ok();
  }

  int32_t count() const { return count_; }                             // over all turns, from the first angle on
  uint16_t raw() const { return raw_; }                                // within the turn
  uint16_t magnitude() const { return magnitude_; }                    // of the field
  uint8_t gain() const { return static_cast<uint8_t>(diagnostics_); }  // 255: the field is weak, 0: it is strong
  uint16_t errors() const { return errors_; }  // frames with a wrong parity or an error flag

  // Offsets found, no overflow, the field neither too strong nor too weak; false until the chip said so. A data
  // line that is stuck says no as well.
  bool magnet_ok() const { return (diagnostics_ & 0x0F00) == kOffsetsFound; }

 private:
  static constexpr uint16_t kAngle = 0x3FFF, kMagnitude = 0x3FFE, kDiagnostics = 0x3FFD, kClearError = 0x0001;
  static constexpr uint16_t kRead = 0x4000, kError = 0x4000, kData = 0x3FFF;
  static constexpr uint16_t kOffsetsFound = 0x0100;  // and not overflow 0x0200, strong 0x0400, weak 0x0800

  static uint16_t odd(uint16_t bits) {
    for (int half = 8; half > 0; half /= 2) bits = static_cast<uint16_t>(bits ^ (bits >> half));
    return bits & 1;
  }

  static uint16_t command(uint16_t address) {
    const uint16_t asked = kRead | address;
    return static_cast<uint16_t>(asked | (odd(asked) << 15));
  }

  bool good(uint16_t answer) {
    complains_ = (answer & kError) != 0;
    if (!complains_ && odd(answer) == 0) return true;
    if (errors_ != 0xFFFF) ++errors_;
    return false;
  }

  bool note(uint16_t asked, uint16_t answer) {
    if (!good(answer)) return false;
    if (asked == kDiagnostics) diagnostics_ = answer & kData;
    if (asked == kMagnitude) magnitude_ = answer & kData;
    return true;
  }

  // The way from angle to angle is the shorter one: right as long as a turn takes more than two readings.
  void count_turns(uint16_t raw) {
    int32_t way = started_ ? raw - raw_ : raw;
    if (started_ && way >= kCountsPerTurn / 2) way -= kCountsPerTurn;
    if (started_ && way < -kCountsPerTurn / 2) way += kCountsPerTurn;
    count_ += way;
    raw_ = raw;
    started_ = true;
  }

  uint16_t asked_ = kClearError;
  bool complains_ = false, started_ = false;
  uint16_t raw_ = 0, magnitude_ = 0, diagnostics_ = 0, errors_ = 0;
  int32_t count_ = 0;
};

}  // namespace firmware
}  // namespace tensionlab
