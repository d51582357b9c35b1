// The solvers by dual ascent over a batch of problems; compiled once for each instruction set
// (simd/instruction_set.hpp).
#include <cmath>

#include "simd/lane_scheduler.hpp"
#include "solvers/box_price.hpp"
#include "solvers/dual_ascent.hpp"
#include "solvers/log_barrier.hpp"
#include "solvers/slack_norm.hpp"
#include "solvers/smooth_batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

constexpr int kLanes = TENSIONLAB_LANES;

template <int N, class Law>
void ascend(const Law& law, const Batch& batch, std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
  DualAscent<Law, double, kLanes, N, kMaxCables> block(batch.m, law);
  const auto m = static_cast<std::size_t>(batch.m);
  refill<kLanes>(block, batch, begin, end, [&](int l, std::size_t row) {
    answer.iterations[row] = block.store(l, answer.tensions + row * m);
  });
}

template <int N>
void log_barrier_of_size(const Batch& batch, std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
  LogBarrier<double, kLanes, N, kMaxCables> law{};
  for (int k = 0; k < N; ++k) law.weight_roots[k] = std::sqrt(batch.weights[k]);
  ascend<N>(law, batch, begin, end, answer);
}

template <int N>
void slack_norm_of_size(const Batch& batch, const SlackPrices& prices, std::size_t begin, std::size_t end,
                        const SmoothAnswer& answer) {
  SlackNorm<double, kLanes, N, kMaxCables> law{};
  law.prices = prices;
  for (int k = 0; k < N; ++k) law.weight_roots[k] = std::sqrt(batch.weights[k]);
  ascend<N>(law, batch, begin, end, answer);
}

template <int N>
void box_price_of_size(const Batch& batch, const double* row_roots, std::size_t begin, std::size_t end,
                       const SmoothAnswer& answer) {
  BoxPrice<double, kLanes, N, kMaxCables> law{};
  for (int k = 0; k < N; ++k) law.row_roots[k] = row_roots[k];
  ascend<N>(law, batch, begin, end, answer);
}

void log_barrier(const Batch& batch, std::size_t begin, std::size_t end, const SmoothAnswer& answer) {
  static constexpr decltype(&log_barrier) kSolve[] = {log_barrier_of_size<1>, log_barrier_of_size<2>,
                                                      log_barrier_of_size<3>, log_barrier_of_size<4>,
                                                      log_barrier_of_size<5>, log_barrier_of_size<6>};
  kSolve[batch.n - 1](batch, begin, end, answer);
}

void slack_norm(const Batch& batch, const SlackPrices& prices, std::size_t begin, std::size_t end,
                const SmoothAnswer& answer) {
  static constexpr decltype(&slack_norm) kSolve[] = {slack_norm_of_size<1>, slack_norm_of_size<2>,
                                                     slack_norm_of_size<3>, slack_norm_of_size<4>,
                                                     slack_norm_of_size<5>, slack_norm_of_size<6>};
  kSolve[batch.n - 1](batch, prices, begin, end, answer);
}

void box_price(const Batch& batch, const double* row_roots, std::size_t begin, std::size_t end,
               const SmoothAnswer& answer) {
  static constexpr decltype(&box_price) kSolve[] = {box_price_of_size<1>, box_price_of_size<2>,
                                                    box_price_of_size<3>, box_price_of_size<4>,
                                                    box_price_of_size<5>, box_price_of_size<6>};
  kSolve[batch.n - 1](batch, row_roots, begin, end, answer);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
