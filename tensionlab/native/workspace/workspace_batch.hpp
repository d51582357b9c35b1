// What the workspace measures make of a batch of poses, and the kernels that do it
// (workspace/workspace_kernel.cpp).
#pragma once

#include <cstdint>

#include "simd/batch.hpp"
#include "simd/instruction_set.hpp"

namespace tensionlab {

struct Poses {
  std::size_t size;
  int n, m;
  Rows structure, lower, upper;
  double rank_tolerance;
};

// `count` wrenches for each pose, each of n numbers, one after the other.
struct Wrenches {
  Rows rows;
  int count;
};

// For each pose, one number, a row of n, the number of a wrench, and a row of m.
struct Active {
  double *margin, *normal;
  std::int64_t* number;
  double* tensions;
};

// For each pose, how many half-spaces it has, and room for `capacity` rows of n and as many numbers.
struct Facets {
  double *count, *normals, *offsets;
};

// Where m cables begin and end: d coordinates each, one cable after the other. No attachments where none turns.
struct Cables {
  int d, m;
  const double *anchors, *attachments, *radii, *axes;  // of pulleys, if there are any
};

// Of each pose, d coordinates, and d x d of its rotation, if there is one.
struct Places {
  Rows position;
  const Rows* rotation;
};

// For each pose, n x m numbers, and whether all cables have a length.
struct Structures {
  double* matrices;
  bool* sound;
};

TENSIONLAB_KERNEL(structure_matrices, const Cables&, const Places&, double least_share, std::size_t begin,
                  std::size_t end, const Structures&)
TENSIONLAB_KERNEL(capacity_margin, const Poses&, const Wrenches&, std::size_t begin, std::size_t end,
                  double* margin)
TENSIONLAB_KERNEL(tension_factor, const Poses&, std::size_t begin, std::size_t end, double* factor)
TENSIONLAB_KERNEL(isotropic_force, const Poses&, int dimension, std::size_t begin, std::size_t end, double* force)
TENSIONLAB_KERNEL(reachable_share, const Poses&, const Wrenches&, double tolerance, std::size_t begin,
                  std::size_t end, double* share)
TENSIONLAB_KERNEL(active_facet, const Poses&, const Wrenches&, std::size_t begin, std::size_t end, const Active&)
TENSIONLAB_KERNEL(half_spaces, const Poses&, std::size_t capacity, std::size_t begin, std::size_t end,
                  const Facets&)

}  // namespace tensionlab
