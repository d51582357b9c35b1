// Tensions from linear programs: the tighter limits that the best ones keep, and of these the closest to the
// reference.
#include <algorithm>

#include "solvers/tension_solver.hpp"

namespace tensionlab {

void tighten(const Batch& batch, Program program, double alpha, const Rows& costs, std::size_t begin,
             std::size_t end, const TightLimits& limits) {
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  with_size<kMaxComponents + 1>(batch.n + (program == Program::least_cost ? 1 : 0), [&](auto rows) {
    TensionProgram<double, rows, kMaxCables> tension_program(batch.m, program, alpha);
    for (std::size_t row = begin; row < end; ++row) {
      limits.steps[row] = tension_program.tighten(batch[row], costs[row], limits.lower + row * m,
                                                  limits.upper + row * m, limits.multipliers + row * n);
    }
  });
}

TensionSolver make_linear_program(Program program, double alpha, double rank_tolerance, double tolerance) {
  return {[=](const Batch& batch, Policy policy, std::size_t begin, std::size_t end, const NewtonAnswer& answer) {
    constexpr std::size_t kRows = 64;  // at a time
    double lower[kRows * kMaxCables], upper[kRows * kMaxCables], unused[kRows * kMaxComponents];
    double ones[kMaxCables];
    std::int64_t steps[kRows];
    std::fill_n(ones, batch.m, 1.0);
    const auto kernel = newton_for_this_processor();
    for (; begin < end; begin += kRows) {
      Batch part = batch;
      part.size = std::min(kRows, end - begin);
      for (Rows Batch::* rows :
           {&Batch::structure, &Batch::wrench, &Batch::lower, &Batch::upper, &Batch::reference}) {
        part.*rows = {(part.*rows)[begin], (part.*rows).stride};
      }
      tighten(part, program, alpha, {ones, 0}, 0, part.size, {lower, upper, steps, unused});
      part.lower = {lower, batch.m};
      part.upper = {upper, batch.m};
      const NewtonAnswer closest{answer.tensions + begin * static_cast<std::size_t>(batch.m), unused,
                                 answer.iterations + begin};
      kernel(part, policy, rank_tolerance, tolerance, {0, part.size}, 0, closest);
      for (std::size_t row = 0; row < part.size; ++row) closest.iterations[row] += steps[row];
    }
  }};
}

}  // namespace tensionlab
