// The judge of all answers for Python.
#include <atomic>
#include <cstdint>

#include "arrays.hpp"
#include "bindings.hpp"
#include "judge.hpp"

namespace tensionlab {
namespace {

// tensions and separation are changed in place.
nb::tuple judge(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                const In<1>& weights, nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> tensions,
                nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> separation, int rule,
                double tolerance, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  double* rendered = allocate<double>(batch.size * n);
  double* residual = allocate<double>(batch.size);
  double* scale = allocate<double>(batch.size);
  std::int8_t* status = allocate<std::int8_t>(batch.size);
  std::atomic<bool> flawed{false};
  {
    nb::gil_scoped_release unlocked;
    const Judge<kMaxComponents, kMaxCables> judge(batch.n, batch.m, batch.weights, static_cast<Rule>(rule),
                                                  tolerance, rank_tolerance);
    share_out(batch.size, [&](std::size_t begin, std::size_t end) {
      for (std::size_t row = begin; row < end; ++row) {
        const auto finding =
            judge.judge({batch.structure[row], batch.wrench[row], batch.lower[row], batch.upper[row]},
                        tensions.data() + row * m, rendered + row * n, separation.data() + row * n);
        status[row] = static_cast<std::int8_t>(finding.status);
        residual[row] = finding.residual;
        scale[row] = finding.scale;
        if (finding.status == Verdict::iteration_limit || finding.status == Verdict::failed) flawed = true;
      }
    });
  }
  return nb::make_tuple(table_of(rendered, batch.size, n), vector_of(residual, batch.size),
                        vector_of(status, batch.size), vector_of(scale, batch.size), flawed.load());
}

}  // namespace

void bind_judge(nb::module_& module) { module.def("judge", &judge); }

}  // namespace tensionlab
