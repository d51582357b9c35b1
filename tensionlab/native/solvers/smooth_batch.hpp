// What the solvers by dual ascent make of a batch, and the kernels that do it (solvers/smooth_kernel.cpp).
#pragma once

#include <cstdint>

#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"
#include "solvers/slack_norm.hpp"

namespace tensionlab {

struct SmoothAnswer {
  double* tensions;
  std::int64_t* iterations;
};

TENSIONLAB_KERNEL(log_barrier, const Batch&, std::size_t begin, std::size_t end, const SmoothAnswer&)
TENSIONLAB_KERNEL(slack_norm, const Batch&, const SlackPrices&, std::size_t begin, std::size_t end,
                  const SmoothAnswer&)
TENSIONLAB_KERNEL(box_price, const Batch&, const double* row_roots, std::size_t begin, std::size_t end,
                  const SmoothAnswer&)

}  // namespace tensionlab
