// Random numbers for the simulated hardware.
#pragma once

#include <cstdint>

namespace tensionlab {
namespace plant {

// Random numbers that are the same everywhere: xorshift64*.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : state_(seed * 2685821657736338717ull + 88172645463325252ull) {}

  double uniform() {  // 0 to 1
    state_ ^= state_ >> 12;
    state_ ^= state_ << 25;
    state_ ^= state_ >> 27;
    return static_cast<double>((state_ * 2685821657736338717ull) >> 11) * 0x1p-53;
  }

  // Near enough to a normal distribution, of standard deviation 1: four uniform numbers.
  double normal() { return (uniform() + uniform() + uniform() + uniform() - 2.0) * 1.7320508; }

 private:
  std::uint64_t state_;
};

}  // namespace plant
}  // namespace tensionlab
