// The exact solver with its verification for Python: block by block, so that verification finds the numbers in the
// cache, where the solver left them.
#include <algorithm>
#include <cmath>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "solvers/kernels.hpp"
#include "verification/kernels.hpp"

namespace tensionlab {
namespace {

constexpr std::size_t kBlock = 512;
constexpr std::int8_t kUnverified = -1;
constexpr std::size_t kEntriesEnough = 65'536;  // entries of structure matrices that are worth a thread

struct Settings {
  Policy policy;
  double largest, tolerance, rank_tolerance;

  VerificationSettings verification() const {
    return {policy == Policy::force     ? Rule::force
            : policy == Policy::tension ? Rule::tension
                                        : Rule::direction,
            tolerance, rank_tolerance};
  }
};

// Solves and verifies blocks of rows: a sweep, and Newton steps for those that it leaves. One for each thread.
class Allocation {
 public:
  Allocation(const Batch& batch, const Settings& settings, const SweepAnswer& answer, std::atomic<bool>& flawed)
      : batch_(batch), settings_(settings), answer_(answer), flawed_(flawed) {}

  // Rows [begin, end), a block at most; returns false if an entry of a structure matrix or a wrench is NaN or too
  // large.
  bool solve(std::size_t begin, std::size_t end) {
    SweepRemainder remainder{rows_, unsolved_};
    if (has(Route::sweep)) {
      sweep_for_this_processor()(batch_, {settings_.largest, settings_.tolerance}, begin, end, answer_, remainder);
    } else {
      remainder.invalid = true;
      for (std::size_t row = begin; row < end; ++row) unsolved_[remainder.unsolved_count++] = row;
    }
    std::copy_n(unsolved_, remainder.unsolved_count, rows_ + remainder.separated_count);
    const Selection rest{0, remainder.separated_count + remainder.unsolved_count, rows_};
    if (rest.count == 0) return true;
    if (remainder.invalid && !all_within(rest)) return false;
    for (std::size_t j = 0; j < rest.count; ++j) answer_.status[rows_[j]] = kUnverified;
    newton_for_this_processor()(batch_, settings_.policy, settings_.rank_tolerance, settings_.tolerance, rest,
                                remainder.separated_count,
                                {answer_.tensions, answer_.separation, answer_.iterations, answer_.status,
                                 answer_.rendered, answer_.residual, answer_.scale});
    std::size_t* const unverified_end = std::remove_if(
        rows_, rows_ + rest.count, [&](std::size_t row) { return answer_.status[row] != kUnverified; });
    verify_for_this_processor()(batch_, settings_.verification(),
                                {0, static_cast<std::size_t>(unverified_end - rows_), rows_},
                                {answer_.tensions, answer_.separation, answer_.rendered, answer_.residual,
                                 answer_.scale, answer_.status, &flawed_});
    return true;
  }

 private:
  // Whether all entries of structure matrices and wrenches are below the limit in magnitude.
  bool all_within(const Selection& rows) const {
    const auto n = static_cast<std::size_t>(batch_.n), m = static_cast<std::size_t>(batch_.m);
    const auto inside = [&](double number) { return std::abs(number) < settings_.largest; };
    for (std::size_t j = 0; j < rows.count; ++j) {
      const double *structure = batch_.structure[rows[j]], *wrench = batch_.wrench[rows[j]];
      if (!std::all_of(structure, structure + n * m, inside) || !std::all_of(wrench, wrench + n, inside))
        return false;
    }
    return true;
  }

  const Batch& batch_;
  const Settings& settings_;
  const SweepAnswer& answer_;
  std::atomic<bool>& flawed_;
  std::size_t rows_[kBlock], unsolved_[kBlock];
};

// None if an entry is NaN or too large.
nb::object allocate_batch(const ProblemArrays& arrays, int policy, double largest, double tolerance,
                          double rank_tolerance) {
  const Batch batch = batch_of(arrays);
  const Settings settings{to_policy(policy), largest, tolerance, rank_tolerance};
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
        Allocation allocation(batch, settings, answer, flawed);
        for (std::size_t row = begin; row < end && !invalid; row += kBlock) {
          if (!allocation.solve(row, std::min(row + kBlock, end))) invalid = true;
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
                     const Settings& settings, const InOut<1>& numbers) {
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
  if (!Allocation(batch, settings, answer, flawed).solve(0, 1)) return nb::none();
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
  Settings settings_;
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
