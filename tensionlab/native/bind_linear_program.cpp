// The tension programs for Python.
#include <cstdint>

#include "arrays.hpp"
#include "bindings.hpp"
#include "tension_programs.hpp"

namespace tensionlab {
namespace {

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
  const TightLimits out{allocate<double>(batch.size * m), allocate<double>(batch.size * m),
                        allocate<std::int64_t>(batch.size)};
  {
    nb::gil_scoped_release unlocked;
    share_out(batch.size, [&](std::size_t begin, std::size_t end) {
      kTighten[batch.n - (chosen == Program::least_sum ? 0 : 1)](batch, chosen, alpha, begin, end, out);
    });
  }
  return nb::make_tuple(table_of(out.lower, batch.size, m), table_of(out.upper, batch.size, m),
                        vector_of(out.steps, batch.size));
}

}  // namespace

void bind_linear_program(nb::module_& module) { module.def("tighten", &tightened_limits); }

}  // namespace tensionlab
