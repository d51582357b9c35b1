// Dykstra's projections over a batch of problems; compiled once for each instruction set
// (simd/instruction_set.hpp).
#include "simd/lane_scheduler.hpp"
#include "solvers/dykstra.hpp"
#include "solvers/dykstra_batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int N>
void dykstra_of_size(const Batch& batch, const DykstraSettings& settings, std::size_t begin, std::size_t end,
                     const DykstraAnswer& answer) {
  constexpr int kLanes = TENSIONLAB_LANES;
  Dykstra<double, kLanes, N, kMaxCables> block(batch.m, settings.tolerance, settings.iteration_limit,
                                               settings.rank_tolerance);
  const auto m = static_cast<std::size_t>(batch.m);
  refill<kLanes>(block, batch, begin, end, [&](int l, std::size_t row) {
    answer.iterations[row] = block.store(l, answer.tensions + row * m);
  });
}

void dykstra(const Batch& batch, const DykstraSettings& settings, std::size_t begin, std::size_t end,
             const DykstraAnswer& answer) {
  static constexpr decltype(&dykstra) kSolve[] = {dykstra_of_size<1>, dykstra_of_size<2>, dykstra_of_size<3>,
                                                  dykstra_of_size<4>, dykstra_of_size<5>, dykstra_of_size<6>};
  kSolve[batch.n - 1](batch, settings, begin, end, answer);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
