// Structure matrices and workspace measures over a batch of poses.
#include "workspace/facets.hpp"
#include "workspace/kernels.hpp"
#include "workspace/metrics.hpp"
#include "workspace/structure_matrices.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

constexpr int kLanes = TENSIONLAB_LANES;

// Measures one pose with any structure matrix, however singular.
template <class Measure>
double measure_single(const Pose& pose, const Poses& poses, std::size_t row, const Measure& measure) {
  double loose[kMaxComponents * kMaxCables];  // W with zeros for cables whose limits are equal
  for (int i = 0; i < poses.m; ++i) {
    const double kept = pose.lower[i] < pose.upper[i] ? 1 : 0;
    for (int k = 0; k < poses.n; ++k) loose[k * poses.m + i] = kept * pose.structure[k * poses.m + i];
  }
  const Whitening<double, kMaxComponents, kMaxCables> whitening(loose, poses.n, poses.m, poses.rank_tolerance);
  double value = 0;
  with_size(std::max(whitening.rank, 1), [&](auto rank) {
    value = measure(SingleWrenchSet<rank, kMaxCables>(pose, poses.n, poses.m, whitening), {row});
  });
  return value;
}

template <class Measure>
void measure_poses(const Poses& poses, std::size_t begin, std::size_t end, const Measure& measure, double* found) {
  with_size(poses.n, [&](auto n) {
    WrenchSets<kLanes, n, kMaxCables> sets;
    for (std::size_t next = begin; next < end; next += kLanes) {
      std::size_t row[kLanes];
      Pose pose[kLanes];
      for (int l = 0; l < kLanes; ++l) {
        row[l] = std::min(next + static_cast<std::size_t>(l), end - 1);
        pose[l] = {poses.structure[row[l]], poses.lower[row[l]], poses.upper[row[l]]};
      }
      const auto well = sets.load(pose, poses.m);
      const auto values = measure(sets, row);
      for (int l = 0; l < kLanes && next + static_cast<std::size_t>(l) < end; ++l) {
        found[row[l]] = holds(well, l) ? read<double>(values, l) : measure_single(pose[l], poses, row[l], measure);
      }
    }
  });
}

void structure_matrices(const CableGeometry& cables, const PoseRows& poses, double least_share, std::size_t begin,
                        std::size_t end, const StructureAnswer& answer) {
  if (cables.d == 2) {
    StructureMatrices<kLanes, 2>(cables, least_share).solve(poses, begin, end, answer);
  } else {
    StructureMatrices<kLanes, 3>(cables, least_share).solve(poses, begin, end, answer);
  }
}

void capacity_margin(const Poses& poses, const Wrenches& wrenches, std::size_t begin, std::size_t end,
                     double* margin) {
  measure_poses(poses, begin, end, CapacityMargin{wrenches, poses.n}, margin);
}

void tension_factor(const Poses& poses, std::size_t begin, std::size_t end, double* factor) {
  measure_poses(poses, begin, end, TensionFactor{}, factor);
}

void isotropic_force(const Poses& poses, int dimension, std::size_t begin, std::size_t end, double* force) {
  measure_poses(poses, begin, end, IsotropicForce{dimension}, force);
}

void feasible_direction_fraction(const Poses& poses, const Wrenches& wrenches, double tolerance, std::size_t begin,
                                 std::size_t end, double* fraction) {
  measure_poses(poses, begin, end, FeasibleDirectionFraction{wrenches, poses.n, tolerance}, fraction);
}

void active_facet(const Poses& poses, const Wrenches& wrenches, std::size_t begin, std::size_t end,
                  const ActiveFacetAnswer& answer) {
  measure_poses(poses, begin, end, ActiveFacet{wrenches, poses.n, answer.normal, answer.wrench}, answer.margin);
  with_size(poses.n, [&](auto n) {
    for (std::size_t row = begin; row < end; ++row) {
      tensions_in_facet<n>({poses.structure[row], poses.lower[row], poses.upper[row]}, poses.m,
                           answer.normal + row * n, wrenches.rows[row] + answer.wrench[row] * n,
                           poses.rank_tolerance, answer.tensions + row * static_cast<std::size_t>(poses.m));
    }
  });
}

void half_spaces(const Poses& poses, std::size_t capacity, std::size_t begin, std::size_t end,
                 const HalfSpaceAnswer& answer) {
  measure_poses(poses, begin, end, HalfSpaces{poses.n, capacity, answer.normals, answer.offsets}, answer.count);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
