// What the exact solver makes of a batch, and the kernel that does it (solvers/newton_kernel.cpp).
#pragma once

#include <cstdint>

#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"
#include "solvers/policy.hpp"

namespace tensionlab {

struct NewtonAnswer {
  double* tensions;
  double* separation;
  std::int64_t* iterations;
};

TENSIONLAB_KERNEL(newton, const Batch&, Policy, double rank_tolerance, double tolerance, std::size_t begin,
                  std::size_t end, const NewtonAnswer&)

}  // namespace tensionlab
