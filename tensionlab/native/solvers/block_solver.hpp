// The exact solver with its verification, block by block, so that verification finds the numbers in the cache,
// where the solver left them.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "solvers/kernels.hpp"
#include "verification/kernels.hpp"

namespace tensionlab {

// Numbers not below `largest` in magnitude are refused; tolerance: the error of an exact answer.
struct AllocationSettings {
  Rule rule;
  double largest, tolerance, rank_tolerance;

  VerificationSettings verification() const { return {rule, tolerance, rank_tolerance}; }
  // The policy to solve for; that of the nearest force where the rule is none.
  Policy policy() const {
    return rule == Rule::none ? Policy::force : static_cast<Policy>(static_cast<int>(rule) - 1);
  }
};

// Whether all entries of structure matrices and wrenches are below the limit in magnitude.
inline bool all_within(const Batch& batch, const Selection& rows, double limit) {
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  const auto inside = [&](double number) { return std::abs(number) < limit; };
  for (std::size_t j = 0; j < rows.count; ++j) {
    const double *structure = batch.structure[rows[j]], *wrench = batch.wrench[rows[j]];
    if (!std::all_of(structure, structure + n * m, inside) || !std::all_of(wrench, wrench + n, inside))
      return false;
  }
  return true;
}

// Solves and verifies blocks of rows: a sweep, and Newton steps for those that it leaves. One for each thread.
template <std::size_t kBlock = 512>
class BlockSolver {
 public:
  BlockSolver(const Batch& batch, const AllocationSettings& settings, const SweepAnswer& answer,
              std::atomic<bool>& flawed)
      : batch_(batch), settings_(settings), answer_(answer), flawed_(flawed) {}

  // Rows [begin, end), a block at most; returns false if an entry of a structure matrix or a wrench is NaN or too
  // large.
  bool solve(std::size_t begin, std::size_t end) {
    SweepRemainder remainder{rows_};
    if (has(Route::sweep)) {
      sweep_for_this_processor()(batch_, {settings_.largest, settings_.tolerance}, begin, end, answer_, remainder);
    } else {
      remainder.invalid = true;
      for (std::size_t row = begin; row < end; ++row) rows_[remainder.count++] = row;
    }
    const Selection rest{0, remainder.count, rows_};
    if (rest.count == 0) return true;
    if (remainder.invalid && !all_within(batch_, rest, settings_.largest)) return false;
    for (std::size_t j = 0; j < rest.count; ++j) answer_.status[rows_[j]] = kUnverified;
    newton_for_this_processor()(batch_, settings_.policy(), settings_.rank_tolerance, settings_.tolerance, rest,
                                has(Route::sweep) && has(Route::separation_in_sweep) ? rest.count : 0,
                                {answer_.tensions, answer_.separation, answer_.iterations, answer_.status,
                                 answer_.rendered, answer_.residual, answer_.scale});
    std::size_t* const unverified_end = std::remove_if(
        rows_, rows_ + rest.count, [&](std::size_t row) { return answer_.status[row] != kUnverified; });
    verify_for_this_processor()(batch_, settings_.verification(),
                                {0, static_cast<std::size_t>(unverified_end - rows_), rows_},
                                {answer_.tensions, answer_.separation, answer_.rendered, answer_.residual,
                                 answer_.scale, answer_.status, &flawed_});
    return true;
  }

 private:
  static constexpr std::int8_t kUnverified = -1;

  const Batch& batch_;
  const AllocationSettings& settings_;
  const SweepAnswer& answer_;
  std::atomic<bool>& flawed_;
  std::size_t rows_[kBlock];
};

}  // namespace tensionlab
