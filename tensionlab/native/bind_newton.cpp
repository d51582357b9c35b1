// The exact solver for Python.
#include "arrays.hpp"
#include "bindings.hpp"
#include "newton_batch.hpp"

namespace tensionlab {
namespace {

nb::tuple newton_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                          const In<2>& reference, const In<1>& weights, int policy, double rank_tolerance,
                          double tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  require(policy >= 0 && policy < kPolicies, "no such policy");
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  const NewtonAnswer answer{allocate<double>(batch.size * m), allocate<double>(batch.size * n),
                            allocate<std::int64_t>(batch.size)};
  {
    nb::gil_scoped_release unlocked;
    const auto solve = newton_for_this_processor();
    share_out(batch.size, [&](std::size_t begin, std::size_t end) {
      solve(batch, static_cast<Policy>(policy), rank_tolerance, tolerance, begin, end, answer);
    });
  }
  return nb::make_tuple(table_of(answer.tensions, batch.size, m), vector_of(answer.iterations, batch.size),
                        table_of(answer.separation, batch.size, n));
}

}  // namespace

void bind_newton(nb::module_& module) { module.def("newton", &newton_tensions); }

}  // namespace tensionlab
