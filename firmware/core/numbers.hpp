// Arithmetic that the core needs of its own, in single precision and without the maths library.
#pragma once

#include <stdint.h>
#include <string.h>

namespace tensionlab {
namespace firmware {

inline bool is_finite(float x) {
  uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  return (bits & 0x7F800000u) != 0x7F800000u;
}

inline float magnitude(float x) { return x < 0.0f ? -x : x; }
inline float smaller(float x, float y) { return x < y ? x : y; }
inline float larger(float x, float y) { return x > y ? x : y; }
// What is no number becomes the lower end.
inline float clamp(float x, float low, float high) { return x > low ? (x < high ? x : high) : low; }

// Square root by Newton's method, from a first guess that halves the exponent; 0 for nothing and for less.
inline float square_root(float x) {
  if (!(x > 0.0f)) return 0.0f;
  uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  bits = (bits >> 1) + 0x1FBD1DF5u;
  float root;
  memcpy(&root, &bits, sizeof root);
  for (int round = 0; round < 3; ++round) root = 0.5f * (root + x / root);
  return root;
}

// Natural logarithm of a normal number above 0, off by at most 1e-6 of it or of 1.
inline float natural_logarithm(float x) {
  uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  const uint32_t shifted = bits - 0x3F3504F3u;  // below 1 / sqrt(2): so the rest lies around 1
  const int32_t exponent = static_cast<int32_t>(shifted) >> 23;
  bits -= static_cast<uint32_t>(exponent) << 23;
  float rest;
  memcpy(&rest, &bits, sizeof rest);
  const float s = (rest - 1.0f) / (rest + 1.0f), square = s * s;
  const float series = 1.0f + square * (1.0f / 3.0f + square * (1.0f / 5.0f + square * (1.0f / 7.0f)));
  return 0.69314718f * static_cast<float>(exponent) + 2.0f * s * series;
}

// Sine of a whole turn times `turns`, for 0 <= turns < 1; off by at most 1e-5.
inline float sine_of_turns(float turns) {
  const float half = turns < 0.5f ? turns : turns - 0.5f;
  const float x = 4.0f * half - 1.0f;  // -1 to 1 over half a turn; the sine of it is the cosine of a quarter turn
  const float square = x * x;
  const float cosine = 1.0f + square * (-1.2335417f + square * (0.2526978f - square * 0.0191639f));
  return turns < 0.5f ? cosine : -cosine;
}

// Microseconds from one reading of the clock to another, which may have wrapped around in between.
inline int32_t since(uint32_t now_us, uint32_t then_us) { return static_cast<int32_t>(now_us - then_us); }

}  // namespace firmware
}  // namespace tensionlab
