// Bytes from one task to one other, without a lock: whoever writes never waits for whoever reads, nor the other
// way round.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <atomic>

namespace tensionlab {
namespace firmware {

// Both ends count the bytes that passed them. Each count is written by one task only; the release of a count by
// one task, and its acquisition by the other, order what was done to the bytes before.
// Source: Lamport, "Specifying concurrent program modules", 1983.
template <size_t kCapacity>
class ByteQueue {
  static_assert(kCapacity != 0 && (kCapacity & (kCapacity - 1)) == 0, "the counts wrap around: a power of two");

 public:
  // For the writing task: takes as many bytes as there is room for. Returns how many.
  size_t put(const uint8_t* bytes, size_t size) {
    const size_t in = in_.load(std::memory_order_relaxed);
    const size_t free = kCapacity - (in - out_.load(std::memory_order_acquire));
    const size_t count = size < free ? size : free;
    for (size_t i = 0; i < count; ++i) ring_[(in + i) % kCapacity] = bytes[i];
    in_.store(in + count, std::memory_order_release);
    return count;
  }

  size_t room() const {
    return kCapacity - (in_.load(std::memory_order_relaxed) - out_.load(std::memory_order_acquire));
  }

  // For the reading task: gives at most so many bytes. Returns how many.
  size_t take(uint8_t* bytes, size_t most) {
    const size_t out = out_.load(std::memory_order_relaxed);
    const size_t there = in_.load(std::memory_order_acquire) - out;
    const size_t count = most < there ? most : there;
    for (size_t i = 0; i < count; ++i) bytes[i] = ring_[(out + i) % kCapacity];
    out_.store(out + count, std::memory_order_release);
    return count;
  }

 private:
  uint8_t ring_[kCapacity];
  std::atomic<size_t> in_{0}, out_{0};
};

}  // namespace firmware
}  // namespace tensionlab
