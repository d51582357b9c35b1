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
  // Of answers that are proved nearest in passing: status 1, and the rest of what is found about them
  // (verification/certificates_batch.hpp). Others are left as they are. Null: nothing is proved.
  std::int8_t* status = nullptr;
  double *rendered = nullptr, *residual = nullptr, *scale = nullptr;
};

// Of the first `apart` rows a direction that separates is known, in the answer's separation; the direction policy
// makes nothing of it.
TENSIONLAB_KERNEL(newton, const Batch&, Policy, double rank_tolerance, double tolerance, const Selection& rows,
                  std::size_t apart, const NewtonAnswer&)

}  // namespace tensionlab
