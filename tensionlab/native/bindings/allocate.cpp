// The exact solver and its verification, together, for Python: block by block, so that verification finds the
// numbers where the solver left them, in the cache.
#include <algorithm>
#include <cmath>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "bindings/share_out.hpp"
#include "solvers/newton_batch.hpp"
#include "solvers/sweep_batch.hpp"
#include "verification/certificates_batch.hpp"

namespace tensionlab {
namespace {

constexpr std::size_t kBlock = 512;
constexpr std::int8_t kUnverified = -1;
constexpr std::size_t kEntriesEnough = 65'536;  // of structure matrices, for a thread

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

// The exact solver with its verification, block after block: a sweep, and what is sure for those that it leaves.
// One for each thread.
class Allocation {
 public:
  Allocation(const Batch& batch, const Settings& settings, const SweepAnswer& answer, std::atomic<bool>& flawed)
      : batch_(batch), settings_(settings), answer_(answer), flawed_(flawed) {}

  // Rows [begin, end), a block at most; false if an entry of a structure matrix or a wrench is not a number, or
  // too large.
  bool solve(std::size_t begin, std::size_t end) {
    SweepRest rest{left_, unsure_};
    sweep_for_this_processor()(batch_, {settings_.largest, settings_.tolerance}, begin, end, answer_, rest);
    std::copy_n(unsure_, rest.unsures, left_ + rest.aparts);
    const Selection left{0, rest.aparts + rest.unsures, left_};
    if (left.count == 0) return true;
    if (rest.strange && !all_within(left)) return false;
    for (std::size_t j = 0; j < left.count; ++j) answer_.status[left_[j]] = kUnverified;
    newton_for_this_processor()(batch_, settings_.policy, settings_.rank_tolerance, settings_.tolerance, left,
                                rest.aparts,
                                {answer_.tensions, answer_.separation, answer_.iterations, answer_.status,
                                 answer_.rendered, answer_.residual, answer_.scale});
    std::size_t* const unverified_end = std::remove_if(
        left_, left_ + left.count, [&](std::size_t row) { return answer_.status[row] != kUnverified; });
    verify_for_this_processor()(batch_, settings_.verification(),
                                {0, static_cast<std::size_t>(unverified_end - left_), left_},
                                {answer_.tensions, answer_.separation, answer_.rendered, answer_.residual,
                                 answer_.scale, answer_.status, &flawed_});
    return true;
  }

 private:
  // Whether all numbers of structure matrices and wrenches are below the limit in magnitude.
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
  std::size_t left_[kBlock], unsure_[kBlock];  // rows
};

// None if an entry is not a number, or too large.
nb::object allocate_batch(const In<3>& structure, const In<2>& wrench, const In<2>& lower, const In<2>& upper,
                          const In<2>& reference, const In<1>& weights, int policy, double largest,
                          double tolerance, double rank_tolerance) {
  const Batch batch = batch_of(structure, wrench, lower, upper, reference, weights);
  require(policy >= 0 && policy < kPolicies, "no such policy");
  const Settings settings{static_cast<Policy>(policy), largest, tolerance, rank_tolerance};
  const auto n = static_cast<std::size_t>(batch.n), m = static_cast<std::size_t>(batch.m);
  std::atomic<bool> flawed{false}, strange{false};
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
        Allocation rows(batch, settings, answer, flawed);
        for (std::size_t row = begin; row < end && !strange; row += kBlock) {
          if (!rows.solve(row, std::min(row + kBlock, end))) strange = true;
        }
      },
      kEntriesEnough / (n * m));
  if (strange) return nb::none();
  return nb::make_tuple(tensions, rendered, residual, status, scale, iterations, separation);
}

// One problem; its limits, reference and weights have as many entries as cables and components.
struct Prepared {
  const double *lower, *upper, *reference, *weights;
  std::size_t n, m;
};

using Plain = nb::device::cpu;

