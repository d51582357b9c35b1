// Consistent overhead byte stuffing: any bytes become bytes without a zero, so that a zero can end a frame.
// Source: Cheshire and Baker, "Consistent overhead byte stuffing", 1999.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace tensionlab {
namespace firmware {

// Encodes at most 254 bytes; `out` needs one more. Returns the encoded size.
inline size_t cobs_encode(const uint8_t* bytes, size_t size, uint8_t* out) {
  size_t code_at = 0, next = 1;
  uint8_t code = 1;
  for (size_t i = 0; i < size; ++i) {
    if (bytes[i] != 0) {
      out[next++] = bytes[i];
      ++code;
    } else {
      out[code_at] = code;
      code_at = next++;
      code = 1;
    }
  }
  out[code_at] = code;
  return next;
}

// Decodes in place what `cobs_encode` may have made; returns the size, or 0 if it cannot have made this.
inline size_t cobs_decode(uint8_t* bytes, size_t size) {
  size_t next = 0, read = 0;
  while (read < size) {
    const size_t code = bytes[read++];
    if (code == 0 || read + code - 1 > size) return 0;
    for (size_t i = 1; i < code; ++i) {
      if (bytes[read] == 0) return 0;
      bytes[next++] = bytes[read++];
    }
    if (read < size) bytes[next++] = 0;
  }
  return next;
}

}  // namespace firmware
}  // namespace tensionlab
