// Eight lanes: x86-64-v4 (AVX-512).
#define TENSIONLAB_BUILD avx512
#include "newton_batch.hpp"

namespace tensionlab {

void newton_avx512(const Batch& batch, Policy policy, double rank_tolerance, std::size_t begin, std::size_t end,
                   const NewtonAnswer& answer) {
  newton_lanes<8>(batch, policy, rank_tolerance, begin, end, answer);
}

}  // namespace tensionlab
