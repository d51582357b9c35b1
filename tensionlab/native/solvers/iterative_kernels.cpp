// Dykstra's projections and the solvers by dual ascent over a batch of problems.
#include <cmath>

#include "solvers/dual_ascent.hpp"
#include "solvers/dykstra.hpp"
#include "solvers/kernels.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

constexpr int kLanes = TENSIONLAB_LANES;

template <class Block>
void solve_rows(Block& block, const Batch& batch, std::size_t begin, std::size_t end,
                const IterativeAnswer& answer) {
  const auto m = static_cast<std::size_t>(batch.m);
  refill<kLanes>(
      block, begin, end, [&](int l, std::size_t row) { block.load(l, batch[row]); },
      [&](int l, std::size_t row) { answer.iterations[row] = block.store(l, answer.tensions + row * m); });
}

template <int N, class Law>
void ascend(const Law& law, const Batch& batch, std::size_t begin, std::size_t end,
            const IterativeAnswer& answer) {
  DualAscent<Law, double, kLanes, N, kMaxCables> block(batch.m, law);
  solve_rows(block, batch, begin, end, answer);
}

void dykstra(const Batch& batch, const DykstraSettings& settings, std::size_t begin, std::size_t end,
             const IterativeAnswer& answer) {
  with_size(batch.n, [&](auto n) {
    Dykstra<double, kLanes, n, kMaxCables> block(batch.m, settings.tolerance, settings.iteration_limit,
                                                 settings.rank_tolerance);
    solve_rows(block, batch, begin, end, answer);
  });
}

void log_barrier(const Batch& batch, std::size_t begin, std::size_t end, const IterativeAnswer& answer) {
  with_size(batch.n, [&](auto n) {
    LogBarrier<double, kLanes, n, kMaxCables> law{};
    for (int k = 0; k < n; ++k) law.weight_roots[k] = std::sqrt(batch.weights[k]);
    ascend<n>(law, batch, begin, end, answer);
  });
}

void slack_norm(const Batch& batch, const SlackPrices& prices, std::size_t begin, std::size_t end,
                const IterativeAnswer& answer) {
  with_size(batch.n, [&](auto n) {
    SlackNorm<double, kLanes, n, kMaxCables> law{};
    law.prices = prices;
    for (int k = 0; k < n; ++k) law.weight_roots[k] = std::sqrt(batch.weights[k]);
    ascend<n>(law, batch, begin, end, answer);
  });
}

void box_price(const Batch& batch, std::size_t begin, std::size_t end, const IterativeAnswer& answer) {
  with_size(batch.n, [&](auto n) {
    BoxPrice<double, kLanes, n, kMaxCables> law{};
    for (int k = 0; k < n; ++k) law.row_roots[k] = batch.weights[k];
    ascend<n>(law, batch, begin, end, answer);
  });
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
