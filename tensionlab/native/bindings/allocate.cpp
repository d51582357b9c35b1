// The exact solver with its verification for Python.
#include <algorithm>
#include <cmath>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "solvers/block_solver.hpp"

namespace tensionlab {
namespace {

constexpr std::size_t kBlock = 512;
constexpr std::size_t kEntriesEnough = 65'536;  // entries of structure matrices that are worth a thread

// None if an entry is NaN or too large.
nb::object allocate_batch(const ProblemArrays& arrays, int policy, double largest, double tolerance,
                          double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  const ExactSettings settings{to_policy(policy), largest, tolerance, rank_tolerance};
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  std::atomic<bool> flawed{false}, invalid{false};
  const auto tensions = make_array<double>(batch.size, m), separation = make_array<double>(batch.size, n);
  const auto rendered = make_array<double>(batch.size, n);
  const auto residual = make_array<double>(batch.size), scale = make_array<double>(batch.size);
  const auto status = make_array<std::int8_t>(batch.size);
  const auto iterations = make_array<std::int64_t>(batch.size);
  const SweepAnswer answer{tensions.data(), separation.data(), rendered.data(),  residual.data(),
                           scale.data(),    status.data(),     iterations.data()};
  share_out(
      batch.size,
      [&](std::size_t begin, std::size_t end) {
        BlockSolver<kBlock> solver(batch, settings, answer, flawed);
        for (std::size_t row = begin; row < end && !invalid; row += kBlock) {
          if (!solver.solve(row, std::min(row + kBlock, end))) invalid = true;
        }
      },
      kEntriesEnough / (n * m));
  if (invalid) return nb::none();
  return nb::make_tuple(tensions, rendered, residual, status, scale, iterations, separation);
}

// Limits and reference (m) and weights (n) of one problem.
struct Prepared {
  const double *lower, *upper, *reference, *weights;
  std::size_t n, m;
};

// An array as it is, never a converted copy; an invalid one of None and where the cast fails.
template <int Axes>
Contiguous<double, Axes> as_is(const nb::object& object) {
  Contiguous<double, Axes> array;
  return nb::try_cast(object, array, false) ? array : Contiguous<double, Axes>();
}

// numbers: tensions (m), rendered wrench (n), separation (n), residual, scale. Returns status and iterations, or
// None if the arguments are anything but plain arrays of the right shape and of finite numbers.
nb::object solve_one(const nb::object& structure, const nb::object& wrench, const Prepared& prepared,
                     const ExactSettings& settings, const InOut<1>& numbers) {
  const std::size_t n = prepared.n, m = prepared.m;
  const auto matrix = as_is<2>(structure);
  const auto vector = as_is<1>(wrench);
  if (!matrix.is_valid() || !vector.is_valid()) return nb::none();
  if (!is_aligned(matrix) || !is_aligned(vector)) return nb::none();
  if (!has_shape(matrix, n, m) || !has_shape(vector, n)) return nb::none();
  const Batch batch{1,
                    static_cast<int>(n),
                    static_cast<int>(m),
                    {matrix.data(), 0},
                    {vector.data(), 0},
                    {prepared.lower, 0},
                    {prepared.upper, 0},
                    {prepared.reference, 0},
                    prepared.weights};
  require(numbers.size() == m + 2 * n + 2, "numbers has the wrong size");
  std::int64_t iterations;
  std::int8_t status;
  std::atomic<bool> flawed{false};
  double* out = numbers.data();
  const SweepAnswer answer{out, out + m + n, out + m, out + m + 2 * n, out + m + 2 * n + 1, &status, &iterations};
  if (!BlockSolver<1>(batch, settings, answer, flawed).solve(0, 1)) return nb::none();
  return nb::make_tuple(static_cast<int>(status), iterations);
}

// One problem a call, with the same limits, reference and weights.
class Single {
 public:
  using Vector = Contiguous<double, 1>;

  Single(const Vector& lower, const Vector& upper, const Vector& reference, const Vector& weights, int policy,
         double largest, double tolerance, double rank_tolerance)
      : lower_(to_vector(lower)),
        upper_(to_vector(upper)),
        reference_(to_vector(reference)),
        weights_(to_vector(weights)),
        settings_{to_policy(policy), largest, tolerance, rank_tolerance} {
    require_size(weights_.size(), lower_.size());
    require(upper_.size() == lower_.size() && reference_.size() == lower_.size(),
            "limits and reference have not the same length");
  }

  nb::object solve(const nb::object& structure, const nb::object& wrench, const InOut<1>& numbers) const {
    return solve_one(
        structure, wrench,
        {lower_.data(), upper_.data(), reference_.data(), weights_.data(), weights_.size(), lower_.size()},
        settings_, numbers);
  }

 private:
  std::vector<double> lower_, upper_, reference_, weights_;
  ExactSettings settings_;
};

// One problem, as `Single`, with the reference 0, the lower limits or the middle of the limits. None also where
// the limits are no plain arrays, cross, or are not finite.
enum class Reference { kZero, kLower, kMiddle };

nb::object allocate_once(const nb::object& structure, const nb::object& wrench, const nb::object& lower,
                         const nb::object& upper, int reference, int policy, double largest, double tolerance,
                         double rank_tolerance, const InOut<1>& numbers) {
  const auto low = as_is<1>(lower), high = as_is<1>(upper), desired = as_is<1>(wrench);
  if (!low.is_valid() || !high.is_valid() || !desired.is_valid()) return nb::none();
  if (!is_aligned(low) || !is_aligned(high)) return nb::none();
  const std::size_t n = desired.shape(0), m = low.shape(0);
  if (high.shape(0) != m || n < 1 || n > kMaxComponents || m < 1 || m > kMaxCables) return nb::none();
  const auto kind = static_cast<Reference>(reference);
  double target[kMaxCables], weights[kMaxComponents];
  for (std::size_t j = 0; j < m; ++j) {
    const double least = low(j), most = high(j);
    if (!(-largest < least && least <= most && most < largest)) return nb::none();
    target[j] = kind == Reference::kZero ? 0.0 : kind == Reference::kLower ? least : (least + most) / 2;
  }
  std::fill(weights, weights + n, 1.0);
  return solve_one(structure, wrench, {low.data(), high.data(), target, weights, n, m},
                   {to_policy(policy), largest, tolerance, rank_tolerance}, numbers);
}

}  // namespace

void bind_allocate(nb::module_& module) {
  module.def("allocate", &allocate_batch);
  nb::class_<Single>(module, "Single")
      .def(nb::init<const Single::Vector&, const Single::Vector&, const Single::Vector&, const Single::Vector&,
                    int, double, double, double>())
      .def("__call__", &Single::solve);
  module.def("allocate_once", &allocate_once);
}

}  // namespace tensionlab
