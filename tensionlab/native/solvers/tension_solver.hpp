// The interface of all families of solvers, and its makers.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

#include "solvers/block_solver.hpp"
#include "solvers/linear_program.hpp"
#include "solvers/polygon.hpp"

namespace tensionlab {

// A solver with its hyper-parameters.
struct TensionSolver {
  // Chooses tensions for rows [begin, end) and, if it separates, directions that may separate their wrenches.
  std::function<void(const Batch&, Policy, std::size_t begin, std::size_t end, const NewtonAnswer&)> choose;
  bool separates = false;

  // Chooses and verifies tensions for rows [begin, end), `kBlock` at most, so that verification finds the numbers
  // in the cache. Returns false if an entry of a structure matrix or a wrench is NaN or too large.
  using Allocate = bool(const Batch&, const AllocationSettings&, std::size_t begin, std::size_t end,
                        const SweepAnswer&, std::atomic<bool>& flawed);
  static constexpr std::size_t kBlock = 512;
  bool allocate(const Batch&, const AllocationSettings&, std::size_t begin, std::size_t end, const SweepAnswer&,
                std::atomic<bool>& flawed) const;
  std::function<Allocate> own_allocate = {};  // where it does both in one

  // Why it has no tensions for a problem.
  std::function<std::string(const Problem<double>&, int n, int m)> failure = [](const Problem<double>&, int, int) {
    return "the solver returned NaN";
  };

  bool brief = true;                          // a problem takes microseconds, so that nobody would interrupt it
  std::size_t entries_enough = 1024 * 3 * 8;  // of structure matrices, that are worth a thread
};

TensionSolver make_newton(double rank_tolerance, double tolerance);
TensionSolver make_dykstra(const DykstraSettings&);
TensionSolver make_log_barrier();
TensionSolver make_slack_norm(const SlackPrices&);
// mu: price of a squared tension; force and torque: prices of a squared error, of the first three rows and others.
TensionSolver make_box_price(double mu, double force, double torque);
// middle: starts from the middle of the limits, not the reference.
TensionSolver make_closed_form(bool middle, bool improved, double rank_tolerance);
TensionSolver make_puncture(double rank_tolerance);
TensionSolver make_polygon(Goal, double rank_tolerance);
// alpha: of the optimally safe tensions only.
TensionSolver make_linear_program(Program, double alpha, double rank_tolerance, double tolerance);

// Limits that the best tensions of a linear program keep, and no others that render the wrench (size, m), with its
// steps (size) and multipliers (size, n), of rows [begin, end).
struct TightLimits {
  double *lower, *upper;
  std::int64_t* steps;
  double* multipliers;
};
void tighten(const Batch&, Program, double alpha, const Rows& costs, std::size_t begin, std::size_t end,
             const TightLimits&);

}  // namespace tensionlab
