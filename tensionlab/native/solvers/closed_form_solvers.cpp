// The solvers without a search for an optimum: closed forms, the puncture method, the polygon.
#include <algorithm>
#include <limits>

#include "solvers/closed_form.hpp"
#include "solvers/tension_solver.hpp"

namespace tensionlab {
namespace {

// A solver by iterations = solve(n, m, problem, tensions) for each row, with n as a constant.
template <class Solve>
TensionSolver make_row_solver(const Solve& solve) {
  return {[=](const Batch& batch, Policy, std::size_t begin, std::size_t end, const NewtonAnswer& answer) {
    with_size(batch.n, [&](auto n) {
      for (std::size_t row = begin; row < end; ++row) {
        double* const tensions = answer.tensions + row * static_cast<std::size_t>(batch.m);
        answer.iterations[row] = solve(n, batch.m, batch[row], tensions);
      }
    });
  }};
}

// Writes tensions of the loose cables among those of all, clipped into their limits.
template <class Loose>
void place(const Loose& loose, const double* chosen, const Problem<double>& problem, int m, double* tensions) {
  std::copy_n(problem.lower, m, tensions);
  for (int i = 0; i < loose.count; ++i) {
    tensions[loose.index[i]] = std::min(std::max(chosen[i], loose.lower[i]), loose.upper[i]);
  }
}

}  // namespace

TensionSolver make_closed_form(bool middle, bool improved, double rank_tolerance) {
  return make_row_solver([=](auto n, int m, Problem<double> problem, double* tensions) {
    double start[kMaxCables];
    if (middle) {
      for (int i = 0; i < m; ++i) start[i] = (problem.lower[i] + problem.upper[i]) / 2;
      problem.reference = start;
    }
    if (improved) return improved_closed_form<double, n, kMaxCables>(problem, m, rank_tolerance, tensions);
    closed_form<double, n, kMaxCables>(problem, m, rank_tolerance, tensions);
    return 0;
  });
}

TensionSolver make_puncture(double rank_tolerance) {
  return make_row_solver([=](auto n, int m, const Problem<double>& problem, double* tensions) {
    const LooseCables<double, n, kMaxCables> loose(problem, m);
    double chosen[kMaxCables] = {};
    puncture_tensions(loose, rank_tolerance, chosen);
    place(loose, chosen, problem, m, tensions);
    return 0;
  });
}

TensionSolver make_polygon(Goal goal, double rank_tolerance) {
  constexpr int kDimensions = 2;
  // Tensions are NaN where the redundancy is more than a polygon has dimensions.
  const auto solve = [=](auto n, int m, const Problem<double>& problem, double* tensions, int& redundancy) {
    const LooseCables<double, n, kMaxCables> loose(problem, m);
    double chosen[kMaxCables] = {};
    int steps = 0;
    redundancy = polygon_tensions(loose, problem.reference, goal, rank_tolerance, chosen, &steps);
    place(loose, chosen, problem, m, tensions);
    if (redundancy > kDimensions) std::fill_n(tensions, m, std::numeric_limits<double>::quiet_NaN());
    return steps;
  };
  TensionSolver solver = make_row_solver([=](auto n, int m, const Problem<double>& problem, double* tensions) {
    int unused;
    return solve(n, m, problem, tensions, unused);
  });
  solver.failure = [=](const Problem<double>& problem, int n, int m) {
    double unused[kMaxCables];
    int redundancy = 0;
    with_size(n, [&](auto size) { solve(size, m, problem, unused, redundancy); });
    return "the structure matrix has a rank so low that the redundancy is " + std::to_string(redundancy) +
           "; a polygon has " + std::to_string(kDimensions) + " dimensions";
  };
  return solver;
}

}  // namespace tensionlab
