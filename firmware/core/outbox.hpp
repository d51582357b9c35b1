// Frames that wait to be sent: a ring of bytes that takes a frame whole or not at all.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace tensionlab {
namespace firmware {

class Outbox {
 public:
  // Takes a frame if `spare` bytes stay free; else it is lost, and counted.
  void put(const uint8_t* bytes, size_t size, size_t spare) {
    if (size + spare > kCapacity - used_) {
      if (lost_ != 0xFFFF) ++lost_;
      return;
    }
    for (size_t i = 0; i < size; ++i) ring_[(first_ + used_ + i) % kCapacity] = bytes[i];
    used_ += size;
  }

  void clear() { used_ = 0; }

  // Moves at most `room` bytes out. Returns how many.
  size_t take(uint8_t* bytes, size_t room) {
    const size_t count = used_ < room ? used_ : room;
    for (size_t i = 0; i < count; ++i) bytes[i] = ring_[(first_ + i) % kCapacity];
    first_ = (first_ + count) % kCapacity;
    used_ -= count;
    return count;
  }

  uint16_t lost() const { return lost_; }

 private:
  static constexpr size_t kCapacity = 512;

  uint8_t ring_[kCapacity];
  size_t first_ = 0, used_ = 0;
  uint16_t lost_ = 0;
};

}  // namespace firmware
}  // namespace tensionlab
