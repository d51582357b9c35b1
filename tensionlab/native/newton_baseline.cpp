// Two lanes: for any processor, with the instructions that every one of its kind has.
#define TENSIONLAB_BUILD baseline
#include "newton_batch.hpp"

namespace tensionlab {

void newton_baseline(const Batch& batch, Policy policy, double rank_tolerance, std::size_t begin, std::size_t end,
                     const NewtonAnswer& answer) {
  newton_lanes<2>(batch, policy, rank_tolerance, begin, end, answer);
}

}  // namespace tensionlab
