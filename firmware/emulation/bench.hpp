// What the benches share: services of the platform, text, random numbers, a hash, counts, and the depth of the
// stack.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>

// The platform counts in ticks, of which 24 bits are valid, and knows how many instructions they are.
extern "C" {
int bench(void);
uint32_t platform_ticks(void);
uint32_t platform_instructions(uint32_t ticks);
void platform_write(const char* text, unsigned size);
extern unsigned char* const platform_stack_end;  // lowest address; null where the stack cannot be looked at
}

namespace tensionlab {
namespace emulation {

inline void print(const char* name, uint32_t number, const char* suffix = "") {
  char text[64];
  unsigned size = 0;
  for (const char* word : {name, suffix}) {
    while (*word != 0) text[size++] = *word++;
  }
  text[size++] = ' ';
  char digits[10];
  int count = 0;
  do {
    digits[count++] = static_cast<char>('0' + number % 10);
    number /= 10;
  } while (number > 0);
  while (count > 0) text[size++] = digits[--count];
  text[size++] = '\n';
  platform_write(text, size);
}

class Random {
 public:
  uint32_t bits() {
    state_ ^= state_ << 13;
    state_ ^= state_ >> 17;
    return state_ ^= state_ << 5;
  }
  int below(int count) { return static_cast<int>((bits() >> 8) % static_cast<uint32_t>(count)); }
  bool once_in(int count) { return below(count) == 0; }
  float uniform(float least, float most) {
    return least + (most - least) * static_cast<float>(bits() >> 8) / 16777216.0F;
  }

 private:
  uint32_t state_ = 2463534242U;
};

class Hash {
 public:
  void add(const void* bytes, size_t size) {
    for (size_t i = 0; i < size; ++i) value_ = (value_ ^ static_cast<const uint8_t*>(bytes)[i]) * 16777619U;
  }
  uint32_t value() const { return value_; }

 private:
  uint32_t value_ = 2166136261U;
};

inline uint32_t ticks_since(uint32_t begin) { return (platform_ticks() - begin) & 0xFFFFFFU; }

// The stack is filled first; what differs later was used.
constexpr unsigned char kUnused = 0xA5;
constexpr size_t kReserve = 512;  // of the function that fills

__attribute__((noinline)) inline void fill_stack() {
  if (platform_stack_end == nullptr) return;
  unsigned char* const top = static_cast<unsigned char*>(__builtin_frame_address(0)) - kReserve;
  for (unsigned char* place = platform_stack_end; place < top; ++place)
    *static_cast<volatile unsigned char*>(place) = kUnused;
}

// Bytes below the frame of the function that calls the measured code.
__attribute__((noinline)) inline uint32_t used_stack(const void* caller) {
  if (platform_stack_end == nullptr) return 0;
  const unsigned char* const top = static_cast<const unsigned char*>(caller);
  const unsigned char* place = platform_stack_end;
  while (place < top && *static_cast<const volatile unsigned char*>(place) == kUnused) ++place;
  return static_cast<uint32_t>(top - place);
}

}  // namespace emulation
}  // namespace tensionlab
