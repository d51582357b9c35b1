// The solvers for Python: batches of problems in, tensions out, chosen alone or verified too.
#include <algorithm>
#include <cmath>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "solvers/tension_solver.hpp"

namespace tensionlab {
namespace {

// The reason of each row that has no tensions.
nb::dict failures_of(const TensionSolver& solver, const Batch& batch, const double* tensions) {
  nb::dict failures;
  for (std::size_t row = 0; row < batch.size; ++row) {
    if (!std::isnan(tensions[row * static_cast<std::size_t>(batch.m)])) continue;
    failures[nb::int_(row)] = nb::str(solver.failure(batch[row], batch.n, batch.m).c_str());
  }
  return failures;
}

// Tensions, iterations, separating directions, which are None of a solver that finds none, and failures.
nb::tuple choose(const TensionSolver& solver, const ProblemArrays& arrays, int rule) {
  const Batch batch = batch_of(arrays);
  const Policy policy = AllocationSettings{to_rule(rule), 0, 0, 0}.policy();
  const auto tensions = make_array<double>(batch.size, batch.m);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const auto separation = make_array<double>(solver.separates ? batch.size : 0, batch.n);
  const NewtonAnswer answer{tensions.data(), separation.data(), iterations.data()};
  share_out(batch.size,
            [&](std::size_t begin, std::size_t end) { solver.choose(batch, policy, begin, end, answer); });
  return nb::make_tuple(tensions, iterations, solver.separates ? nb::cast(separation) : nb::none(),
                        failures_of(solver, batch, tensions.data()));
}

// None if an entry of a structure matrix or a wrench is NaN or too large.
nb::object allocate_batch(const TensionSolver& solver, const ProblemArrays& arrays, int rule, double largest,
                          double tolerance, double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  const AllocationSettings settings{to_rule(rule), largest, tolerance, rank_tolerance};
  std::atomic<bool> flawed{false}, invalid{false};
  const auto tensions = make_array<double>(batch.size, batch.m);
  const auto separation = make_array<double>(batch.size, batch.n),
             rendered = make_array<double>(batch.size, batch.n);
  const auto residual = make_array<double>(batch.size), scale = make_array<double>(batch.size);
  const auto status = make_array<std::int8_t>(batch.size);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const SweepAnswer answer{tensions.data(), separation.data(), rendered.data(),  residual.data(),
                           scale.data(),    status.data(),     iterations.data()};
  share_out(
      batch.size,
      [&](std::size_t begin, std::size_t end) {
        for (std::size_t row = begin; row < end && !invalid; row += TensionSolver::kBlock) {
          const std::size_t row_end = std::min(row + TensionSolver::kBlock, end);
          if (!solver.allocate(batch, settings, row, row_end, answer, flawed)) invalid = true;
          checkpoint();
        }
      },
      solver.entries_enough / static_cast<std::size_t>(batch.n * batch.m));
  if (invalid) return nb::none();
  const nb::dict failures = flawed ? failures_of(solver, batch, tensions.data()) : nb::dict();
  return nb::make_tuple(tensions, rendered, residual, status, scale, iterations, separation, failures);
}

TensionSolver dykstra(double tolerance, std::int64_t iteration_limit, double rank_tolerance) {
  return make_dykstra({tolerance, rank_tolerance, iteration_limit});
}

TensionSolver slack_norm(double p, double c1, double c2, double kappa, double epsilon, double gamma) {
  return make_slack_norm({p, c1, c2, kappa, epsilon, gamma});
}

TensionSolver polygon(int goal, double rank_tolerance) {
  return make_polygon(to_enum(goal, Goal::least_squares, "no such goal"), rank_tolerance);
}

TensionSolver linear_program(int program, double alpha, double rank_tolerance, double tolerance) {
  return make_linear_program(to_enum(program, Program::safe, "no such program"), alpha, rank_tolerance, tolerance);
}

}  // namespace

void bind_allocate(nb::module_& module) {
  nb::class_<TensionSolver>(module, "TensionSolver").def("choose", &choose).def("allocate", &allocate_batch);
  module.def("newton", &make_newton);
  module.def("dykstra", &dykstra);
  module.def("log_barrier", &make_log_barrier);
  module.def("slack_norm", &slack_norm);
  module.def("box_price", &make_box_price);
  module.def("closed_form", &make_closed_form);
  module.def("puncture", &make_puncture);
  module.def("polygon", &polygon);
  module.def("linear_program", &linear_program);
}

}  // namespace tensionlab
