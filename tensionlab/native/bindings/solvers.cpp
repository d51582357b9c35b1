// The solvers and the certificates of their answers for Python: batches of problems in, tensions out.
#include <algorithm>
#include <cstdint>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "solvers/closed_form.hpp"
#include "solvers/kernels.hpp"
#include "solvers/linear_program.hpp"
#include "solvers/polygon.hpp"
#include "tensionlab/solvers/scale_search.hpp"
#include "verification/kernels.hpp"

namespace tensionlab {
namespace {

// Tensions and iterations of a batch by solve(begin, end, answer), which is called on several threads.
template <class Solve>
nb::tuple solve_batch(const Batch& batch, const Solve& solve) {
  const auto tensions = make_array<double>(batch.size, batch.m);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const IterativeAnswer answer{tensions.data(), iterations.data()};
  share_out(batch.size, [&](std::size_t begin, std::size_t end) { solve(begin, end, answer); });
  return nb::make_tuple(tensions, iterations);
}

// The same by a kernel and its settings.
template <class Kernel, class... Settings>
nb::tuple solve_in_lanes(const Batch& batch, Kernel kernel, const Settings&... settings) {
  return solve_batch(batch, [&](std::size_t begin, std::size_t end, const IterativeAnswer& answer) {
    kernel(batch, settings..., begin, end, answer);
  });
}

// The same by iterations = solve(n, row, problem, tensions) for each row, with n as a constant.
template <class Solve>
nb::tuple solve_each(const Batch& batch, const Solve& solve) {
  return solve_batch(batch, [&](std::size_t begin, std::size_t end, const IterativeAnswer& answer) {
    with_size(batch.n, [&](auto n) {
      for (std::size_t row = begin; row < end; ++row) {
        double* tensions = answer.tensions + row * static_cast<std::size_t>(batch.m);
        answer.iterations[row] = solve(n, row, batch[row], tensions);
      }
    });
  });
}

nb::tuple closed_form_tensions(const ProblemArrays& arrays, bool improved, double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  return solve_each(batch, [&](auto n, std::size_t, const Problem<double>& problem, double* tensions) {
    if (improved) {
      return improved_closed_form<double, n, kMaxCables>(problem, batch.m, rank_tolerance, tensions);
    }
    closed_form<double, n, kMaxCables>(problem, batch.m, rank_tolerance, tensions);
    return 0;
  });
}

// Writes tensions of the loose cables among those of all, clipped into their limits.
template <class Loose>
void place(const Loose& loose, const double* chosen, const Problem<double>& problem, int m, double* tensions) {
  std::copy_n(problem.lower, m, tensions);
  for (int i = 0; i < loose.count; ++i) {
    tensions[loose.index[i]] = std::min(std::max(chosen[i], loose.lower[i]), loose.upper[i]);
  }
}

// Tensions, iterations and the redundancy of each problem, which a polygon needs to be two at most.
nb::tuple polygon(const ProblemArrays& arrays, int goal, double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  const Goal chosen_goal = to_enum(goal, Goal::least_squares, "no such goal");
  const auto redundancy = make_array<std::int64_t>(batch.size);
  const nb::tuple found =
      solve_each(batch, [&](auto n, std::size_t row, const Problem<double>& problem, double* tensions) {
        const LooseCables<double, n, kMaxCables> loose(problem, batch.m);
        double chosen[kMaxCables] = {};
        int steps = 0;
        redundancy.data()[row] =
            polygon_tensions(loose, problem.reference, chosen_goal, rank_tolerance, chosen, &steps);
        place(loose, chosen, problem, batch.m, tensions);
        return steps;
      });
  return nb::make_tuple(found[0], found[1], redundancy);
}

nb::tuple puncture(const ProblemArrays& arrays, double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  return solve_each(batch, [&](auto n, std::size_t, const Problem<double>& problem, double* tensions) {
    const LooseCables<double, n, kMaxCables> loose(problem, batch.m);
    double chosen[kMaxCables] = {};
    puncture_tensions(loose, rank_tolerance, chosen);
    place(loose, chosen, problem, batch.m, tensions);
    return 0;
  });
}

// Limits (B, m) that hold the best tensions of a linear program alone, its steps, and its multipliers (B, n);
// costs (B, m) and multipliers are those of the least cost only.
nb::tuple tighten(const ProblemArrays& arrays, int program, double alpha, const In<2>& costs) {
  const Batch batch = batch_of(arrays);
  const Program chosen = to_enum(program, Program::safe, "no such program");
  require(has_shape(costs, batch.size, batch.m), "costs do not fit the structure matrices");
  const Rows cost = rows_of(costs);
  const auto lower = make_array<double>(batch.size, batch.m), upper = make_array<double>(batch.size, batch.m);
  const auto multipliers = make_array<double>(batch.size, batch.n);
  const auto steps = make_array<std::int64_t>(batch.size);
  const int rows = batch.n + (chosen == Program::least_cost ? 1 : 0);
  share_out(batch.size, [&](std::size_t begin, std::size_t end) {
    with_size<kMaxComponents + 1>(rows, [&](auto n) {
      TensionProgram<double, n, kMaxCables> tension_program(batch.m, chosen, alpha);
      for (std::size_t row = begin; row < end; ++row) {
        const std::size_t first = row * static_cast<std::size_t>(batch.m);
        steps.data()[row] =
            tension_program.tighten(batch[row], cost[row], lower.data() + first, upper.data() + first,
                                    multipliers.data() + row * static_cast<std::size_t>(batch.n));
      }
    });
  });
  return nb::make_tuple(lower, upper, steps, multipliers);
}

nb::tuple dykstra_tensions(const ProblemArrays& arrays, double tolerance, std::int64_t iteration_limit,
                           double rank_tolerance) {
  const DykstraSettings settings{tolerance, rank_tolerance, iteration_limit};
  return solve_in_lanes(batch_of(arrays), dykstra_for_this_processor(), settings);
}

nb::tuple log_barrier_tensions(const ProblemArrays& arrays) {
  return solve_in_lanes(batch_of(arrays), log_barrier_for_this_processor());
}

nb::tuple slack_norm_tensions(const ProblemArrays& arrays, double p, double c1, double c2, double kappa,
                              double epsilon, double gamma) {
  const SlackPrices prices{p, c1, c2, kappa, epsilon, gamma};
  return solve_in_lanes(batch_of(arrays), slack_norm_for_this_processor(), prices);
}

// The weights of these arrays are the prices of the rows over mu, as their roots.
nb::tuple box_price_tensions(const ProblemArrays& arrays) {
  return solve_in_lanes(batch_of(arrays), box_price_for_this_processor());
}

nb::tuple newton_tensions(const ProblemArrays& arrays, int policy, double rank_tolerance, double tolerance) {
  const Batch batch = batch_of(arrays);
  const Policy chosen = to_policy(policy);
  const auto separation = make_array<double>(batch.size, batch.n);
  const auto kernel = newton_for_this_processor();
  const nb::tuple found =
      solve_batch(batch, [&](std::size_t begin, std::size_t end, const IterativeAnswer& answer) {
        kernel(batch, chosen, rank_tolerance, tolerance, {begin, end - begin}, 0,
               {answer.tensions, separation.data(), answer.iterations});
      });
  return nb::make_tuple(found[0], found[1], separation);
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
  const auto kernel = path_for_this_processor();
  {
    const nb::gil_scoped_release unlocked;
    kernel(path, answer);
  }
  return nb::make_tuple(z, multipliers, polished_z, polished_multipliers, iterations);
}

// tensions and separation are changed in place.
nb::tuple verify_answers(const ProblemArrays& arrays, const InOut<2>& tensions, const InOut<2>& separation,
                         int rule, double tolerance, double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  require(has_shape(tensions, batch.size, batch.m) && has_shape(separation, batch.size, batch.n),
          "tensions and separation do not fit the structure matrices");
  const VerificationSettings settings{to_enum(rule, Rule::direction, "no such rule"), tolerance, rank_tolerance};
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

bool all_within(const nb::ndarray<const double, nb::c_contig, nb::device::cpu>& numbers, double limit) {
  bool inside;
  check_for_this_processor()(aligned(numbers), numbers.size(), limit, inside);
  return inside;
}

}  // namespace

void bind_solvers(nb::module_& module) {
  module.attr("GRAZING") = kGrazing;
  module.def("closed_form", &closed_form_tensions);
  module.def("dykstra", &dykstra_tensions);
  module.def("polygon", &polygon);
  module.def("puncture", &puncture);
  module.def("tighten", &tighten);
  module.def("newton", &newton_tensions);
  module.def("log_barrier", &log_barrier_tensions);
  module.def("slack_norm", &slack_norm_tensions);
  module.def("box_price", &box_price_tensions);
  module.def("path", &path_coordinates);
  module.def("verify", &verify_answers);
  module.def("all_within", &all_within);
}

}  // namespace tensionlab
