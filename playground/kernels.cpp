// Kernels of the playground as one WebAssembly module: structure matrices, allocation with its proof, capacity
// margins and the half-spaces of the wrench set. The page writes its input into the arrays of `Page`, calls a
// function, and reads the answer from the same arrays.
#define TENSIONLAB_BASELINE
#include "workspace/kernels.hpp"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "solvers/block_solver.hpp"
#include "solvers/closed_form.hpp"
#include "solvers/kernels.hpp"
#include "solvers/linear_program.hpp"
#include "verification/kernels.hpp"

#define EXPORT(name) extern "C" __attribute__((export_name(#name)))

// All that the kernels ask of a system: a page has no environment, and its processor no fused multiplication. Each
// product's rounding error is found by splitting its factors (Dekker, 1971), so that the sum is good to twice the
// precision, and exact where it is the error of a product.
extern "C" char* getenv(const char*) { return nullptr; }

extern "C" double fma(double x, double y, double z) {
  constexpr double kSplitter = 0x1p27 + 1;
  const double scaled_x = kSplitter * x, high_x = scaled_x - (scaled_x - x), low_x = x - high_x;
  const double scaled_y = kSplitter * y, high_y = scaled_y - (scaled_y - y), low_y = y - high_y;
  const double product = x * y, sum = product + z, added = sum - product;
  const double product_error = low_x * low_y - (((product - high_x * high_y) - low_x * high_y) - high_x * low_y);
  return sum + (((product - (sum - added)) + (z - added)) + product_error);
}

