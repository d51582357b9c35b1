// The first attempt at a batch, and the kernel that does it (solvers/sweep_kernel.cpp).
#pragma once

#include <cstddef>
#include <cstdint>

#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"

namespace tensionlab {

// Numbers not below `largest` in magnitude are none for a solver; tolerance: the error of an exact answer.
struct SweepSettings {
  double largest, tolerance;
};

// Rows that a sweep leaves to others: those of which it has shown that their wrench is out of reach, with a
// direction that separates it in the answer's separation, and those of which it knows nothing.
struct SweepRest {
  std::size_t *apart, *unsure;
  std::size_t aparts = 0, unsures = 0;
  bool strange = false;  // whether a number may be too large, or none
};

struct SweepAnswer {
  double *tensions, *separation, *rendered, *residual, *scale;
  std::int8_t* status;
  std::int64_t* iterations;
};

// Answers what is proved exact of rows [begin, end); the others go to the rest, which grows.
TENSIONLAB_KERNEL(sweep, const Batch&, const SweepSettings&, std::size_t begin, std::size_t end,
                  const SweepAnswer&, SweepRest& rest)

}  // namespace tensionlab
