// The encoder AS5048A, as its data sheet says that it answers.
#pragma once

#include <cstdint>

namespace tensionlab {
namespace plant {

struct EncoderChip {
  std::uint16_t angle = 0, diagnostics = 0x0180, magnitude = 3000;
  bool error = false;
  std::uint16_t next = 0;

  static std::uint16_t with_parity(int bits) {
    return static_cast<std::uint16_t>(bits | (__builtin_parity(static_cast<unsigned>(bits)) << 15));
  }

  std::uint16_t exchange(std::uint16_t frame) {
    const std::uint16_t answer = with_parity(next | (error ? 0x4000 : 0));
    const int address = frame & 0x3FFF;
    if (__builtin_parity(frame) != 0 || (frame & 0x4000) == 0) {
      error = true;
      next = 0;
    } else if (address == 0x0001) {
      error = false;
      next = 0;
    } else {
      next = address == 0x3FFF ? angle : (address == 0x3FFE ? magnitude : (address == 0x3FFD ? diagnostics : 0));
    }
    return answer;
  }
};

}  // namespace plant
}  // namespace tensionlab
