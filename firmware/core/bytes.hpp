// Numbers to bytes and back, little-endian, whatever the processor's own order.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <string.h>

namespace tensionlab {
namespace firmware {

// Reads a payload from front to back. A read beyond its end yields zero and is remembered.
class Reader {
 public:
  Reader(const uint8_t* bytes, size_t size) : bytes_(bytes), left_(size) {}

  uint8_t u8() { return static_cast<uint8_t>(number(1)); }
  uint16_t u16() { return static_cast<uint16_t>(number(2)); }
  uint32_t u32() { return number(4); }
  float f32() {
    const uint32_t bits = number(4);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
  }

  // Whether all bytes were read, and no more than those.
  bool exhausted() const { return left_ == 0 && !beyond_; }

 private:
  uint32_t number(size_t size) {
    if (size > left_) {
      beyond_ = true;
      return 0;
    }
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) value |= static_cast<uint32_t>(bytes_[i]) << (8 * i);
    bytes_ += size;
    left_ -= size;
    return value;
  }

  const uint8_t* bytes_;
  size_t left_;
  bool beyond_ = false;
};

// Writes a payload from front to back; its owner makes it large enough.
class Writer {
 public:
  explicit Writer(uint8_t* bytes) : begin_(bytes), next_(bytes) {}

  void u8(uint8_t value) { number(value, 1); }
  void u16(uint16_t value) { number(value, 2); }
  void u32(uint32_t value) { number(value, 4); }
  void f32(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    number(bits, 4);
  }
  void raw(const uint8_t* bytes, size_t size) {
    memcpy(next_, bytes, size);
    next_ += size;
  }

  size_t size() const { return static_cast<size_t>(next_ - begin_); }

 private:
  void number(uint32_t value, size_t size) {
    for (size_t i = 0; i < size; ++i) *next_++ = static_cast<uint8_t>(value >> (8 * i));
  }

  uint8_t* begin_;
  uint8_t* next_;
};

}  // namespace firmware
}  // namespace tensionlab
