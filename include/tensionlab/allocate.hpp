// Cable tensions for a wrench: allocate() and Allocator.
//
//   W t = w,  lower <= t <= upper,  |t - reference| least
//
// Where no tensions inside the limits render the wrench w, the policy chooses the substitute, and a direction d
// with d'w > d'W t for all tensions t inside the limits proves that there are none. The solver is the exact one of
// the Python package ("newton"), and each status is verified by the same code.
//
// C++17 and nothing else: no heap, no exceptions, no locks, no global state; storage is inside the Allocator. With
// N components and M cables at most, in float or double:
//
//   iterations  at most 2 iteration_limit + 4 N + 4, each a factorisation of N x N and a line search of at most
//               2 M + 8 sums over the cables; the tensions are inside the limits after any number of them
//   memory      sizeof(Allocator<Real, N, M>), and the stack of a call, which docs/reference/c-and-cpp.md lists
//   precision   EXACT: |w - W t| <= tolerance max(1, |w|), proved for the numbers as given, rounding included.
//               NEAREST: the direction separates, and the substitute is best to tolerance max(1, |W t|)
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "tensionlab/simd/batch.hpp"
#include "tensionlab/solvers/newton_batch.hpp"
#include "tensionlab/verification/certificates.hpp"

namespace tensionlab {

// What a precision allows: the tolerance of a proof; the share of the largest singular value of W below which
// another counts as zero; the magnitude that numbers must be below.
template <class Real>
struct Precision;
template <>
struct Precision<double> {
  static constexpr double tolerance = 1e-6, rank_tolerance = 1e-8, largest = 1e100;
};
template <>
struct Precision<float> {
  static constexpr float tolerance = 1e-3F, rank_tolerance = 1e-4F, largest = 1e6F;
};

inline namespace TENSIONLAB_BUILD {

template <class Real, int N, int M>
struct Allocation {
  Real tensions[M];    // inside the limits; the lower limits where the status is failed
  Real wrench[N];      // rendered: W t
  Real separation[N];  // where nearest: d; zeros elsewhere
  Real residual;       // weighted length of w - W t
  Real scale;          // 1 where exact; s of W t = s w for the direction policy; NaN elsewhere
  Status status;
  int iterations;
};

// Tensions for many wrenches with the same limits. Structure matrices are row by row, N x cables.
template <class Real, int N, int M>
class Allocator {
 public:
  static_assert(N >= 1 && N <= kMaxComponents && M >= 1 && M <= kMaxCables, "1 to 6 components, 1 to 32 cables");

  // May be changed between calls. weights: of the components, positive.
  int cables;
  Real lower[M], upper[M], reference[M] = {}, weights[N];
  Policy policy = Policy::force;
  Real tolerance = Precision<Real>::tolerance;
  int iteration_limit = Newton<Real, 1, N, M>::kIterationLimit;

  // Limits of `cable_count` cables, M at most.
  Allocator(const Real* lower_limits, const Real* upper_limits, int cable_count = M) : cables(cable_count) {
    for (int i = 0; i < cables; ++i) {
      lower[i] = lower_limits[i];
      upper[i] = upper_limits[i];
    }
    for (int k = 0; k < N; ++k) weights[k] = 1;
  }

  // The answer stays valid until the next call.
  const Allocation<Real, N, M>& operator()(const Real* structure, const Real* wrench) {
    const Problem<Real> problem{structure, wrench, lower, upper, reference};
    if (!valid(problem)) return fail();
    const BatchOf<Real> batch = batch_of_one<Real>(N, cables, problem, weights);
    std::int64_t iterations = 0;
    const NewtonAnswerOf<Real> answer{answer_.tensions, answer_.separation, &iterations};
    solver_.emplace(batch, policy, Precision<Real>::rank_tolerance, tolerance, answer, iteration_limit);
    solver_->solve({0, 1});
    const Verifier<Real, 1, N, M> verifier(cables, weights, rule_of(policy), tolerance,
                                           Precision<Real>::rank_tolerance);
    const auto finding = verifier.verify(problem, answer_.tensions, answer_.wrench, answer_.separation);
    if (finding.status == Status::failed) return fail();
    answer_.status = finding.status;
    answer_.residual = finding.residual;
    answer_.scale = finding.scale;
    answer_.iterations = static_cast<int>(iterations);
    return answer_;
  }

 private:
  // Whether all numbers are in range, the limits in order and the weights positive.
  bool valid(const Problem<Real>& problem) const {
    const auto in_range = [](Real number) { return std::abs(number) < Precision<Real>::largest; };
    bool good = cables >= 1 && cables <= M;
    for (int j = 0; good && j < N * cables; ++j) good = in_range(problem.structure[j]);
    for (int k = 0; good && k < N; ++k)
      good = in_range(problem.wrench[k]) && in_range(weights[k]) && weights[k] > 0;
    for (int i = 0; good && i < cables; ++i) {
      good = in_range(lower[i]) && in_range(upper[i]) && in_range(reference[i]) && lower[i] <= upper[i];
    }
    return good;
  }

  const Allocation<Real, N, M>& fail() {
    const Real nan = std::numeric_limits<Real>::quiet_NaN();
    for (int i = 0; i < cables && i < M; ++i) answer_.tensions[i] = lower[i];
    for (int k = 0; k < N; ++k) {
      answer_.wrench[k] = nan;
      answer_.separation[k] = 0;
    }
    answer_.residual = answer_.scale = nan;
    answer_.status = Status::failed;
    answer_.iterations = 0;
    return answer_;
  }

  Allocation<Real, N, M> answer_;
  std::optional<NewtonBatch<Real, 1, N, M, 1>> solver_;
};

// Tensions for one wrench. Its working memory is on the stack.
template <class Real, int N, int M>
Allocation<Real, N, M> allocate(const Real (&structure)[N * M], const Real (&wrench)[N], const Real (&lower)[M],
                                const Real (&upper)[M], Policy policy = Policy::force) {
  Allocator<Real, N, M> allocator(lower, upper);
  allocator.policy = policy;
  return allocator(structure, wrench);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
