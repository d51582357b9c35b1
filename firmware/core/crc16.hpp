// CRC-16/IBM-3740: polynomial 0x1021, start 0xFFFF, nothing reflected. The check value of "123456789" is 0x29B1.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace tensionlab {
namespace firmware {

inline uint16_t crc16(const uint8_t* bytes, size_t size) {
  uint16_t crc = 0xFFFF;
  for (size_t i = 0; i < size; ++i) {
    crc = static_cast<uint16_t>(crc ^ (bytes[i] << 8));
    for (int bit = 0; bit < 8; ++bit) {
      crc = static_cast<uint16_t>((crc & 0x8000) != 0 ? (crc << 1) ^ 0x1021 : crc << 1);
    }
  }
  return crc;
}

}  // namespace firmware
}  // namespace tensionlab
