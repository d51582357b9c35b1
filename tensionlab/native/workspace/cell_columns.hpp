// The columns of the structure matrix over a cell: positions in a box and, for a platform, small turns from one
// rotation; affine in both and quadratic in the position, with bounds of the remainder.
//
// The column of a cable is w = [u; r x u], with u the unit vector from its attachment to its anchor and r the arm,
// torques over the characteristic length. When the anchor moves by d relative to the attachment, at the distance L
// from it, and P = 1 - u u', u changes by P d / L - ((u . d) P d + |P d|² u / 2) / L², up to (|d| / (L - |d|))³ /
// 2: the second and the third derivative of q / |q| are at most 2 / sqrt(3) and 3 over |q|² and |q|³, in any
// direction. In large cells and near anchors that is more than u can change at all; there u counts as constant, up
// to that change, 2 sin(asin(|d| / L) / 2), or as zero, up to 1, if that is less.
#pragma once

#include <algorithm>
#include <cmath>

#include "workspace/kernels.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// N wrench components, in D dimensions.
template <int N, int D>
struct CellColumns {
  static constexpr int kTurns = N - D;  // components of a turn, as of a torque
  static constexpr int kMoves = N;      // of position and turn together
  static constexpr int M = kMaxCables;

  static constexpr int kCurves = D * (D + 1) / 2;
  static constexpr double kShortest = 0x1p-400, kLongest = 0x1p400;  // in between, squares keep their precision

  int m, moves;           // components of the pose that move: without an angle, those of the position
  double cell[D];         // half its edges
  double half[D], angle;  // |dp_i| <= half_i, with the rounding error of coordinates; |turn| <= angle
  double length;          // characteristic
  double u[D][M], arm[D][M];
  double column[N][M];  // w in the middle of the cell
  double inverse[M];    // 1 / L; 0 where u counts as constant
  double rest[M];       // largest distance of u from its quadratic part
  double bent[M];       // ... from its affine part in the position
  double change[M];     // ... from its value in the middle
  double largest[M];    // largest |w|
  double turned[M];     // further distance of r x u / length from its affine part
  double swing[M];      // largest distance of r / length from its value in the middle

  CellColumns(const CertifiedRig& rig, std::size_t rotation, const double* centre, const double* half_edges)
      : m(rig.m),
        moves(kTurns > 0 && rig.angle > 0 ? N : D),
        angle(moves > D ? rig.angle : 0),
        length(rig.length) {
    const double* const anchor = rig.anchors + rotation * static_cast<std::size_t>(rig.m * D);
    const double* const lever = rig.arms + rotation * static_cast<std::size_t>(rig.m * D);
    double diagonal = 0;
    for (int k = 0; k < D; ++k) {
      double farthest = std::abs(centre[k]);
      for (int j = 0; j < m; ++j) {
        farthest = std::max(farthest, std::abs(anchor[j * D + k]) + std::abs(lever[j * D + k]));
      }
      cell[k] = half_edges[k];
      half[k] = half_edges[k] + 0x1p-40 * farthest;
      diagonal += half[k] * half[k];
    }
    diagonal = std::sqrt(diagonal);
    for (int j = 0; j < m; ++j) {
      double r[D], q[D], square = 0, lever_square = 0;
      for (int k = 0; k < D; ++k) {
        r[k] = lever[j * D + k];
        q[k] = anchor[j * D + k] - r[k] - centre[k];
        square += q[k] * q[k];
        lever_square += r[k] * r[k];
      }
      const double L = std::sqrt(square), reach = std::sqrt(lever_square), moved = diagonal + angle * reach;
      const bool runs = moved < L && L > kShortest && L < kLongest;  // certainly out of the cell
      for (int k = 0; k < D; ++k) {
        u[k][j] = q[k] / L;
        arm[k][j] = r[k];
      }
      largest[j] = 1 + (kTurns > 0 ? reach / length : 0);
      const double turn = angle * reach, share = moved / (L - moved);
      change[j] = runs ? 2 * std::sin(std::asin(moved / L) / 2) : 2;
      bent[j] = share * share / std::sqrt(3.0);
      if (runs && bent[j] < change[j]) {
        inverse[j] = 1 / L;
        rest[j] = share * share * share / 2 + angle * turn / (2 * L) +
                  (2 * diagonal + turn) * turn / (std::sqrt(3.0) * L * L);
        bent[j] += turn * (1 + angle / 2) / L;
      } else {
        inverse[j] = 0;
        if (!(change[j] < 1)) {
          change[j] = 1;
          for (int k = 0; k < D; ++k) u[k][j] = 0;
        }
        rest[j] = bent[j] = change[j];
      }
      for (int k = 0; k < D; ++k) column[k][j] = u[k][j];
      turned[j] = angle * reach * (angle / 2 + change[j]) / length;
      swing[j] = angle * reach / length;
      if constexpr (kTurns == 1) {
        column[D][j] = (r[0] * u[1][j] - r[1] * u[0][j]) / length;
      } else if constexpr (kTurns == 3) {
        for (int k = 0; k < D; ++k) {
          const int a = (k + 1) % D, b = (k + 2) % D;
          column[D + k][j] = (r[a] * u[b][j] - r[b] * u[a][j]) / length;
        }
      }
    }
  }

