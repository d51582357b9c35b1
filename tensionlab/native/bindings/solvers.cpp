// The solvers for Python: batches of problems in, tensions out.
#include <algorithm>
#include <cstdint>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "solvers/closed_form.hpp"
#include "solvers/dykstra_batch.hpp"
#include "solvers/newton_batch.hpp"
#include "solvers/polygon.hpp"
#include "solvers/puncture.hpp"
#include "solvers/smooth_batch.hpp"
#include "solvers/tension_programs.hpp"

namespace tensionlab {
namespace {

// The closed forms.

struct ClosedFormAnswer {
  double* tensions;
  std::int64_t* fixed;
};

template <int N>
void closed_form_rows(const Batch& batch, bool improved, double rank_tolerance, std::size_t begin, std::size_t end,
                      const ClosedFormAnswer& answer) {
  const auto solve = improved ? improved_closed_form<double, N, kMaxCables> : closed_form<double, N, kMaxCables>;
  for (std::size_t row = begin; row < end; ++row) {
    const Start<double> start{batch.structure[row], batch.wrench[row],    batch.lower[row],
                              batch.upper[row],     batch.reference[row], batch.m};
    answer.fixed[row] = solve(start, rank_tolerance, answer.tensions + row * static_cast<std::size_t>(batch.m));
  }
}

nb::tuple closed_form_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                               const In<2>& start, const In<1>& weights, bool improved, double rank_tolerance) {
  static constexpr decltype(&closed_form_rows<1>) kSolve[] = {closed_form_rows<1>, closed_form_rows<2>,
                                                              closed_form_rows<3>, closed_form_rows<4>,
                                                              closed_form_rows<5>, closed_form_rows<6>};
  const Batch batch = batch_of(structure, wrench, lower, upper, start, weights);
  const auto m = static_cast<std::size_t>(batch.m);
  const auto tensions = make_array<double>(batch.size, m);
  const auto fixed = make_array<std::int64_t>(batch.size);
  share_out(batch.size, [&](std::size_t begin, std::size_t end) {
    kSolve[batch.n - 1](batch, improved, rank_tolerance, begin, end, {tensions.data(), fixed.data()});
  });
  return nb::make_tuple(tensions, fixed);
}

// Dykstra's projections.

nb::tuple dykstra_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                           const In<2>& reference, const In<1>& weights, double tolerance,
                           std::int64_t iteration_limit, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  const auto m = static_cast<std::size_t>(batch.m);
  const DykstraSettings settings{tolerance, rank_tolerance, iteration_limit};
  const auto tensions = make_array<double>(batch.size, m);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const auto solve = dykstra_for_this_processor();
  share_out(batch.size, [&](std::size_t begin, std::size_t end) {
    solve(batch, settings, begin, end, {tensions.data(), iterations.data()});
  });
  return nb::make_tuple(tensions, iterations);
}

// Solvers that choose among all tensions of the equilibrium.

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
  const auto tensions = make_array<double>(batch.size, m);
  share_out(batch.size, [&](std::size_t begin, std::size_t end) {
    kRows[batch.n - 1](batch, tensions.data(), solve, begin, end);
  });
  return tensions;
}

nb::tuple polygon(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                  const In<2>& reference, const In<1>& weights, int goal, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  require(goal >= 0 && goal <= static_cast<int>(Goal::least_squares), "no such goal");
  const auto redundancy = make_array<std::int64_t>(batch.size);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const auto tensions = solve_batch(batch, [&](std::size_t row, const auto& loose, double* chosen) {
    int steps = 0;
    redundancy.data()[row] =
        polygon_tensions(loose, batch.reference[row], static_cast<Goal>(goal), rank_tolerance, chosen, &steps);
    iterations.data()[row] = steps;
  });
  return nb::make_tuple(tensions, iterations, redundancy);
}

Out<double, 2> puncture(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                        const In<1>& weights, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  return solve_batch(batch, [&](std::size_t, const auto& loose, double* chosen) {
    puncture_tensions(loose, rank_tolerance, chosen);
  });
}

// Solvers by linear programs.

struct TightLimits {
  double *lower, *upper;
  std::int64_t* steps;
};

