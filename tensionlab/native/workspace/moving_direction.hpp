// Directions of wrenches that move with the pose of a cell, and the pull of the cables along them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tensionlab/simd/linear.hpp"
#include "workspace/kernels.hpp"
#include "workspace/pulley_bend.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The columns of the structure matrix over a cell: positions in a box and, for a platform, small turns from one
// rotation; affine in both and quadratic in the position, with bounds of the remainder.
//
// The column of a cable is w = [u; r x u], with u the unit vector from its attachment to its anchor and r the arm,
// torques over the characteristic length. When the anchor moves by d relative to the attachment, at the distance L
// from it, and P = 1 - u u', u changes by P d / L - ((u . d) P d + |P d|² u / 2) / L², up to (|d| / (L - |d|))³ /
// 2: the second and the third derivative of q / |q| are at most 2 / sqrt(3) and 3 over |q|² and |q|³, in any
// direction. In large cells and near anchors that is more than u can change at all; there u counts as constant, up
// to that change, 2 sin(asin(|d| / L) / 2), or as zero, up to 1, if that is less.
//
// Over a swivelling pulley (tensionlab/model/pulleys.py) u is affine, with the bound of the remainder that
// `PulleyBend` has.

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
  double inverse[M];    // 1 / L; 0 where u counts as constant, and over pulleys
  bool inside_pulley =
      false;  // whether an attachment is inside its pulley in all of the cell: no pose is possible
  bool clear_of_pulleys = true;  // whether none is in any
  bool over_pulley[M];           // whether u is affine, with the gradient -turn
  double turn[D][D][M];
  double rest[M];     // largest distance of u from its quadratic part
  double bent[M];     // ... from its affine part in the position
  double change[M];   // ... from its value in the middle
  double largest[M];  // largest |w|
  double turned[M];   // further distance of r x u / length from its affine part
  double swing[M];    // largest distance of r / length from its value in the middle

  CellColumns(const CertifiedRig& rig, std::size_t rotation, const double* centre, const double* half_edges)
      : m(rig.m),
        moves(kTurns > 0 && rig.angle > 0 ? N : D),
        angle(moves > D ? rig.angle : 0),
        length(rig.length),
        over_pulley{} {
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
      const double swung = angle * reach, share = moved / (L - moved);
      change[j] = runs ? 2 * std::sin(std::asin(moved / L) / 2) : 2;
      bent[j] = share * share / std::sqrt(3.0);
      if (runs && bent[j] < change[j]) {
        inverse[j] = 1 / L;
        rest[j] = share * share * share / 2 + angle * swung / (2 * L) +
                  (2 * diagonal + swung) * swung / (std::sqrt(3.0) * L * L);
        bent[j] += swung * (1 + angle / 2) / L;
      } else {
        inverse[j] = 0;
        if (!(change[j] < 1)) {
          change[j] = 1;
          for (int k = 0; k < D; ++k) u[k][j] = 0;
        }
        rest[j] = bent[j] = change[j];
      }
      if (rig.radii != nullptr && rig.radii[j] > 0) lead_over_pulley(rig, j, q, moved, swung);
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

  // Replaces u of a cable and its bounds by those over its pulley; q is the vector to the anchor.
  void lead_over_pulley(const CertifiedRig& rig, int j, const double* q, double moved, double swung) {
    const PulleyBend<D> bend(q, rig.radii[j], rig.axes + j * D, moved);
    inside_pulley = inside_pulley || bend.within;
    clear_of_pulleys = clear_of_pulleys && bend.clear;
    inverse[j] = 0;
    change[j] = bend.smooth ? bend.steepest * moved : 1;
    const double second = bend.second * moved * moved / 2;
    over_pulley[j] = change[j] < 1 && second < change[j];
    for (int k = 0; k < D; ++k) {
      u[k][j] = change[j] < 1 ? bend.u[k] : 0;
      for (int i = 0; i < D; ++i) turn[k][i][j] = bend.gradient[k][i];
    }
    if (over_pulley[j]) {
      rest[j] = second + bend.steepest * angle * swung / 2;
      bent[j] = second + bend.steepest * swung * (1 + angle / 2);
    } else {
      change[j] = std::min(change[j], 1.0);
      rest[j] = bent[j] = change[j];
    }
  }

  // The change of a . u by components of the position.
  void slope_of(const double* a, double along, int j, double* slope) const {
    for (int k = 0; k < D; ++k) {
      slope[k] = -(a[k] - along * u[k][j]) * inverse[j];
      for (int i = 0; i < D && over_pulley[j]; ++i) slope[k] -= turn[k][i][j] * a[i];
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
      slope_of(a, along, j, across);
      for (int k = 0; k < D; ++k) found.slope[k][j] = across[k];
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

// v + mu, with mu linear in the pose: then (v + mu) . w is also affine in the pose and quadratic in the position.
template <int N, int D>
class MovingDirection {
 public:
  using Columns = CellColumns<N, D>;
  static constexpr int M = kMaxCables;

  // far: it moves by as much as v is long in the norm sum of |v . w|.
  enum class Motion { none, near, far };

  double v[N];
  typename Columns::Pull pull;
  double mu[N][N];  // for each component of the pose
  double longest;   // largest |mu|

  MovingDirection(const Columns& columns, const double* direction) : columns_(columns) {
    std::copy(direction, direction + N, v);
    columns_.pull(v, pull);
    stop();
  }

  // Another direction with the same motion.
  MovingDirection(const MovingDirection& other, const double* direction) : MovingDirection(other) {
    std::copy(direction, direction + N, v);
    columns_.pull(v, pull);
    if (longest > 0) join();
  }

  // Makes it stay across the cables that it is across, to first order. It does not move where it would have to
  // move by more than its length, or far and may_move_far is false. Cables without a bit in `counted` do not count
  // for the norm.
  Motion follow(std::uint32_t spanning, std::uint32_t counted, bool may_move_far) {
    double basis[N][N];
    int own[N], count;
    if (!dual_to(spanning, own, count, basis)) return Motion::none;
    clear();
    double room = 0, moves = 0, doubt = 0;
    for (int i = 0; i < columns_.moves; ++i) {
      for (int a = 0; a < count; ++a) {
        for (int k = 0; k < N; ++k) mu[i][k] -= pull.slope[i][own[a]] * basis[a][k];
      }
      longest += columns_.edge(i) * length_of(mu[i], 0);
      for (int j = 0; j < columns_.m; ++j) {
        const double moved = add(i, j);
        if (counted >> j & 1) moves += moved;
      }
    }
    for (int j = 0; j < columns_.m; ++j) {
      if (!(counted >> j & 1)) continue;
      room += spanning >> j & 1 ? 0 : std::abs(pull.value[j]);
      doubt += kDoubt * columns_.largest[j];
    }
    const bool far = !(moves + doubt < 0.9 * room);
    if (!(longest < 1) || (far && !may_move_far)) {
      stop();
      return Motion::none;
    }
    join();
    return far ? Motion::far : Motion::near;
  }

  // Makes it across columns themselves, instead of moved ones.
  void straighten(std::uint32_t spanning) {
    double basis[N][N];
    int own[N], count;
    if (!dual_to(spanning, own, count, basis)) return;
    for (int a = 0; a < count; ++a) {
      for (int k = 0; k < N; ++k) v[k] -= pull.value[own[a]] * basis[a][k];
    }
    columns_.pull(v, pull);
  }

  // Finds v, tilted against the cables that it is across so that they pull the other way in all of the cell.
  bool lean(std::uint32_t spanning, double* leaning) const {
    constexpr double kEnough = 1.1;  // since the effect of tilting varies over the cell, too
    double basis[N][N];
    int own[N], count;
    if (!dual_to(spanning, own, count, basis)) return false;
    std::copy(v, v + N, leaning);
    for (int a = 0; a < count; ++a) {
      const double needed = kEnough * (std::abs(pull.value[own[a]]) + reach(own[a]) + pull.error[own[a]]);
      for (int k = 0; k < N; ++k) leaning[k] -= needed * basis[a][k];
    }
    return true;
  }

  // The largest change of the pull of a cable, up to the error.
  double reach(int j) const {
    const double low = columns_.dip([&](int i) { return pull.curve[i][j]; });
    const double high = columns_.dip([&](int i) { return -pull.curve[i][j]; });
    return columns_.reach([&](int i) { return pull.slope[i][j]; }) - std::min(low, high);
  }

  double length() const { return length_of(v, 0); }
  double torque() const { return length_of(v, D); }

 private:
  // More than the change of the norm by rays' errors of 2^-22, and by hyperplanes that are not quite the columns'.
  static constexpr double kDoubt = 0x1p-20;

  const Columns& columns_;
  typename Columns::Pull added_;  // by the motion

  static double length_of(const double* a, int first) {
    double sum = 0;
    for (int k = first; k < N; ++k) sum += a[k] * a[k];
    return std::sqrt(sum);
  }

  void stop() {
    for (auto& row : mu) std::fill(row, row + N, 0.0);
    longest = 0;
  }

  void clear() {
    for (int j = 0; j < columns_.m; ++j) {
      added_.error[j] = 0;
      for (int i = 0; i < N; ++i) added_.slope[i][j] = 0;
      for (int i = 0; i < Columns::kCurves; ++i) added_.curve[i][j] = 0;
    }
  }

  // Adds component i of the motion to the pull of cable j; returns its largest value to first order.
  double add(int i, int j) {
    double a[D], along = 0, square = 0;
    columns_.lever(mu[i], j, a);
    for (int k = 0; k < D; ++k) {
      along += a[k] * columns_.u[k][j];
      square += a[k] * a[k];
    }
    added_.slope[i][j] = along;
    // mu . (w - its value in the middle): its part that is linear in the position is a curve, twice where both
    // components are the same.
    double across[D];
    columns_.slope_of(a, along, j, across);
    for (int k = 0; k < D && i < D; ++k) {
      const double both = across[k];
      const int row = std::max(i, k), column = std::min(i, k);
      added_.curve[row * (row + 1) / 2 + column][j] += i == k ? 2 * both : both;
    }
    const double left = i < D ? columns_.bent[j] : columns_.change[j];
    added_.error[j] += columns_.edge(i) * (std::sqrt(square) * left + length_of(mu[i], D) * columns_.swing[j]);
    return columns_.edge(i) * std::abs(along);
  }

  void join() {
    for (int j = 0; j < columns_.m; ++j) {
      pull.error[j] += added_.error[j];
      for (int i = 0; i < N; ++i) pull.slope[i][j] += added_.slope[i][j];
      for (int i = 0; i < Columns::kCurves; ++i) pull.curve[i][j] += added_.curve[i][j];
    }
  }

  // Finds the columns of a mask, and vectors dual to them; returns false where they are nearly dependent.
  bool dual_to(std::uint32_t chosen, int (&own)[N], int& count, double (&basis)[N][N]) const {
    double column[N][N];
    count = 0;
    for (int j = 0; j < columns_.m; ++j) {
      if (!(chosen >> j & 1)) continue;
      for (int k = 0; k < N; ++k) column[count][k] = columns_.column[k][j];
      own[count++] = j;
    }
    return dual_basis<N>(column, count, 1e-5, basis);
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
