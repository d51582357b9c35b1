// Dykstra's projections for Python.
#include "arrays.hpp"
#include "bindings.hpp"
#include "dykstra_batch.hpp"

namespace tensionlab {
namespace {

nb::tuple dykstra_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                           const In<2>& reference, const In<1>& weights, double tolerance,
                           std::int64_t iteration_limit, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  const auto m = static_cast<std::size_t>(batch.m);
  const DykstraSettings settings{tolerance, rank_tolerance, iteration_limit};
  const DykstraAnswer answer{allocate<double>(batch.size * m), allocate<std::int64_t>(batch.size)};
  {
    nb::gil_scoped_release unlocked;
    const auto solve = dykstra_for_this_processor();
    share_out(batch.size, [&](std::size_t begin, std::size_t end) { solve(batch, settings, begin, end, answer); });
  }
  return nb::make_tuple(table_of(answer.tensions, batch.size, m), vector_of(answer.iterations, batch.size));
}

}  // namespace

void bind_dykstra(nb::module_& module) { module.def("dykstra", &dykstra_tensions); }

}  // namespace tensionlab
