// Cells of positions proved inside or outside; compiled once for each instruction set (simd/instruction_set.hpp).
#include "simd/checkpoint.hpp"
#include "workspace/cell_proof.hpp"
#include "workspace/certify_batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int N, int D>
void certify(const CertifiedRig& rig, const double* centres, const double* half_edges, std::size_t begin,
             std::size_t end, const CellVerdicts& found) {
  FacetRays<N> rays;
  CertifiedRig still = rig;
  still.angle = still.slack = 0;
  for (std::size_t cell = begin; cell < end; ++cell) {
    double inside = 1, outside = 0;
    for (int rotation = 0; rotation < rig.rotations && outside < 1; ++rotation) {
      checkpoint();
      const auto at = static_cast<std::size_t>(rotation);
      if (rig.angle > 0) {  // one turn in which a pose is outside is enough, and least is lost in none
        outside = std::max(outside, CellProof<N, D>(still, at, centres + cell * D, half_edges, rays).outside());
      }
      const CellProof<N, D> proof(rig, at, centres + cell * D, half_edges, rays);
      outside = std::max(outside, proof.outside());
      if (outside < 1 && inside > 0) inside = std::max(0.0, inside - 1 + proof.inside(found.shares != nullptr));
    }
    if (outside >= 1) inside = 0;
    found.verdict[cell] = inside >= 1 ? 1 : outside >= 1 ? -1 : 0;
    if (found.shares != nullptr) {
      found.shares[2 * cell] = inside;
      found.shares[2 * cell + 1] = outside;
    }
  }
}

void certify_cells(const CertifiedRig& rig, const double* centres, const double* half_edges, std::size_t begin,
                   std::size_t end, const CellVerdicts& found) {
  if (rig.d == 2) {
    (rig.n == 2 ? certify<2, 2> : certify<3, 2>)(rig, centres, half_edges, begin, end, found);
  } else {
    (rig.n == 3 ? certify<3, 3> : certify<6, 3>)(rig, centres, half_edges, begin, end, found);
  }
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
