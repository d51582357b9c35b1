// What is to be proved of cells of positions, and the kernel that does it (workspace/certify_kernel.cpp).
#pragma once

#include <cstddef>
#include <cstdint>

#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"

namespace tensionlab {

// A rig, and what is required of it. Anchors and arms (rotations, m, d) in world axes, in m; limits (m); wrenches
// (rotations, wrenches, n), torques over the length, and all within the radius of them. `slack` is how far the
// torque of a weight may turn from what the wrenches hold. With `closure` it is wrench closure that counts, not
// limits.
struct CertifiedRig {
  int n, d, m, rotations, wrenches;
  const double *anchors, *arms, *lower, *upper, *required;
  double radius, slack, angle, length;
  bool closure;
};

// For each cell 1 inside, -1 outside, 0 neither proved; and the shares of it that are inside and outside for sure,
// which are found only where `shares` is not null: (size, 2).
struct CellVerdicts {
  std::int8_t* verdict;
  double* shares;
};

TENSIONLAB_KERNEL(certify_cells, const CertifiedRig&, const double* centres, const double* half_edges,
                  std::size_t begin, std::size_t end, const CellVerdicts&)

}  // namespace tensionlab
