// Four lanes: x86-64-v3 (AVX2 and FMA).
#define TENSIONLAB_BUILD avx2
#include "newton_batch.hpp"

namespace tensionlab {

void newton_avx2(const Batch& batch, Policy policy, double rank_tolerance, std::size_t begin, std::size_t end,
                 const NewtonAnswer& answer) {
  newton_lanes<4>(batch, policy, rank_tolerance, begin, end, answer);
}

}  // namespace tensionlab
