// A batch of problems as the Python side passes it, and its way through the lanes of a solver.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "tensionlab/simd/lanes.hpp"

namespace tensionlab {

constexpr int kMaxComponents = 6;
constexpr int kMaxCables = 32;

// Routes that only save time. benchmarks/ablation.py builds the module without one, by the bits of
// TENSIONLAB_WITHOUT, to measure its gain.
#if !defined(TENSIONLAB_WITHOUT)
#define TENSIONLAB_WITHOUT 0
#endif
enum class Route { sweep, guess, separation_in_sweep, nearest_face, proof_in_face, null_plane, gram_schmidt };
constexpr bool has(Route route) { return (TENSIONLAB_WITHOUT >> static_cast<int>(route) & 1) == 0; }

// What to render where the wrench is infeasible.
enum class Policy { force, tension, direction };
constexpr int kPolicies = 3;

// What is proved of an answer (verification/certificates.hpp). failed: a number was not finite or too large.
enum class Status : std::int8_t { exact = 0, nearest = 1, unproven = 2, failed = 3 };

// How verification judges the error of an infeasible wrench: not at all, or as the policy demands.
enum class Rule { none, force, tension, direction };
constexpr Rule rule_of(Policy policy) { return static_cast<Rule>(1 + static_cast<int>(policy)); }

// Arrays of one problem, each contiguous: structure (n x m, row by row), wrench (n), limits and reference (m).
template <class Real>
struct Problem {
  const Real *structure, *wrench, *lower, *upper, *reference;
};

// Rows of a (B, ...) array whose inner axes are contiguous; stride 0 repeats one row.
template <class Real>
struct RowsOf {
  const Real* data;
  std::ptrdiff_t stride;
  TENSIONLAB_INLINE const Real* operator[](std::size_t row) const {
    return data + static_cast<std::ptrdiff_t>(row) * stride;
  }
};

template <class Real>
struct BatchOf {
  std::size_t size;
  int n, m;
  RowsOf<Real> structure, wrench, lower, upper, reference;
  const Real* weights;
  TENSIONLAB_INLINE Problem<Real> operator[](std::size_t row) const {
    return {structure[row], wrench[row], lower[row], upper[row], reference[row]};
  }
};

template <class Real>
constexpr BatchOf<Real> batch_of_one(int n, int m, const Problem<Real>& problem, const Real* weights) {
  return {1,
          n,
          m,
          {problem.structure, 0},
          {problem.wrench, 0},
          {problem.lower, 0},
          {problem.upper, 0},
          {problem.reference, 0},
          weights};
}

// Answers of the exact solver to a batch.
template <class Real>
struct NewtonAnswerOf {
  Real* tensions;
  Real* separation;
  std::int64_t* iterations;
  // Written for answers that are proved nearest on the way: status 1, and what verification would find. If null,
  // nothing is proved.
  std::int8_t* status = nullptr;
  Real *rendered = nullptr, *residual = nullptr, *scale = nullptr;
};

using Rows = RowsOf<double>;
using Batch = BatchOf<double>;
using NewtonAnswer = NewtonAnswerOf<double>;

// Rows of a batch: `count` of them from `first` on, or those of a list.
struct Selection {
  std::size_t first, count;
  const std::size_t* list = nullptr;
  TENSIONLAB_INLINE std::size_t operator[](std::size_t j) const { return list == nullptr ? first + j : list[j]; }
};

// Throws when the batch of the calling thread must end: another thread failed, or Python has a signal to handle.
// Long work on one row calls it now and then.
void checkpoint();

inline namespace TENSIONLAB_BUILD {

// Whether batches can be interrupted: those of the kernels, but not those of a program of its own.
#if defined(TENSIONLAB_LANES)
constexpr bool kInterruptible = true;
#else
constexpr bool kInterruptible = false;
#endif

// Calls f with n, from 1 to kMost, as a constant that may be a template argument.
template <int kMost = kMaxComponents, class F>
void with_size(int n, const F& f) {
  if constexpr (kMost > 1) {
    if (n < kMost) return with_size<kMost - 1>(n, f);
  }
  f(std::integral_constant<int, kMost>{});
}

// Solves rows [begin, end) in the lanes of a block. A lane that is done takes the next row at once, so that hard
// problems never hold up easy ones. block: step() advances every lane, finished(l) tells whether lane l is done,
// idle(l) gives it an empty problem. load(l, row) gives lane l a row's problem; store(l, row) takes its answer.
template <int L, class Block, class Load, class Store>
void refill(Block& block, std::size_t begin, std::size_t end, const Load& load, const Store& store) {
  std::size_t row[L], next = begin;
  int busy = 0;
  for (int l = 0; l < L; ++l) {
    row[l] = end;
    if (next == end) continue;
    load(l, next);
    row[l] = next++;
    ++busy;
  }
  for (unsigned steps = 1; busy > 0; ++steps) {
    if constexpr (kInterruptible) {
      if (steps % 1024 == 0) checkpoint();
    }
    block.step();
    for (int l = 0; l < L; ++l) {
      if (row[l] == end || !block.finished(l)) continue;
      store(l, row[l]);
      if (next < end) {
        load(l, next);
        row[l] = next++;
      } else {
        row[l] = end;
        block.idle(l);
        --busy;
      }
    }
  }
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