using Numbers = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// numbers: tensions (m), rendered wrench (n), separation (n), residual, scale. Returns status and iterations; None
// if the arguments are anything but plain arrays of the right shape and of finite numbers.
nb::object solve_one(const nb::object& structure, const nb::object& wrench, const Prepared& prepared,
                     const Settings& settings, const Numbers& numbers) {
  const std::size_t n = prepared.n, m = prepared.m;
  nb::ndarray<const double, nb::numpy, nb::ndim<2>, nb::c_contig, Plain> matrix;
  nb::ndarray<const double, nb::numpy, nb::ndim<1>, nb::c_contig, Plain> vector;
  if (!nb::try_cast(structure, matrix, false) || !nb::try_cast(wrench, vector, false)) return nb::none();
  if (!matrix.is_valid() || !vector.is_valid()) return nb::none();  // of None
  if (!is_aligned(matrix) || !is_aligned(vector)) return nb::none();
  if (matrix.shape(0) != n || matrix.shape(1) != m || vector.shape(0) != n) return nb::none();
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

// One problem a call, with limits, reference and weights that stay.
class Single {
 public:
  Single(const In<1>& lower, const In<1>& upper, const In<1>& reference, const In<1>& weights, int policy,
         double largest, double tolerance, double rank_tolerance)
      : lower_(copy(lower)),
        upper_(copy(upper)),
        reference_(copy(reference)),
        weights_(copy(weights)),
        settings_{static_cast<Policy>(policy), largest, tolerance, rank_tolerance} {
    require_size(weights_.size(), lower_.size());
    require(upper_.size() == lower_.size() && reference_.size() == lower_.size(),
            "limits and reference have not the same length");
    require(policy >= 0 && policy < kPolicies, "no such policy");
  }

  nb::object solve(const nb::object& structure, const nb::object& wrench, const Numbers& numbers) const {
    return solve_one(
        structure, wrench,
        {lower_.data(), upper_.data(), reference_.data(), weights_.data(), weights_.size(), lower_.size()},
        settings_, numbers);
  }

 private:
  static std::vector<double> copy(const In<1>& array) {
    std::vector<double> numbers(array.shape(0));
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = array(i);
    return numbers;
  }

  std::vector<double> lower_, upper_, reference_, weights_;
  Settings settings_;
};

// One problem, as `Single`, with the reference 0, the lower limits or the middle of the limits. None also where
// the limits are not plain, cross, or are not finite.
enum class Reference { kZero, kLower, kMiddle };

nb::object allocate_once(const nb::object& structure, const nb::object& wrench, const nb::object& lower,
                         const nb::object& upper, int reference, int policy, double largest, double tolerance,
                         double rank_tolerance, const Numbers& numbers) {
  nb::ndarray<const double, nb::numpy, nb::ndim<1>, nb::c_contig, Plain> low, high, desired;
  if (!nb::try_cast(lower, low, false) || !nb::try_cast(upper, high, false) ||
      !nb::try_cast(wrench, desired, false))
    return nb::none();
  if (!low.is_valid() || !high.is_valid() || !desired.is_valid()) return nb::none();
  if (!is_aligned(low) || !is_aligned(high)) return nb::none();
  const std::size_t n = desired.shape(0), m = low.shape(0);
  if (high.shape(0) != m || n < 1 || n > kMaxComponents || m < 1 || m > kMaxCables) return nb::none();
  require(policy >= 0 && policy < kPolicies, "no such policy");
  const auto kind = static_cast<Reference>(reference);
  double target[kMaxCables], weights[kMaxComponents];
  for (std::size_t j = 0; j < m; ++j) {
    const double least = low(j), most = high(j);
    if (!(-largest < least && least <= most && most < largest)) return nb::none();
    target[j] = kind == Reference::kZero ? 0.0 : kind == Reference::kLower ? least : (least + most) / 2;
  }
  std::fill(weights, weights + n, 1.0);
  return solve_one(structure, wrench, {low.data(), high.data(), target, weights, n, m},
                   {static_cast<Policy>(policy), largest, tolerance, rank_tolerance}, numbers);
}

}  // namespace

void bind_allocate(nb::module_& module) {
  module.def("allocate", &allocate_batch);
  nb::class_<Single>(module, "Single")
      .def(nb::init<const In<1>&, const In<1>&, const In<1>&, const In<1>&, int, double, double, double>())
      .def("__call__", &Single::solve);
  module.def("allocate_once", &allocate_once);
}

}  // namespace tensionlab
