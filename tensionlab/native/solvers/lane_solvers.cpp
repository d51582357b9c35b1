// The solvers that run in lanes: the exact one, Dykstra's projections and those by dual ascent.
#include <algorithm>
#include <cmath>

#include "solvers/tension_solver.hpp"

namespace tensionlab {

bool TensionSolver::allocate(const Batch& batch, const AllocationSettings& settings, std::size_t begin,
                             std::size_t end, const SweepAnswer& answer, std::atomic<bool>& flawed) const {
  if (own_allocate) return own_allocate(batch, settings, begin, end, answer, flawed);
  const Selection rows{begin, end - begin};
  if (!all_within(batch, rows, settings.largest)) return false;
  const auto n = static_cast<std::size_t>(batch.n);
  std::fill(answer.separation + begin * n, answer.separation + end * n, 0.0);
  choose(batch, settings.policy(), begin, end, {answer.tensions, answer.separation, answer.iterations});
  verify_for_this_processor()(batch, settings.verification(), rows,
                              {answer.tensions, answer.separation, answer.rendered, answer.residual, answer.scale,
                               answer.status, &flawed});
  return true;
}

TensionSolver make_newton(double rank_tolerance, double tolerance) {
  TensionSolver solver;
  solver.choose = [=](const Batch& batch, Policy policy, std::size_t begin, std::size_t end,
                      const NewtonAnswer& answer) {
    newton_for_this_processor()(batch, policy, rank_tolerance, tolerance, {begin, end - begin}, 0, answer);
  };
  solver.separates = true;
  solver.own_allocate = [](const Batch& batch, const AllocationSettings& settings, std::size_t begin,
                           std::size_t end, const SweepAnswer& answer, std::atomic<bool>& flawed) {
    if (end - begin == 1) return BlockSolver<1>(batch, settings, answer, flawed).solve(begin, end);
    return BlockSolver<TensionSolver::kBlock>(batch, settings, answer, flawed).solve(begin, end);
  };
  solver.entries_enough = 65'536;
  return solver;
}

namespace {

// By kernel(batch, settings..., begin, end, answer).
template <class Kernel, class... Settings>
TensionSolver make_lane_solver(Kernel kernel, const Settings&... settings) {
  return {[=](const Batch& batch, Policy, std::size_t begin, std::size_t end, const NewtonAnswer& answer) {
    kernel(batch, settings..., begin, end, {answer.tensions, answer.iterations});
  }};
}

}  // namespace

TensionSolver make_dykstra(const DykstraSettings& settings) {
  TensionSolver solver = make_lane_solver(dykstra_for_this_processor(), settings);
  solver.brief = false;
  return solver;
}

TensionSolver make_log_barrier() { return make_lane_solver(log_barrier_for_this_processor()); }

TensionSolver make_slack_norm(const SlackPrices& prices) {
  return make_lane_solver(slack_norm_for_this_processor(), prices);
}

TensionSolver make_box_price(double mu, double force, double torque) {
  return {[=](const Batch& batch, Policy, std::size_t begin, std::size_t end, const NewtonAnswer& answer) {
    double roots[kMaxComponents];  // of the prices of the rows over mu
    for (int k = 0; k < batch.n; ++k) roots[k] = std::sqrt((k < 3 ? force : torque) * batch.weights[k] / mu);
    Batch priced = batch;
    priced.weights = roots;
    box_price_for_this_processor()(priced, begin, end, {answer.tensions, answer.iterations});
  }};
}

}  // namespace tensionlab
