// The solvers by dual ascent for Python.
#include "arrays.hpp"
#include "bindings.hpp"
#include "smooth_batch.hpp"

namespace tensionlab {
namespace {

// solve(begin, end, answer) over the whole batch.
template <class Solve>
nb::tuple answers(const Batch& batch, const Solve& solve) {
  const auto m = static_cast<std::size_t>(batch.m);
  const SmoothAnswer answer{allocate<double>(batch.size * m), allocate<std::int64_t>(batch.size)};
  {
    nb::gil_scoped_release unlocked;
    share_out(batch.size, [&](std::size_t begin, std::size_t end) { solve(begin, end, answer); });
  }
  return nb::make_tuple(table_of(answer.tensions, batch.size, m), vector_of(answer.iterations, batch.size));
}

nb::tuple log_barrier_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                               const In<1>& weights) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  const auto kernel = log_barrier_for_this_processor();
  return answers(batch, [&](std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
    kernel(batch, begin, end, answer);
  });
}

nb::tuple slack_norm_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                              const In<2>& reference, const In<1>& weights, double p, double c1, double c2,
                              double kappa, double epsilon, double gamma) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  const SlackPrices prices{p, c1, c2, kappa, epsilon, gamma};
  const auto kernel = slack_norm_for_this_processor();
  return answers(batch, [&](std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
    kernel(batch, prices, begin, end, answer);
  });
}

nb::tuple box_price_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                             const In<2>& reference, const In<1>& row_roots) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, row_roots);
  const auto kernel = box_price_for_this_processor();
  return answers(batch, [&](std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
    kernel(batch, row_roots.data(), begin, end, answer);
  });
}

}  // namespace

void bind_smooth(nb::module_& module) {
  module.def("log_barrier", &log_barrier_tensions);
  module.def("slack_norm", &slack_norm_tensions);
  module.def("box_price", &box_price_tensions);
}

}  // namespace tensionlab