template <int N>
void tighten(const Batch& batch, Program program, double alpha, std::size_t begin, std::size_t end,
             const TightLimits& out) {
  TensionProgram<double, N, kMaxCables> tension_program(batch.m, program, alpha);
  for (std::size_t row = begin; row < end; ++row) {
    const std::size_t first = row * static_cast<std::size_t>(batch.m);
    out.steps[row] =
        tension_program.tighten({batch.structure[row], batch.wrench[row], batch.lower[row], batch.upper[row]},
                                out.lower + first, out.upper + first);
  }
}

nb::tuple tightened_limits(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                           const In<1>& weights, int program, double alpha) {
  static constexpr decltype(&tighten<1>) kTighten[] = {tighten<1>, tighten<2>, tighten<3>, tighten<4>,
                                                       tighten<5>, tighten<6>, tighten<7>};
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  require(program >= 0 && program <= static_cast<int>(Program::safe), "no such program");
  const auto chosen = static_cast<Program>(program);
  const auto m = static_cast<std::size_t>(batch.m);
  const auto tight_lower = make_array<double>(batch.size, m), tight_upper = make_array<double>(batch.size, m);
  const auto steps = make_array<std::int64_t>(batch.size);
  share_out(batch.size, [&](std::size_t begin, std::size_t end) {
    kTighten[batch.n - (chosen == Program::least_sum ? 0 : 1)](
        batch, chosen, alpha, begin, end, {tight_lower.data(), tight_upper.data(), steps.data()});
  });
  return nb::make_tuple(tight_lower, tight_upper, steps);
}

// The exact solver.

nb::tuple newton_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                          const In<2>& reference, const In<1>& weights, int policy, double rank_tolerance,
                          double tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  require(policy >= 0 && policy < kPolicies, "no such policy");
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  const auto tensions = make_array<double>(batch.size, m), separation = make_array<double>(batch.size, n);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const auto solve = newton_for_this_processor();
  share_out(batch.size, [&](std::size_t begin, std::size_t end) {
    solve(batch, static_cast<Policy>(policy), rank_tolerance, tolerance, {begin, end - begin}, 0,
          {tensions.data(), separation.data(), iterations.data()});
  });
  return nb::make_tuple(tensions, iterations, separation);
}

// Solvers by dual ascent.

// solve(begin, end, answer) over the whole batch.
template <class Solve>
nb::tuple smooth_answers(const Batch& batch, const Solve& solve) {
  const auto m = static_cast<std::size_t>(batch.m);
  const auto tensions = make_array<double>(batch.size, m);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const SmoothAnswer answer{tensions.data(), iterations.data()};
  share_out(batch.size, [&](std::size_t begin, std::size_t end) { solve(begin, end, answer); });
  return nb::make_tuple(tensions, iterations);
}

nb::tuple log_barrier_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                               const In<1>& weights) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  const auto kernel = log_barrier_for_this_processor();
  return smooth_answers(batch, [&](std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
    kernel(batch, begin, end, answer);
  });
}

nb::tuple slack_norm_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                              const In<2>& reference, const In<1>& weights, double p, double c1, double c2,
                              double kappa, double epsilon, double gamma) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  const SlackPrices prices{p, c1, c2, kappa, epsilon, gamma};
  const auto kernel = slack_norm_for_this_processor();
  return smooth_answers(batch, [&](std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
    kernel(batch, prices, begin, end, answer);
  });
}

nb::tuple box_price_tensions(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                             const In<2>& reference, const In<1>& row_roots) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, row_roots);
  const auto kernel = box_price_for_this_processor();
  return smooth_answers(batch, [&](std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
    kernel(batch, row_roots.data(), begin, end, answer);
  });
}

}  // namespace

void bind_solvers(nb::module_& module) {
  module.def("closed_form", &closed_form_tensions);
  module.def("dykstra", &dykstra_tensions);
  module.def("polygon", &polygon);
  module.def("puncture", &puncture);
  module.def("tighten", &tightened_limits);
  module.def("newton", &newton_tensions);
  module.def("log_barrier", &log_barrier_tensions);
  module.def("slack_norm", &slack_norm_tensions);
  module.def("box_price", &box_price_tensions);
}

}  // namespace tensionlab