namespace tensionlab {

void checkpoint() {}  // a page has no signals to handle

namespace {

constexpr double kTolerance = 1e-6, kRankTolerance = 1e-8, kLargest = 1e100, kLeastShare = 1e-12;
constexpr std::size_t kPoses = 65'536, kBlock = 512, kHalfSpaces = 4096, kWrenches = 64;

struct Page {
  double anchors[3 * kMaxCables], attachments[3 * kMaxCables];
  double lower[kMaxCables], upper[kMaxCables], reference[kMaxCables], weights[kMaxComponents];
  double rotation[9], wrench[kMaxComponents], required[kWrenches * kMaxComponents];
  double structure[kMaxComponents * kMaxCables], tensions[kMaxCables];
  double rendered[kMaxComponents], separation[kMaxComponents], residual, scale;
  double normals[kHalfSpaces * kMaxComponents], offsets[kHalfSpaces];
  double positions[3 * kPoses], margins[kPoses];
} page;

int n, d, m;
bool turns;

double matrices[kBlock * kMaxComponents * kMaxCables];

// Writes the structure matrices of positions [first, first + count); `valid` tells where every cable has a length.
void find_structures(std::size_t first, std::size_t count, double* structures, bool* valid) {
  const Rows rotation{page.rotation, 0};
  baseline::structure_matrices({d, m, page.anchors, turns ? page.attachments : nullptr, nullptr, nullptr},
                               {{page.positions + first * d, d}, turns ? &rotation : nullptr}, kLeastShare, 0,
                               count, {structures, valid});
}

// Solvers in the order in which the page lists them.
enum class Solver { newton, closed_form, least_sum, minimax, safe };

// Writes the tensions of a solver other than newton.
void choose(Solver solver, Batch batch) {
  if (solver == Solver::closed_form) {
    static double middle[kMaxCables];
    for (int i = 0; i < m; ++i) middle[i] = (page.lower[i] + page.upper[i]) / 2;
    batch.reference = {middle, 0};
    with_size(n, [&](auto size) {
      improved_closed_form<double, size, kMaxCables>(batch[0], m, kRankTolerance, page.tensions);
    });
    return;
  }
  // Of the tensions that are best for a linear program, those closest to the reference.
  static double lower[kMaxCables], upper[kMaxCables], costs[kMaxCables], multipliers[kMaxComponents];
  std::fill(costs, costs + m, 1.0);
  const Program program = solver == Solver::least_sum ? Program::least_cost
                          : solver == Solver::minimax ? Program::minimax
                                                      : Program::safe;
  with_size<kMaxComponents + 1>(n + (program == Program::least_cost ? 1 : 0), [&](auto size) {
    TensionProgram<double, size, kMaxCables>(m, program, 1.0).tighten(batch[0], costs, lower, upper, multipliers);
  });
  std::int64_t iterations = 0;
  batch.lower = {lower, 0};
  batch.upper = {upper, 0};
  baseline::newton(batch, Policy::force, kRankTolerance, kTolerance, {0, 1}, 0,
                   {page.tensions, page.separation, &iterations});
}

}  // namespace

// Address of the first of the arrays; the page knows their order and sizes.
EXPORT(page_address) double* page_address() { return page.anchors; }

EXPORT(set_rig) void set_rig(int components, int dimension, int cables) {
  n = components;
  d = dimension;
  m = cables;
  turns = n > d;
  std::fill(page.weights, page.weights + n, 1.0);
  std::fill(page.reference, page.reference + m, 0.0);
}

// Solves and verifies the wrench at the first position; returns the status, or -2 where a cable has no length
// or a number is too large. The policy is newton's: the others promise nothing where the wrench is infeasible.
EXPORT(allocate) int allocate(int solver_index, int policy_index) {
  bool valid = false;
  find_structures(0, 1, page.structure, &valid);
  if (!valid) return -2;
  const Problem<double> problem{page.structure, page.wrench, page.lower, page.upper, page.reference};
  const Batch batch = batch_of_one<double>(n, m, problem, page.weights);
  std::int8_t status = 0;
  std::atomic<bool> flawed{false};
  const auto solver = static_cast<Solver>(solver_index);
  if (solver != Solver::newton) {
    choose(solver, batch);
    std::fill(page.separation, page.separation + n, 0.0);
    const VerificationSettings settings{Rule::none, kTolerance, kRankTolerance};
    const Findings findings{page.tensions, page.separation, page.rendered, &page.residual,
                            &page.scale,   &status,         &flawed};
    baseline::verify(batch, settings, {0, 1}, findings);
    return status;
  }
  const AllocationSettings settings{rule_of(static_cast<Policy>(policy_index)), kLargest, kTolerance,
                                    kRankTolerance};
  std::int64_t iterations = 0;
  const SweepAnswer answer{page.tensions, page.separation, page.rendered, &page.residual,
                           &page.scale,   &status,         &iterations};
  return BlockSolver<1>(batch, settings, answer, flawed).solve(0, 1) ? status : -2;
}

// Writes the half-spaces of the wrench set at the pose of the last allocation; returns their number.
EXPORT(find_half_spaces) int find_half_spaces() {
  double count = 0;
  baseline::half_spaces({1, n, m, {page.structure, 0}, {page.lower, 0}, {page.upper, 0}, kRankTolerance},
                        kHalfSpaces, 0, 1, {&count, page.normals, page.offsets});
  return static_cast<int>(std::min(count, static_cast<double>(kHalfSpaces)));
}

// Writes the capacity margin about `wrenches` required ones at the first `count` positions, torques divided by
// `length`; -infinity where a cable has no length.
EXPORT(find_margins) void find_margins(int count, int wrenches, double length) {
  static bool valid[kBlock];
  static double scaled[kWrenches * kMaxComponents];
  for (int i = 0; i < wrenches * n; ++i) scaled[i] = page.required[i] / (i % n < d ? 1.0 : length);
  const auto entries = static_cast<std::size_t>(n * m);
  for (std::size_t first = 0; first < static_cast<std::size_t>(count); first += kBlock) {
    const std::size_t size = std::min(kBlock, static_cast<std::size_t>(count) - first);
    find_structures(first, size, matrices, valid);
    for (std::size_t row = 0; row < size; ++row) {
      for (std::size_t i = static_cast<std::size_t>(d * m); i < entries; ++i)
        matrices[row * entries + i] /= length;
    }
    baseline::capacity_margin({size, n, m, {matrices, n * m}, {page.lower, 0}, {page.upper, 0}, kRankTolerance},
                              {{scaled, 0}, wrenches}, 0, size, page.margins + first);
    for (std::size_t row = 0; row < size; ++row) {
      if (!valid[row]) page.margins[first + row] = -1e300;
    }
  }
}

}  // namespace tensionlab
