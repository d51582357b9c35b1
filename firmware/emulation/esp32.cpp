// The bench on an emulated Xtensa with the ESP32's instructions (qemu-system-xtensa -M sim -cpu de233_fpu): what
// the compiler's own library has on the module, in whole numbers and rounded as IEEE says.
//
// Division and square root take some 250 instructions here, and some 30 on the module, whose floating point unit
// has the first steps of both: the counts are upper bounds. An instruction takes 32 ns of the emulated
// clock, and a cycle 25.
#include <cstddef>
#include <cstdint>

namespace {

union Word {
  float number;
  uint32_t bits;
};

constexpr uint32_t kFraction = 0x7FFFFF, kOne = kFraction + 1, kInfinity = 0x7F800000, kNaN = 0x7FC00000;

float from_bits(uint32_t bits) {
  Word word;
  word.bits = bits;
  return word.number;
}

// The fraction with its leading one, and the exponent that goes with it. Not for zero.
uint32_t normalise(uint32_t bits, int& exponent) {
  exponent = static_cast<int>(bits >> 23 & 255);
  uint32_t fraction = bits & kFraction;
  if (exponent != 0) return fraction | kOne;
  exponent = 1;
  while (fraction < kOne) {
    fraction <<= 1;
    --exponent;
  }
  return fraction;
}

// To the nearest, ties to even: the last two bits of q are to be rounded.
uint32_t round(uint32_t q) {
  const uint32_t rest = q & 3;
  q >>= 2;
  return rest == 3 || (rest == 2 && (q & 1) != 0) ? q + 1 : q;
}

}  // namespace

extern "C" {

int bench(void);
void sim_write(const char* text, unsigned size);
uint32_t cycle_count(void);
uint32_t platform_instructions(uint32_t ticks) { return ticks * 25 / 32; }
extern unsigned char* const platform_stack_end = reinterpret_cast<unsigned char*>(0x3F0000);  // it begins at 4 MiB
uint32_t platform_ticks(void) { return cycle_count(); }
void platform_write(const char* text, unsigned size) { sim_write(text, size); }

float __divsf3(float numerator, float denominator) {
  Word x, y;
  x.number = numerator;
  y.number = denominator;
  const uint32_t sign = (x.bits ^ y.bits) & ~(kInfinity | kFraction);
  const uint32_t a = x.bits & ~(1U << 31), b = y.bits & ~(1U << 31);
  if (a > kInfinity || b > kInfinity || (a == kInfinity && b == kInfinity) || (a == 0 && b == 0)) {
    return from_bits(kNaN);
  }
  if (a == kInfinity || b == 0) return from_bits(sign | kInfinity);
  if (b == kInfinity || a == 0) return from_bits(sign);
  int exponent, other;
  uint32_t rest = normalise(a, exponent), q = 0;
  const uint32_t divisor = normalise(b, other);
  exponent += 127 - other;
  if (rest < divisor) {
    rest <<= 1;
    --exponent;
  }
  for (int i = 0; i < 26; ++i) {  // 24 bits and two to round by
    q <<= 1;
    if (rest >= divisor) {
      rest -= divisor;
      q |= 1;
    }
    rest <<= 1;
  }
  if (rest != 0) q |= 1;
  if (exponent <= 0) {  // subnormal
    const int shift = 1 - exponent > 27 ? 27 : 1 - exponent;
    const uint32_t lost = (q & ((1U << shift) - 1)) != 0 ? 1 : 0;
    return from_bits(sign | round(q >> shift | lost));
  }
  q = round(q) + (static_cast<uint32_t>(exponent - 1) << 23);
  return from_bits(sign | (q >= kInfinity ? kInfinity : q));
}

float sqrtf(float number) {
  Word x;
  x.number = number;
  if (x.bits << 1 == 0 || x.bits == kInfinity) return number;
  if (x.bits > kInfinity) return from_bits(kNaN);
  int exponent;
  uint32_t radicand = normalise(x.bits, exponent), root = 0, rest = 0;
  exponent -= 127;
  if ((exponent & 1) != 0) {
    radicand <<= 1;
    --exponent;
  }
  for (int i = 0; i < 25; ++i) {  // of radicand times 2^25, two bits at a time: 24 bits and one to round by
    const uint32_t next = i < 12 ? radicand >> (23 - 2 * i) & 3 : i == 12 ? (radicand & 1) << 1 : 0;
    const uint32_t trial = root << 2 | 1;
    rest = rest << 2 | next;
    root <<= 1;
    if (rest >= trial) {
      rest -= trial;
      root |= 1;
    }
  }
  return from_bits((static_cast<uint32_t>(exponent / 2 + 127 - 1) << 23) + round(root << 1 | (rest != 0 ? 1 : 0)));
}

// Bytes through volatile, or the compiler would make calls of these functions out of them.
void* memcpy(void* to, const void* from, size_t size) {
  for (size_t i = 0; i < size; ++i) static_cast<volatile char*>(to)[i] = static_cast<const char*>(from)[i];
  return to;
}

void* memmove(void* to, const void* from, size_t size) {
  if (to < from) return memcpy(to, from, size);
  while (size-- > 0) static_cast<volatile char*>(to)[size] = static_cast<const char*>(from)[size];
  return to;
}

void* memset(void* to, int value, size_t size) {
  for (size_t i = 0; i < size; ++i) static_cast<volatile char*>(to)[i] = static_cast<char>(value);
  return to;
}
}
