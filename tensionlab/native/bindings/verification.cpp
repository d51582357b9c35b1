// Certificates of answers for Python.
#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "solvers/scale_search.hpp"
#include "verification/certificates_batch.hpp"

namespace tensionlab {
namespace {

using Table = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// tensions and separation are changed in place.
nb::tuple verify_answers(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                         const In<1>& weights, Table tensions, Table separation, int rule, double tolerance,
                         double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, lower, weights);
  const auto n = static_cast<std::size_t>(batch.n);
  require(has_shape(tensions, batch.size, batch.m) && has_shape(separation, batch.size, n),
          "tensions and separation do not fit the structure matrices");
  require(rule >= 0 && rule <= static_cast<int>(Rule::direction), "no such rule");
  std::atomic<bool> flawed{false};
  const auto rendered = make_array<double>(batch.size, n);
  const auto residual = make_array<double>(batch.size), scale = make_array<double>(batch.size);
  const auto status = make_array<std::int8_t>(batch.size);
  const Findings findings{tensions.data(), separation.data(), rendered.data(), residual.data(),
                          scale.data(),    status.data(),     &flawed};
  const auto verify = verify_for_this_processor();
  share_out(batch.size, [&](std::size_t begin, std::size_t end) {
    verify(batch, {static_cast<Rule>(rule), tolerance, rank_tolerance}, {begin, end - begin}, findings);
  });
  return nb::make_tuple(rendered, residual, status, scale, flawed.load());
}

bool all_within(const nb::ndarray<const double, nb::c_contig, nb::device::cpu>& numbers, double limit) {
  bool inside;
  check_for_this_processor()(aligned(numbers), numbers.size(), limit, inside);
  return inside;
}

}  // namespace

void bind_verification(nb::module_& module) {
  module.attr("GRAZING") = kGrazing;
  module.def("verify", &verify_answers);
  module.def("all_within", &all_within);
}

}  // namespace tensionlab
