// The solvers that begin with all tensions of the equilibrium, for Python.
#include "arrays.hpp"
#include "bindings.hpp"
#include "polygon.hpp"
#include "puncture.hpp"

namespace tensionlab {
namespace {

using Loose = LooseCables<double, kMaxComponents, kMaxCables>;

// solve(problem, its cables with play, its tensions) for the whole batch, on threads; fixed cables are filled in.
template <class Solve>
Out<double, 2> for_each_problem(const Batch& batch, const Solve& solve) {
  const auto m = static_cast<std::size_t>(batch.m);
  double* tensions = allocate<double>(batch.size * m);
  {
    nb::gil_scoped_release unlocked;
    share_out(batch.size, [&](std::size_t begin, std::size_t end) {
      for (std::size_t row = begin; row < end; ++row) {
        double* own = tensions + row * m;
        const Loose loose(batch.structure[row], batch.wrench[row], batch.lower[row], batch.upper[row], batch.n,
                          batch.m);
        std::copy_n(batch.lower[row], m, own);
        solve(row, loose, own);
      }
    });
  }
  return table_of(tensions, batch.size, m);
}

nb::tuple polygon(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                  const In<2>& reference, const In<1>& weights, int goal, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  auto* redundancy = allocate<std::int64_t>(batch.size);
  auto* iterations = allocate<std::int64_t>(batch.size);
  const auto tensions = for_each_problem(batch, [&](std::size_t row, const Loose& loose, double* own) {
    int steps = 0;
    redundancy[row] = polygon_tensions(loose, batch.lower[row], batch.upper[row], batch.reference[row],
                                       static_cast<Goal>(goal), rank_tolerance, own, &steps);
    iterations[row] = steps;
  });
  return nb::make_tuple(tensions, vector_of(iterations, batch.size), vector_of(redundancy, batch.size));
}

Out<double, 2> puncture(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                        const In<1>& weights, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  return for_each_problem(batch, [&](std::size_t row, const Loose& loose, double* own) {
    puncture_tensions(loose, batch.lower[row], batch.upper[row], rank_tolerance, own);
  });
}

}  // namespace

void bind_equilibrium(nb::module_& module) {
  module.def("polygon", &polygon);
  module.def("puncture", &puncture);
}

}  // namespace tensionlab