  // Whether a cable may run in any direction.
  bool anywhere(int j) const { return change[j] == 1; }

  // v . w over the cell: value + slope . (dp, turn) + dp' C dp / 2, up to `error`; C row by row up to its
  // diagonal.
  struct Pull {
    double value[M], slope[kMoves][M], curve[kCurves][M], error[M];
  };

  void pull(const double* v, Pull& found) const {
    double twist = 0;
    for (int k = D; k < N; ++k) twist += v[k] * v[k];
    twist = std::sqrt(twist);
    for (int j = 0; j < m; ++j) {
      double a[D];  // v . w = a . u
      lever(v, j, a);
      double along = 0, square = 0;
      for (int k = 0; k < D; ++k) {
        along += a[k] * u[k][j];
        square += a[k] * a[k];
      }
      found.value[j] = along;
      double across[D];
      for (int k = 0; k < D; ++k) {
        across[k] = -(a[k] - along * u[k][j]) * inverse[j];
        found.slope[k][j] = across[k];
      }
      for (int i = 0, entry = 0; i < D; ++i) {
        for (int k = 0; k <= i; ++k, ++entry) {
          const double flat = (i == k ? 1.0 : 0.0) - u[i][j] * u[k][j];
          found.curve[entry][j] =
              (across[i] * u[k][j] + across[k] * u[i][j] - along * inverse[j] * flat) * inverse[j];
        }
      }
      if constexpr (kTurns == 1) {
        const double radial = arm[0][j] * u[0][j] + arm[1][j] * u[1][j];
        found.slope[D][j] = arm[0][j] * across[1] - arm[1][j] * across[0] - v[D] * radial / length;
      } else if constexpr (kTurns == 3) {
        double pushed[D];
        for (int k = 0; k < D; ++k) {
          const int b = (k + 1) % D, c = (k + 2) % D;
          pushed[k] = across[k] + (u[b][j] * v[D + c] - u[c][j] * v[D + b]) / length;
        }
        for (int k = 0; k < D; ++k) {
          const int b = (k + 1) % D, c = (k + 2) % D;
          found.slope[D + k][j] = arm[b][j] * pushed[c] - arm[c][j] * pushed[b];
        }
      }
      found.error[j] = std::sqrt(square) * rest[j] + twist * turned[j];
    }
  }

  // a with v . w = a . u: the force, and the torque across the arm.
  void lever(const double* v, int j, double* a) const {
    for (int k = 0; k < D; ++k) a[k] = v[k];
    if constexpr (kTurns == 1) {
      a[0] -= v[D] * arm[1][j] / length;
      a[1] += v[D] * arm[0][j] / length;
    } else if constexpr (kTurns == 3) {
      for (int k = 0; k < D; ++k) {
        const int b = (k + 1) % D, c = (k + 2) % D;
        a[k] += (v[D + b] * arm[c][j] - v[D + c] * arm[b][j]) / length;
      }
    }
  }

  // The largest value of component i of the pose.
  double edge(int i) const { return i < D ? half[i] : angle; }

  // The least value of dp' C dp / 2 and, with the opposite sign, the largest.
  template <class Curve>
  double dip(const Curve& at) const {
    double sum = 0;
    for (int i = 0, entry = 0; i < D; ++i) {
      for (int k = 0; k < i; ++k, ++entry) sum -= std::abs(at(entry)) * half[i] * half[k];
      sum += std::min(0.0, at(entry++)) * half[i] * half[i] / 2;
    }
    return sum;
  }

  // The largest value of slope . (dp, turn); at(k) is component k of the slope.
  template <class Slope>
  double reach(const Slope& at) const {
    double sum = 0, square = 0;
    for (int k = 0; k < D; ++k) sum += std::abs(at(k)) * half[k];
    for (int k = D; k < N; ++k) square += at(k) * at(k);
    return kTurns > 0 ? sum + angle * std::sqrt(square) : sum;
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
