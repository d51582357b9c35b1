// The closed forms for Python.
#include <cstdint>

#include "arrays.hpp"
#include "bindings.hpp"
#include "closed_form.hpp"

namespace tensionlab {
namespace {

struct ClosedFormAnswer {
  double* tensions;
  std::int64_t* fixed;
};

template <int N>
void solve_rows(const Batch& batch, bool improved, double rank_tolerance, std::size_t begin, std::size_t end,
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
  static constexpr decltype(&solve_rows<1>) kSolve[] = {solve_rows<1>, solve_rows<2>, solve_rows<3>,
                                                        solve_rows<4>, solve_rows<5>, solve_rows<6>};
  const Batch batch = batch_of(structure, wrench, lower, upper, start, weights);
  const auto m = static_cast<std::size_t>(batch.m);
  const ClosedFormAnswer answer{allocate<double>(batch.size * m), allocate<std::int64_t>(batch.size)};
  {
    nb::gil_scoped_release unlocked;
    share_out(batch.size, [&](std::size_t begin, std::size_t end) {
      kSolve[batch.n - 1](batch, improved, rank_tolerance, begin, end, answer);
    });
  }
  return nb::make_tuple(table_of(answer.tensions, batch.size, m), vector_of(answer.fixed, batch.size));
}

}  // namespace

void bind_closed_form(nb::module_& module) { module.def("closed_form", &closed_form_tensions); }

}  // namespace tensionlab
