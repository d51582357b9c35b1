// The exact solver over a batch of problems (tensionlab/solvers/newton_batch.hpp).
#include "solvers/kernels.hpp"
#include "tensionlab/solvers/newton_batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

void newton(const Batch& batch, Policy policy, double rank_tolerance, double tolerance, const Selection& rows,
            std::size_t directed, const NewtonAnswer& answer) {
  constexpr int kChunk = 512;
  with_size(batch.n, [&](auto n) {
    NewtonBatch<double, TENSIONLAB_LANES, n, kMaxCables, kChunk>(batch, policy, rank_tolerance, tolerance, answer)
        .solve(rows, directed);
  });
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
