// The interface in C: the solver of Python's allocate(), without Python.
#include "tensionlab.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "solvers/block_solver.hpp"

namespace tensionlab {

void checkpoint() {}  // nothing interrupts a call

namespace {

// As in tensionlab/support/arrays.py and tensionlab/solvers/base.py.
constexpr double kLargest = 1e100, kTolerance = 1e-6, kRankTolerance = 1e-8;

bool in_range(const double* numbers, int count) {
  return std::all_of(numbers, numbers + count, [](double number) { return std::abs(number) < kLargest; });
}

}  // namespace
}  // namespace tensionlab

extern "C" int tensionlab_allocate(int n, int m, const double* structure, const double* wrench,
                                   const double* lower, const double* upper, const double* reference,
                                   const double* weights, int policy, double* tensions,
                                   tensionlab_result* result) {
  using namespace tensionlab;
  if (n < 1 || n > kMaxComponents || m < 1 || m > kMaxCables || policy < 0 || policy >= kPolicies) {
    return TENSIONLAB_INVALID;
  }
  const double zeros[kMaxCables] = {}, ones[kMaxComponents] = {1, 1, 1, 1, 1, 1};
  if (reference == nullptr) reference = zeros;
  if (weights == nullptr) weights = ones;
  bool valid = in_range(structure, n * m) && in_range(wrench, n) && in_range(lower, m) && in_range(upper, m) &&
               in_range(reference, m) && in_range(weights, n);
  for (int i = 0; i < m; ++i) valid = valid && lower[i] <= upper[i];
  for (int k = 0; k < n; ++k) valid = valid && weights[k] > 0;
  if (!valid) return TENSIONLAB_INVALID;
  if (instruction_set() == InstructionSet::none) return TENSIONLAB_FAILED;
  tensionlab_result unused;
  if (result == nullptr) result = &unused;
  std::int8_t status;
  std::int64_t iterations;
  std::atomic<bool> flawed{false};
  const SweepAnswer answer{tensions, result->separation, result->wrench, &result->residual, &result->scale,
                           &status,  &iterations};
  const Batch batch = batch_of_one(n, m, Problem<double>{structure, wrench, lower, upper, reference}, weights);
  BlockSolver<1>(batch, {rule_of(static_cast<Policy>(policy)), kLargest, kTolerance, kRankTolerance}, answer,
                 flawed)
      .solve(0, 1);
  result->iterations = static_cast<int>(iterations);
  return status;
}

extern "C" const char* tensionlab_version(void) { return TENSIONLAB_VERSION; }
