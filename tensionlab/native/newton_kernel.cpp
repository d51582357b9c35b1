// The exact solver over a batch of problems; compiled once for each instruction set (instruction_set.hpp).
#include <cmath>

#include "newton.hpp"
#include "newton_batch.hpp"
#include "refill.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int N>
void newton_of_size(const Batch& batch, Policy policy, double rank_tolerance, std::size_t begin, std::size_t end,
                    const NewtonAnswer& answer) {
  constexpr int kLanes = TENSIONLAB_LANES;
  double roots[N];
  for (int k = 0; k < N; ++k) roots[k] = std::sqrt(batch.weights[k]);
  Newton<double, kLanes, N, kMaxCables> block(batch.m, roots, policy, rank_tolerance);
  const auto m = static_cast<std::size_t>(batch.m);
  refill<kLanes>(block, batch, begin, end, [&](int l, std::size_t row) {
    answer.iterations[row] = block.store(l, answer.tensions + row * m, answer.separation + row * N);
  });
}

void newton(const Batch& batch, Policy policy, double rank_tolerance, std::size_t begin, std::size_t end,
            const NewtonAnswer& answer) {
  static constexpr decltype(&newton) kSolve[] = {newton_of_size<1>, newton_of_size<2>, newton_of_size<3>,
                                                 newton_of_size<4>, newton_of_size<5>, newton_of_size<6>};
  kSolve[batch.n - 1](batch, policy, rank_tolerance, begin, end, answer);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
