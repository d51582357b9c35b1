// Which pair of segments comes closest, for a batch of poses, and the kernel that finds it
// (workspace/clearance_kernel.cpp).
#pragma once

#include <cstdint>

#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"

namespace tensionlab {

constexpr int kMaxSegments = 64;

// Segments: (size, segments, 2, 3), both ends of each. Pairs: (pairs, 2) indices of segments. Radii: one a
// segment.
struct Segments {
  Rows ends;
  int segments, pairs;
  const std::int64_t* pair;
  const double* radius;
};

// distance: less both radii; closest: the index of the pair. No pair: infinity and -1.
TENSIONLAB_KERNEL(clearance, const Segments&, std::size_t begin, std::size_t end, double* distance,
                  std::int64_t* closest)

}  // namespace tensionlab
