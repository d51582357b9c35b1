// What Dykstra's projections make of a batch, and the kernel that does it (solvers/dykstra_kernel.cpp).
#pragma once

#include <cstdint>

#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"

namespace tensionlab {

struct DykstraSettings {
  double tolerance, rank_tolerance;
  std::int64_t iteration_limit;
};

struct DykstraAnswer {
  double* tensions;
  std::int64_t* iterations;
};

TENSIONLAB_KERNEL(dykstra, const Batch&, const DykstraSettings&, std::size_t begin, std::size_t end,
                  const DykstraAnswer&)

}  // namespace tensionlab
