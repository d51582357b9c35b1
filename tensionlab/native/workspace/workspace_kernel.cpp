// The workspace measures over a batch of poses; compiled once for each instruction set (simd/instruction_set.hpp).
#include "workspace/single_wrench_set.hpp"
#include "workspace/structure_matrices.hpp"
#include "workspace/workspace_batch.hpp"
#include "workspace/workspace_facets.hpp"
#include "workspace/workspace_metrics.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

constexpr int kLanes = TENSIONLAB_LANES;

template <int R, class Measure>
double single_of_rank(const Pose& pose, const Poses& poses, std::size_t row,
                      const Whitening<double, kMaxComponents, kMaxCables>& whitening, const Measure& measure) {
  const SingleWrenchSet<R, kMaxCables> set(pose, poses.n, poses.m, whitening);
  return measure(set, {row});
}

// Any structure matrix, however singular.
template <class Measure>
double single(const Pose& pose, const Poses& poses, std::size_t row, const Measure& measure) {
  double loose[kMaxComponents * kMaxCables];  // W, without the cables that have no choice
  for (int i = 0; i < poses.m; ++i) {
    const double kept = pose.lower[i] < pose.upper[i] ? 1 : 0;
    for (int k = 0; k < poses.n; ++k) loose[k * poses.m + i] = kept * pose.structure[k * poses.m + i];
  }
  const Whitening<double, kMaxComponents, kMaxCables> whitening(loose, poses.n, poses.m, poses.rank_tolerance);
  static constexpr decltype(&single_of_rank<1, Measure>) kMeasure[] = {
      single_of_rank<1, Measure>, single_of_rank<1, Measure>, single_of_rank<2, Measure>,
      single_of_rank<3, Measure>, single_of_rank<4, Measure>, single_of_rank<5, Measure>,
      single_of_rank<6, Measure>};
  return kMeasure[whitening.rank](pose, poses, row, whitening, measure);
}

template <int N, class Measure>
void measure_poses(const Poses& poses, std::size_t begin, std::size_t end, const Measure& measure, double* found) {
  WrenchSets<kLanes, N, kMaxCables> sets;
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
      found[row[l]] = holds(well, l) ? read<double>(values, l) : single(pose[l], poses, row[l], measure);
    }
  }
}

template <class Measure>
void measure_any(const Poses& poses, std::size_t begin, std::size_t end, const Measure& measure, double* found) {
  static constexpr decltype(&measure_poses<1, Measure>) kMeasure[] = {
      measure_poses<1, Measure>, measure_poses<2, Measure>, measure_poses<3, Measure>,
      measure_poses<4, Measure>, measure_poses<5, Measure>, measure_poses<6, Measure>};
  kMeasure[poses.n - 1](poses, begin, end, measure, found);
}

void structure_matrices(const Cables& cables, const Places& places, double least_share, std::size_t begin,
                        std::size_t end, const Structures& found) {
  if (cables.d == 2) {
    StructureMatrices<kLanes, 2>(cables, least_share).place(places, begin, end, found);
  } else {
    StructureMatrices<kLanes, 3>(cables, least_share).place(places, begin, end, found);
  }
}

void capacity_margin(const Poses& poses, const Wrenches& wrenches, std::size_t begin, std::size_t end,
                     double* margin) {
  measure_any(poses, begin, end, CapacityMargin{wrenches, poses.n}, margin);
}

void tension_factor(const Poses& poses, std::size_t begin, std::size_t end, double* factor) {
  measure_any(poses, begin, end, TensionFactor{}, factor);
}

void isotropic_force(const Poses& poses, int dimension, std::size_t begin, std::size_t end, double* force) {
  measure_any(poses, begin, end, IsotropicForce{dimension}, force);
}

void reachable_share(const Poses& poses, const Wrenches& wrenches, double tolerance, std::size_t begin,
                     std::size_t end, double* share) {
  measure_any(poses, begin, end, ReachableShare{wrenches, poses.n, tolerance}, share);
}

template <int N>
void tensions_of_size(const Poses& poses, const Wrenches& wrenches, std::size_t begin, std::size_t end,
                      const Active& active) {
  const auto m = static_cast<std::size_t>(poses.m);
  for (std::size_t row = begin; row < end; ++row) {
    tensions_in_facet<N>({poses.structure[row], poses.lower[row], poses.upper[row]}, poses.m,
                         active.normal + row * N, wrenches.rows[row] + active.number[row] * N,
                         poses.rank_tolerance, active.tensions + row * m);
  }
}

void active_facet(const Poses& poses, const Wrenches& wrenches, std::size_t begin, std::size_t end,
                  const Active& active) {
  measure_any(poses, begin, end, ActiveFacet{wrenches, poses.n, active.normal, active.number}, active.margin);
  static constexpr decltype(&tensions_of_size<1>) kTensions[] = {tensions_of_size<1>, tensions_of_size<2>,
                                                                 tensions_of_size<3>, tensions_of_size<4>,
                                                                 tensions_of_size<5>, tensions_of_size<6>};
  kTensions[poses.n - 1](poses, wrenches, begin, end, active);
}

void half_spaces(const Poses& poses, std::size_t capacity, std::size_t begin, std::size_t end,
                 const Facets& facets) {
  measure_any(poses, begin, end, HalfSpaces{poses.n, capacity, facets.normals, facets.offsets}, facets.count);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
