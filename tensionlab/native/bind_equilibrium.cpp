// The solvers that choose among all tensions of the equilibrium, for Python.
#include <algorithm>
#include <cstdint>

#include "arrays.hpp"
#include "bindings.hpp"
#include "polygon.hpp"
#include "puncture.hpp"

namespace tensionlab {
namespace {

// solve(row, cables with play, their tensions) for each problem; the tensions are put in place, inside their
// limits.
template <int N, class Solve>
void solve_rows(const Batch& batch, double* tensions, const Solve& solve, std::size_t begin, std::size_t end) {
  for (std::size_t row = begin; row < end; ++row) {
    const LooseCables<double, N, kMaxCables> loose(batch.structure[row], batch.wrench[row], batch.lower[row],
                                                   batch.upper[row], batch.m);
    double chosen[kMaxCables] = {};
    solve(row, loose, chosen);
    double* own = tensions + row * static_cast<std::size_t>(batch.m);
    std::copy_n(batch.lower[row], batch.m, own);
    for (int i = 0; i < loose.count; ++i) {
      own[loose.index[i]] = std::min(std::max(chosen[i], loose.lower[i]), loose.upper[i]);
    }
  }
}

// The same for the whole batch, on threads.
template <class Solve>
Out<double, 2> solve_batch(const Batch& batch, const Solve& solve) {
  static constexpr decltype(&solve_rows<1, Solve>) kRows[] = {solve_rows<1, Solve>, solve_rows<2, Solve>,
                                                              solve_rows<3, Solve>, solve_rows<4, Solve>,
                                                              solve_rows<5, Solve>, solve_rows<6, Solve>};
  const auto m = static_cast<std::size_t>(batch.m);
  double* tensions = allocate<double>(batch.size * m);
  {
    nb::gil_scoped_release unlocked;
    share_out(batch.size,
              [&](std::size_t begin, std::size_t end) { kRows[batch.n - 1](batch, tensions, solve, begin, end); });
  }
  return table_of(tensions, batch.size, m);
}

nb::tuple polygon(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                  const In<2>& reference, const In<1>& weights, int goal, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  require(goal >= 0 && goal <= static_cast<int>(Goal::least_squares), "no such goal");
  auto* redundancy = allocate<std::int64_t>(batch.size);
  auto* iterations = allocate<std::int64_t>(batch.size);
  const auto tensions = solve_batch(batch, [&](std::size_t row, const auto& loose, double* chosen) {
    int steps = 0;
    redundancy[row] =
        polygon_tensions(loose, batch.reference[row], static_cast<Goal>(goal), rank_tolerance, chosen, &steps);
    iterations[row] = steps;
  });
  return nb::make_tuple(tensions, vector_of(iterations, batch.size), vector_of(redundancy, batch.size));
}

Out<double, 2> puncture(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                        const In<1>& weights, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  return solve_batch(batch, [&](std::size_t, const auto& loose, double* chosen) {
    puncture_tensions(loose, rank_tolerance, chosen);
  });
}

}  // namespace

void bind_equilibrium(nb::module_& module) {
  module.def("polygon", &polygon);
  module.def("puncture", &puncture);
}

}  // namespace tensionlab
