// Parts of solvers, and the certificates of answers, for Python.
#include <algorithm>
#include <cstdint>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "solvers/tension_solver.hpp"
#include "tensionlab/solvers/scale_search.hpp"

namespace tensionlab {
namespace {

// Limits (B, m) that hold the best tensions of a linear program alone, its steps, and its multipliers (B, n);
// costs (B, m) and multipliers are those of the least cost only.
nb::tuple tighten_limits(const ProblemArrays& arrays, int program, double alpha, const In<2>& costs) {
  const Batch batch = batch_of(arrays);
  const Program chosen = to_enum(program, Program::safe, "no such program");
  require(has_shape(costs, batch.size, batch.m), "costs do not fit the structure matrices");
  const Rows cost = rows_of(costs);
  const auto lower = make_array<double>(batch.size, batch.m), upper = make_array<double>(batch.size, batch.m);
  const auto multipliers = make_array<double>(batch.size, batch.n);
  const auto steps = make_array<std::int64_t>(batch.size);
  const TightLimits limits{lower.data(), upper.data(), steps.data(), multipliers.data()};
  share_out(batch.size,
            [&](std::size_t begin, std::size_t end) { tighten(batch, chosen, alpha, cost, begin, end, limits); });
  return nb::make_tuple(lower, upper, steps, multipliers);
}

// Coordinates, multipliers, both again polished, and iterations.
nb::tuple path_coordinates(const Contiguous<double, 3>& basis, const Contiguous<double, 2>& space,
                           const Contiguous<double, 1>& reach, double relaxation) {
  const std::size_t samples = basis.shape(0), m = basis.shape(1), r = basis.shape(2);
  require_size(1, m);
  require(samples > 0 && r <= m && has_shape(space, 4 * samples - 2, m) && has_shape(reach, samples),
          "space and reach do not fit the basis");
  const auto z = make_array<double>(samples, r), polished_z = make_array<double>(samples, r);
  const auto multipliers = make_array<double>(4 * samples - 2, m);
  const auto polished_multipliers = make_array<double>(4 * samples - 2, m);
  std::int64_t iterations = 0;
  const PathConstraints path{samples, m, r, aligned(basis), aligned(space), aligned(reach), relaxation};
  const PathAnswer answer{z.data(), multipliers.data(), polished_z.data(), polished_multipliers.data(),
                          &iterations};
  {
    const nb::gil_scoped_release unlocked;
    allocate_path(path, answer);
  }
  return nb::make_tuple(z, multipliers, polished_z, polished_multipliers, iterations);
}

// tensions and separation are changed in place.
nb::tuple verify_answers(const ProblemArrays& arrays, const InOut<2>& tensions, const InOut<2>& separation,
                         int rule, double tolerance, double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  require(has_shape(tensions, batch.size, batch.m) && has_shape(separation, batch.size, batch.n),
          "tensions and separation do not fit the structure matrices");
  const VerificationSettings settings{to_rule(rule), tolerance, rank_tolerance};
  std::atomic<bool> flawed{false};
  const auto rendered = make_array<double>(batch.size, batch.n);
  const auto residual = make_array<double>(batch.size), scale = make_array<double>(batch.size);
  const auto status = make_array<std::int8_t>(batch.size);
  const Findings findings{tensions.data(), separation.data(), rendered.data(), residual.data(),
                          scale.data(),    status.data(),     &flawed};
  const auto kernel = verify_for_this_processor();
  share_out(batch.size,
            [&](std::size_t begin, std::size_t end) { kernel(batch, settings, {begin, end - begin}, findings); });
  return nb::make_tuple(rendered, residual, status, scale, flawed.load());
}

bool are_all_within(const nb::ndarray<const double, nb::c_contig, nb::device::cpu>& numbers, double limit) {
  bool inside;
  check_for_this_processor()(aligned(numbers), numbers.size(), limit, inside);
  return inside;
}

}  // namespace

void bind_solvers(nb::module_& module) {
  module.attr("GRAZING") = kGrazing;
  module.def("tighten", &tighten_limits);
  module.def("path", &path_coordinates);
  module.def("verify", &verify_answers);
  module.def("all_within", &are_all_within);
}

}  // namespace tensionlab
