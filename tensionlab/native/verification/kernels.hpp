// Certificates of a batch of answers (verification/certificates.cpp).
#pragma once

#include <atomic>
#include <cstdint>

#include "simd/instruction_set.hpp"
#include "tensionlab/simd/batch.hpp"

namespace tensionlab {

struct VerificationSettings {
  Rule rule;
  double tolerance, rank_tolerance;
};

// tensions and separation are read, and changed in place; flawed is set if any answer is proved neither exact nor
// nearest.
struct Findings {
  double *tensions, *separation, *rendered, *residual, *scale;
  std::int8_t* status;
  std::atomic<bool>* flawed;
};

TENSIONLAB_KERNEL(verify, const Batch&, const VerificationSettings&, const Selection& rows, const Findings&)

// Sets inside to false if a number is not below the limit in magnitude.
TENSIONLAB_KERNEL(check, const double* numbers, std::size_t count, double limit, bool& inside)

}  // namespace tensionlab
