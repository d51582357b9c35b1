// Workspace measures over batches of poses, each compiled for several instruction sets
// (simd/instruction_set.hpp).
#pragma once

#include <cstddef>
#include <cstdint>

#include "simd/instruction_set.hpp"
#include "tensionlab/simd/batch.hpp"

namespace tensionlab {

// Anchors and attachments of m cables: d coordinates each, one cable after the other. Null: attachments of a rig
// whose platform cannot turn; radii and axes of a rig without pulleys.
struct CableGeometry {
  int d, m;
  const double *anchors, *attachments, *radii, *axes;
};

// d coordinates of each pose, and d x d of its rotation, if there is one.
struct PoseRows {
  Rows position;
  const Rows* rotation;
};

// For each pose, its structure matrix, and whether all cables have a length.
struct StructureAnswer {
  double* structure;
  bool* valid;
};

// least_share: a cable that is no longer than this share of the longest has no direction.
TENSIONLAB_KERNEL(structure_matrices, const CableGeometry&, const PoseRows&, double least_share, std::size_t begin,
                  std::size_t end, const StructureAnswer&)

// Poses, by their structure matrices and limits.
struct Poses {
  std::size_t size;
  int n, m;
  Rows structure, lower, upper;
  double rank_tolerance;
};

// `count` wrenches for each pose, one after the other.
struct Wrenches {
  Rows rows;
  int count;
};

// For each pose, the margin, the facet's normal (n), the index of the wrench, and tensions (m).
struct ActiveFacetAnswer {
  double *margin, *normal;
  std::int64_t* wrench;
  double* tensions;
};

// For each pose, the number of its half-spaces, and room for `capacity` normals and offsets.
struct HalfSpaceAnswer {
  double *count, *normals, *offsets;
};

TENSIONLAB_KERNEL(capacity_margin, const Poses&, const Wrenches&, std::size_t begin, std::size_t end,
                  double* margin)
TENSIONLAB_KERNEL(tension_factor, const Poses&, std::size_t begin, std::size_t end, double* factor)
TENSIONLAB_KERNEL(isotropic_force, const Poses&, int dimension, std::size_t begin, std::size_t end, double* force)
TENSIONLAB_KERNEL(feasible_direction_fraction, const Poses&, const Wrenches&, double tolerance, std::size_t begin,
                  std::size_t end, double* fraction)
TENSIONLAB_KERNEL(active_facet, const Poses&, const Wrenches&, std::size_t begin, std::size_t end,
                  const ActiveFacetAnswer&)
TENSIONLAB_KERNEL(half_spaces, const Poses&, std::size_t capacity, std::size_t begin, std::size_t end,
                  const HalfSpaceAnswer&)

// A rig, and what is required of it. Anchors and arms (rotations, m, d) in world axes, in m; limits (m); wrenches
// (rotations, wrenches, n), torques divided by `length`, and all wrenches within `radius` of them. All turns by up
// to `angle` count; slack: how far wrenches may change with them. closure: wrench closure is required, whatever
// the limits.
struct CertifiedRig {
  int n, d, m, rotations, wrenches;
  const double *anchors, *arms, *lower, *upper, *required;
  double radius, slack, angle, length;
  bool closure;
  const double *radii, *axes;  // of pulleys, (m) and (m, d), or null; a radius of 0 is a fixed anchor
  bool weight;                 // whether the last is a weight: its anchor is a force, its tension 1
};

// For each cell 1 inside, -1 outside, 0 undecided; and the shares of it that are proved inside and outside, (size,
// 2), unless null.
struct CellVerdicts {
  std::int8_t* verdict;
  double* shares;
};

// One build: wider ones are no faster.
void certify_cells(const CertifiedRig&, const double* centres, const double* half_edges, std::size_t begin,
                   std::size_t end, const CellVerdicts&);

// What the proof of cells takes for true of cables over pulleys, for tests: vectors from attachments to anchors
// and axes, d numbers each, radii, and how far the attachments move.
struct MovingCables {
  int d;
  const double *vectors, *radii, *axes, *moved;
};

// For each of them the direction (d), its gradient (d, d), whether what follows holds, and the bounds of the
// change of the direction and of its gradient, per m and per m².
void pulley_bends(const MovingCables&, std::size_t begin, std::size_t end, double* found);

}  // namespace tensionlab
