// Derivatives of the exact solver's tensions, for Python.
#include <cstdint>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "solvers/allocation_jacobian.hpp"

namespace tensionlab {
namespace {

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
    const SolvedProblem solved{batch[row], tensions[row], status[row] == 0, status[row] < 2, scale[row]};
    return {solved, batch.m, policy, batch.weights, rank_tolerance};
  }
};

// Tensions, scale and status of a batch, as Python has them.
using AnswerArrays = std::tuple<In<2>, In<1>, Contiguous<std::int8_t, 1>>;

SolvedBatch solved_batch(const ProblemArrays& problem, const AnswerArrays& answer, int policy,
                         double rank_tolerance) {
  const Batch batch = batch_of(problem);
  const auto& [tensions, scale, status] = answer;
  require(
      has_shape(tensions, batch.size, batch.m) && has_shape(scale, batch.size) && has_shape(status, batch.size),
      "tensions, scale and status do not fit the structure matrices");
  return {batch, rows_of(tensions), contiguous(scale), status.data(), to_policy(policy), rank_tolerance};
}

// d tensions / d wrench (B, m, n) and d structure (B, m, n, m), None unless by_structure; kinks (B).
nb::tuple allocation_jacobian(const ProblemArrays& problem, const AnswerArrays& answer, int policy,
                              double rank_tolerance, bool by_structure) {
  const SolvedBatch solved = solved_batch(problem, answer, policy, rank_tolerance);
  const std::size_t size = solved.batch.size;
  const auto n = static_cast<std::size_t>(solved.batch.n), m = static_cast<std::size_t>(solved.batch.m);
  const auto by_wrench = make_array<double>(size, m, n);
  Out<double, 4> by_entry;
  if (by_structure) by_entry = make_array<double>(size, m, n, m);
  const auto kink = make_array<bool>(size);
  share_out(size, [&](std::size_t begin, std::size_t end) {
    with_size(solved.batch.n, [&](auto components) {
      for (std::size_t row = begin; row < end; ++row) {
        const auto jacobian = solved.at<components>(row);
        kink.data()[row] = jacobian.kink();
        jacobian.wrench(by_wrench.data() + row * m * n);
        if (by_structure) jacobian.structure(by_entry.data() + row * m * n * m);
      }
    });
  });
  return nb::make_tuple(by_wrench, by_structure ? nb::cast(by_entry) : nb::none(), kink);
}

// A cotangent of the tensions (B, m) becomes those of structure (B, n, m), wrench (B, n), limits and reference (B,
// m).
nb::tuple allocation_gradients(const ProblemArrays& problem, const AnswerArrays& answer, int policy,
                               double rank_tolerance, const In<2>& cotangent) {
  const SolvedBatch solved = solved_batch(problem, answer, policy, rank_tolerance);
  const std::size_t size = solved.batch.size;
  const auto n = static_cast<std::size_t>(solved.batch.n), m = static_cast<std::size_t>(solved.batch.m);
  require(has_shape(cotangent, size, m), "the cotangent does not fit the tensions");
  const Rows rows = rows_of(cotangent);
  const auto structure = make_array<double>(size, n, m);
  const auto wrench = make_array<double>(size, n), reference = make_array<double>(size, m);
  const auto lower = make_array<double>(size, m), upper = make_array<double>(size, m);
  share_out(size, [&](std::size_t begin, std::size_t end) {
    with_size(solved.batch.n, [&](auto components) {
      for (std::size_t row = begin; row < end; ++row) {
        solved.at<components>(row).pull_back(rows[row], structure.data() + row * n * m, wrench.data() + row * n,
                                             lower.data() + row * m, upper.data() + row * m,
                                             reference.data() + row * m);
      }
    });
  });
  return nb::make_tuple(structure, wrench, lower, upper, reference);
}

}  // namespace

void bind_jacobian(nb::module_& module) {
  module.def("allocation_jacobian", &allocation_jacobian);
  module.def("allocation_gradients", &allocation_gradients);
}

}  // namespace tensionlab
