// Structure matrices at many poses, one in each lane: W has the columns [u; r x u], with u the unit vector from
// the attachment along the cable, and r the arm of the attachment, in world axes (Verhoeven 2004), by the
// conventions of tensionlab/model/kinematics.py.
#pragma once

#include <algorithm>
#include <cstddef>

#include "tensionlab/simd/lanes.hpp"
#include "workspace/kernels.hpp"
#include "workspace/pulley.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int L, int D>
class StructureMatrices {
 public:
  // least_share: a cable that is no longer than this share of the longest has no direction.
  StructureMatrices(const CableGeometry& cables, double least_share)
      : cables_(cables), least_share_(least_share), n_(cables.attachments == nullptr ? D : 3 * (D - 1)) {}

  void solve(const PoseRows& poses, std::size_t begin, std::size_t end, const StructureAnswer& answer) {
    const std::size_t entries = static_cast<std::size_t>(n_ * cables_.m);
    for (; begin < end; begin += L) {
      std::size_t row[L];
      double* matrix[L];
      for (std::size_t l = 0; l < L; ++l) {
        row[l] = std::min(begin + l, end - 1);
        matrix[l] = answer.structure + row[l] * entries;
      }
      load(poses, row);
      const auto valid = update();
      store_rows<double, L>(structure_, n_ * cables_.m, matrix);
      for (int l = 0; l < L; ++l) answer.valid[row[l]] = holds(valid, l);
    }
  }

 private:
  using V = Lanes<double, L>;

  void load(const PoseRows& poses, const std::size_t (&row)[L]) {
    TENSIONLAB_UNROLL
    for (int k = 0; k < D; ++k) position_[k] = gather<double, L>([&](int l) { return poses.position[row[l]][k]; });
    turned_ = poses.rotation != nullptr;
    if (!turned_) return;
    const double* matrix[L];
    for (int l = 0; l < L; ++l) matrix[l] = (*poses.rotation)[row[l]];
    transpose<double, L>(matrix, D * D, [&](int j, const V& entry) { rotation_[j] = entry; });
  }

  // Computes the matrices; returns whether all cables have a length.
  auto update() {
    const int m = cables_.m;
    V longest = V{}, shortest = V{};
    for (int i = 0; i < m; ++i) {
      V arm[D], u[D];
      if (n_ > D) find_arm(i, arm);
      TENSIONLAB_UNROLL
      for (int k = 0; k < D; ++k) {
        u[k] = cables_.anchors[i * D + k] - position_[k];
        if (n_ > D) u[k] -= arm[k];
      }
      const V length = route(i, u);
      longest = i == 0 ? length : larger(longest, length);
      shortest = i == 0 ? length : smaller(shortest, length);
      TENSIONLAB_UNROLL
      for (int k = 0; k < D; ++k) structure_[k * m + i] = u[k];
      if (n_ == D) continue;
      if constexpr (D == 2) {
        structure_[2 * m + i] = arm[0] * u[1] - arm[1] * u[0];
      } else {
        TENSIONLAB_UNROLL
        for (int k = 0; k < 3; ++k) {
          const int a = (k + 1) % 3, b = (k + 2) % 3;
          structure_[(3 + k) * m + i] = arm[a] * u[b] - arm[b] * u[a];
        }
      }
    }
    return shortest > least_share_ * longest;
  }

  // Turns u, from attachment to anchor, into the unit vector along the cable; returns its length without the
  // pulley.
  V route(int i, V (&u)[D]) const {
    if (cables_.radii != nullptr) {
      const auto root = [](const V& x) { return square_root<double, L>(x); };
      const auto choose = [](const auto& test, const V& yes, const V& no) -> V { return test ? yes : no; };
      return route_over_pulley(u, D, cables_.radii[i], cables_.axes + i * D, root, choose).straight;
    }
    V square = V{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < D; ++k) square += u[k] * u[k];
    const V length = square_root<double, L>(square);
    const V inverse = V{} + 1 / (length > V{} ? length : V{} + 1);
    TENSIONLAB_UNROLL
    for (int k = 0; k < D; ++k) u[k] *= inverse;
    return length;
  }

  void find_arm(int i, V (&arm)[D]) const {
    const double* attachment = cables_.attachments + i * D;
    TENSIONLAB_UNROLL
    for (int k = 0; k < D; ++k) {
      arm[k] = V{} + (turned_ ? 0 : attachment[k]);
      if (!turned_) continue;
      TENSIONLAB_UNROLL
      for (int j = 0; j < D; ++j) arm[k] += rotation_[k * D + j] * attachment[j];
    }
  }

  const CableGeometry& cables_;
  double least_share_;
  int n_;
  bool turned_ = false;
  V position_[D], rotation_[D * D], structure_[kMaxComponents * kMaxCables];
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
