// The first attempt at a batch; compiled once for each instruction set (simd/instruction_set.hpp).
#include "solvers/sweep.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int N>
void sweep_of_size(const Batch& batch, const SweepSettings& settings, std::size_t begin, std::size_t end,
                   const SweepAnswer& answer, SweepRest& rest) {
  Sweep<TENSIONLAB_LANES, N, kMaxCables>(batch, settings, answer, rest).solve(begin, end);
}

void sweep(const Batch& batch, const SweepSettings& settings, std::size_t begin, std::size_t end,
           const SweepAnswer& answer, SweepRest& rest) {
  static constexpr decltype(&sweep) kSweep[] = {sweep_of_size<1>, sweep_of_size<2>, sweep_of_size<3>,
                                                sweep_of_size<4>, sweep_of_size<5>, sweep_of_size<6>};
  kSweep[batch.n - 1](batch, settings, begin, end, answer, rest);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
