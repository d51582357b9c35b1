// Solvers that run on batches of problems in lanes, each compiled for several instruction sets
// (simd/instruction_set.hpp).
#pragma once

#include <cstddef>
#include <cstdint>

#include "simd/instruction_set.hpp"
#include "solvers/dual_laws.hpp"
#include "tensionlab/simd/batch.hpp"

namespace tensionlab {

// The exact solver's first attempt (solvers/sweep_kernel.cpp). Numbers not below `largest` in magnitude are
// refused; tolerance: the error of an exact answer.
struct SweepSettings {
  double largest, tolerance;
};

struct SweepAnswer {
  double *tensions, *separation, *rendered, *residual, *scale;
  std::int8_t* status;
  std::int64_t* iterations;
};

// Rows that a sweep leaves: most are infeasible. The answer's separation has a direction that may separate each.
struct SweepRemainder {
  std::size_t* rows;
  std::size_t count = 0;
  bool invalid = false;  // whether a number may be too large, or NaN
};

// Answers those of rows [begin, end) that are proved exact; the others are added to the remainder.
TENSIONLAB_KERNEL(sweep, const Batch&, const SweepSettings&, std::size_t begin, std::size_t end,
                  const SweepAnswer&, SweepRemainder&)

// The exact solver itself (solvers/newton_kernel.cpp). For the first `directed` rows the answer's separation
// already holds a direction that may separate the wrench; the direction policy does not use it.
TENSIONLAB_KERNEL(newton, const Batch&, Policy, double rank_tolerance, double tolerance, const Selection& rows,
                  std::size_t directed, const NewtonAnswer&)

// Iterative solvers (solvers/iterative_kernels.cpp).
struct IterativeAnswer {
  double* tensions;
  std::int64_t* iterations;
};

struct DykstraSettings {
  double tolerance, rank_tolerance;
  std::int64_t iteration_limit;
};

TENSIONLAB_KERNEL(dykstra, const Batch&, const DykstraSettings&, std::size_t begin, std::size_t end,
                  const IterativeAnswer&)
TENSIONLAB_KERNEL(log_barrier, const Batch&, std::size_t begin, std::size_t end, const IterativeAnswer&)
TENSIONLAB_KERNEL(slack_norm, const Batch&, const SlackPrices&, std::size_t begin, std::size_t end,
                  const IterativeAnswer&)
// The batch's weights are the prices of the rows over mu, as their roots.
TENSIONLAB_KERNEL(box_price, const Batch&, std::size_t begin, std::size_t end, const IterativeAnswer&)

// Tensions along a path (solvers/path.cpp), in the coordinates of each sample's null space, relative to the
// largest limit. Rows: upper limits, lower limits, rises and falls, (4 samples - 2, m).
struct PathConstraints {
  std::size_t samples, m, r;
  const double* basis;  // (samples, m, r), orthonormal columns or zeros
  const double* space;  // of each row, what the particular solution leaves of its bound
  const double* reach;  // (samples), largest norm of the coordinates inside the limits
  double relaxation;    // of every bound, but where the solution is polished
};

struct PathAnswer {
  double *coordinates, *multipliers;  // (samples, r), (4 samples - 2, m)
  double *polished_coordinates, *polished_multipliers;
  std::int64_t* iterations;
};

// One build: wider ones are no faster.
void allocate_path(const PathConstraints&, const PathAnswer&);

}  // namespace tensionlab
