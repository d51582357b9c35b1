// Derivatives of the exact solver's tensions, for Python.
#include <cstdint>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "solvers/allocation_jacobian.hpp"

namespace tensionlab {
namespace {

using Statuses = nb::ndarray<const std::int8_t, nb::numpy, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// A batch that has been solved.
struct SolvedBatch {
  Batch batch;
  Rows tensions;
  const double* scale;
  const std::int8_t* status;
  Policy policy;
  double rank_tolerance;

  template <int N>
  AllocationJacobian<N, kMaxCables> at(std::size_t row) const {
    const SolvedProblem solved{
        {batch.structure[row], batch.wrench[row], batch.lower[row], batch.upper[row], batch.reference[row]},
        tensions[row],
        status[row] == 0,
        status[row] < 2,
        scale[row]};
    return {solved, batch.m, policy, batch.weights, rank_tolerance};
  }
};

SolvedBatch solved_batch(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                         const In<2>& reference, const In<1>& weights, const In<2>& tensions, const In<1>& scale,
                         const Statuses& status, int policy, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  require(policy >= 0 && policy < kPolicies, "no such policy");
  require(
      has_shape(tensions, batch.size, batch.m) && has_shape(scale, batch.size) && has_shape(status, batch.size),
      "tensions, scale and status do not fit the structure matrices");
  return {batch, rows_of(tensions), contiguous(scale), status.data(), static_cast<Policy>(policy), rank_tolerance};
}

struct JacobianAnswer {
  double *wrench, *structure;  // structure may be null
  bool* kink;
};

template <int N>
void jacobian_rows(const SolvedBatch& solved, std::size_t begin, std::size_t end, const JacobianAnswer& answer) {
  const auto m = static_cast<std::size_t>(solved.batch.m);
  for (std::size_t row = begin; row < end; ++row) {
    const auto jacobian = solved.at<N>(row);
    answer.kink[row] = jacobian.kink();
    jacobian.wrench(answer.wrench + row * m * N);
    if (answer.structure != nullptr) jacobian.structure(answer.structure + row * m * N * m);
  }
}

// d tensions / d wrench (B, m, n) and d structure (B, m, n, m), which is None where it is not wanted; kinks (B).
nb::tuple allocation_jacobian(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                              const In<2>& reference, const In<1>& weights, const In<2>& tensions,
                              const In<1>& scale, const Statuses& status, int policy, double rank_tolerance,
                              bool by_structure) {
  static constexpr decltype(&jacobian_rows<1>) kRows[] = {jacobian_rows<1>, jacobian_rows<2>, jacobian_rows<3>,
                                                          jacobian_rows<4>, jacobian_rows<5>, jacobian_rows<6>};
  const SolvedBatch solved = solved_batch(structure, wrench, lower, upper, reference, weights, tensions, scale,
                                          status, policy, rank_tolerance);
  const std::size_t size = solved.batch.size;
  const auto n = static_cast<std::size_t>(solved.batch.n), m = static_cast<std::size_t>(solved.batch.m);
  const auto by_wrench = make_array<double>(size, m, n);
  Out<double, 4> by_entry;
  if (by_structure) by_entry = make_array<double>(size, m, n, m);
  const auto kink = make_array<bool>(size);
  const JacobianAnswer answer{by_wrench.data(), by_structure ? by_entry.data() : nullptr, kink.data()};
  share_out(size,
            [&](std::size_t begin, std::size_t end) { kRows[solved.batch.n - 1](solved, begin, end, answer); });
  return nb::make_tuple(by_wrench, by_structure ? nb::cast(by_entry) : nb::none(), kink);
}

struct GradientAnswer {
  double *structure, *wrench, *lower, *upper, *reference;
};

template <int N>
void gradient_rows(const SolvedBatch& solved, const Rows& cotangent, std::size_t begin, std::size_t end,
                   const GradientAnswer& answer) {
  const auto m = static_cast<std::size_t>(solved.batch.m);
  for (std::size_t row = begin; row < end; ++row) {
    solved.at<N>(row).pull_back(cotangent[row], answer.structure + row * N * m, answer.wrench + row * N,
                                answer.lower + row * m, answer.upper + row * m, answer.reference + row * m);
  }
}

// A cotangent of the tensions (B, m) becomes those of structure (B, n, m), wrench (B, n), limits and reference (B,
// m).
nb::tuple allocation_gradients(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                               const In<2>& reference, const In<1>& weights, const In<2>& tensions,
                               const In<1>& scale, const Statuses& status, int policy, double rank_tolerance,
                               const In<2>& cotangent) {
  static constexpr decltype(&gradient_rows<1>) kRows[] = {gradient_rows<1>, gradient_rows<2>, gradient_rows<3>,
                                                          gradient_rows<4>, gradient_rows<5>, gradient_rows<6>};
  const SolvedBatch solved = solved_batch(structure, wrench, lower, upper, reference, weights, tensions, scale,
                                          status, policy, rank_tolerance);
  const std::size_t size = solved.batch.size;
  const auto n = static_cast<std::size_t>(solved.batch.n), m = static_cast<std::size_t>(solved.batch.m);
  require(has_shape(cotangent, size, m), "the cotangent does not fit the tensions");
  const Rows rows = rows_of(cotangent);
  const auto structures = make_array<double>(size, n, m);
  const auto wrenches = make_array<double>(size, n), lowers = make_array<double>(size, m);
  const auto uppers = make_array<double>(size, m), references = make_array<double>(size, m);
  const GradientAnswer answer{structures.data(), wrenches.data(), lowers.data(), uppers.data(), references.data()};
  share_out(size, [&](std::size_t begin, std::size_t end) {
    kRows[solved.batch.n - 1](solved, rows, begin, end, answer);
  });
  return nb::make_tuple(structures, wrenches, lowers, uppers, references);
}

}  // namespace

void bind_jacobian(nb::module_& module) {
  module.def("allocation_jacobian", &allocation_jacobian);
  module.def("allocation_gradients", &allocation_gradients);
}

}  // namespace tensionlab
