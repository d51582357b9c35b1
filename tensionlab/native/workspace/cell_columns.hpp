// The columns of the structure matrix over a cell, to second order in the pose, with bounds of the remainder, and
// of their sums.
#pragma once

#include <algorithm>
#include <cmath>

#include "tensionlab/simd/linear.hpp"
#include "workspace/kernels.hpp"
#include "workspace/pulley_bend.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// A cell is a box of positions p + dp and a ball of orientations exp(t) R, |t| <= angle; its poses are y = (dp,
// t). The column of a cable is w = [u; r x u], with u the unit vector from its attachment to its anchor and r the
// arm, torques over the characteristic length. It pulls v . w = a . u, with the lever a = v_force + v_torque x r.
//
// When the attachment moves by d, and P = 1 - u u', u changes by -P d / L - ((u . d) P d + |P d|² u / 2) / L²,
// up to (|d| / (L - |d|))³ / 2: the second and the third derivative of q / |q| are at most 2 / sqrt(3) and 3 over
// |q|² and |q|³, in any direction. In large cells and near anchors that is more than u can change at all; there u
// counts as constant, up to that change, 2 sin(asin(|d| / L) / 2), or as zero, up to 1, if that is less. Over a
// swivelling pulley (tensionlab/model/pulleys.py) u is affine, with the bound of the remainder that `PulleyBend`
// has.
//
// The arm turns to r + t x r + t x (t x r) / 2, up to angle³ |r| / 6, and the attachment moves likewise and by dp.
// With A t = t x r, B t = v_torque x (t x r), K = -du/dd, C the second derivative of a . u, and g = u x v_torque -
// K a,
//
//   a . u = value - (K a) . dp + g . A t + y' Q y / 2
//   Q_pp = C     Q_pt = C A - K B     Q_tt = A' Q_pt - (K B)' A + (r g' + g r') / 2 - r . g
//
// up to a . (u - u_2) + a_1 . (u - u_1) + a_2 . (u - u_0) + a_3 . u, with u_k the Taylor polynomial of u, and a_k
// the part of the lever of that order, or beyond. The column of a weight has its force in place of u, which is
// constant.

// N wrench components, in D dimensions.
template <int N, int D>
struct CellColumns {
  static constexpr int kTurns = N - D;            // components of a turn, as of a torque
  static constexpr int kPairs = N * (N + 1) / 2;  // of components of the pose
  static constexpr int M = kMaxCables;
  static constexpr double kShortest = 0x1p-400, kLongest = 0x1p400;  // in between, squares keep their precision

  int m, moves;           // columns; components of the pose that move: without an angle, those of the position
  double cell[D];         // half its edges
  double half[D], angle;  // |dp_i| <= half_i, with the rounding error of coordinates; |t| <= angle
  double length;          // characteristic
  double u[M][D], arm[M][D];
  double tangent[M][kTurns + 1][D];  // e_i x r / length for each axis of turns
  double column[N][M];               // w in the middle of the cell
  double inverse[M];                 // 1 / L; 0 where u counts as constant, and over pulleys
  bool inside_pulley = false;        // whether an attachment is inside its pulley in all of the cell
  bool clear_of_pulleys = true;      // whether none is in any
  bool over_pulley[M];               // whether u is affine, with the gradient -turn
  double turn[D][D][M];
  double rest[M], bent[M], change[M];  // largest distance of u from its quadratic and affine parts and its middle
  double largest[M];                   // largest |w|
  double swing[M];                     // largest distance of r / length from its value in the middle

  CellColumns(const CertifiedRig& rig, const double* centre, const double* half_edges)
      : m(rig.m),
        moves(kTurns > 0 && rig.angle > 0 ? N : D),
        angle(moves > D ? rig.angle : 0),
        length(rig.length),
        over_pulley{} {
    const int cables = m - (rig.weight ? 1 : 0);
    double diagonal = 0;
    for (int k = 0; k < D; ++k) {
      double farthest = std::abs(centre[k]);
      for (int j = 0; j < cables; ++j) {
        farthest = std::max(farthest, std::abs(rig.anchors[j * D + k]) + std::abs(rig.arms[j * D + k]));
      }
      cell[k] = half_edges[k];
      half[k] = half_edges[k] + 0x1p-40 * farthest;
      diagonal += half[k] * half[k];
    }
    for (int j = 0; j < m; ++j) {
      std::copy(rig.arms + j * D, rig.arms + (j + 1) * D, arm[j]);
      const double reach = std::sqrt(dot<D>(arm[j], arm[j]));
      double force = 1;
      if (j < cables) {
        lead(rig, j, centre, std::sqrt(diagonal) + angle * reach, angle * angle * reach / 2);
      } else {
        std::copy(rig.anchors + j * D, rig.anchors + (j + 1) * D, u[j]);
        force = std::sqrt(dot<D>(u[j], u[j]));
        inverse[j] = rest[j] = bent[j] = change[j] = 0;
      }
      largest[j] = force * (1 + (kTurns > 0 ? reach / length : 0));
      swing[j] = force * angle * reach / length;
      for (int k = 0; k < D; ++k) column[k][j] = u[j][k];
      for (int i = 0; i < kTurns; ++i) {
        double axis[N] = {};
        axis[i] = 1 / length;
        cross(axis, arm[j], tangent[j][i]);
        column[D + i][j] = dot<D>(tangent[j][i], u[j]);  // (r x u)_i = (e_i x r) . u
      }
    }
  }

  // The cross product of a turn, or a torque, and a vector.
  static void cross(const double* t, const double* x, double* out) {
    if constexpr (kTurns == 1) {
      out[0] = -t[0] * x[1];
      out[1] = t[0] * x[0];
    } else {
      for (int k = 0; k < D; ++k) {
        const int a = (k + 1) % D, b = (k + 2) % D;
        out[k] = kTurns > 0 ? t[a] * x[b] - t[b] * x[a] : 0;
      }
    }
  }

  // Whether a cable may run in any direction.
  bool anywhere(int j) const { return change[j] == 1; }

  // v . w over the cell: value + slope . y + y' C y / 2, up to `error`; C row by row up to its diagonal.
  struct Pull {
    double value[M], slope[N][M], curve[kPairs][M], error[M];
  };

  void pull(const double* v, Pull& found) const {
    const double twist = torque_of(v);
    for (int j = 0; j < m; ++j) {
      const Lever at(*this, v, j);
      found.value[j] = at.along;
      for (int i = 0; i < moves; ++i) found.slope[i][j] = at.slope[i];
      found.error[j] = at.size * rest[j] + twist * turned_rest(j);
      double curve[D][D];
      for (int i = 0, pair = 0; i < D; ++i) {
        for (int k = 0; k <= i; ++k, ++pair) {
          const double flat = (i == k ? 1.0 : 0.0) - u[j][i] * u[j][k];
          curve[i][k] = curve[k][i] =
              (at.slope[i] * u[j][k] + at.slope[k] * u[j][i] - at.along * inverse[j] * flat) * inverse[j];
          found.curve[pair][j] = curve[i][k];
        }
      }
      if (moves > D) add_turns(v, at, curve, j, found);
    }
  }

  // The largest distance of a column from its quadratic and its affine part, and from its value in the middle.
  double quadratic_rest(int j) const { return largest[j] * rest[j] + turned_rest(j); }
  double affine_rest(int j) const { return largest[j] * bent[j] + swing[j] * (change[j] + angle / 2); }
  double shift(int j) const { return largest[j] * change[j] + swing[j]; }

  double pulled(const double* v, int j) const {
    double sum = 0;
    for (int k = 0; k < N; ++k) sum += v[k] * column[k][j];
    return sum;
  }

  // The lever a of a cable along v, and a . u to first order.
  struct Lever {
    double a[D], along = 0, size = 0, slope[N] = {}, g[D];

    Lever(const CellColumns& columns, const double* v, int j) {
      cross(v + D, columns.arm[j], a);
      cross(v + D, columns.u[j], g);
      for (int k = 0; k < D; ++k) a[k] = v[k] + (kTurns > 0 ? a[k] / columns.length : 0);
      along = dot<D>(a, columns.u[j]);
      size = std::sqrt(dot<D>(a, a));
      columns.slope_of(a, along, j, slope);
      for (int k = 0; k < D; ++k) g[k] = columns.length * slope[k] - g[k];  // times the length
      for (int i = D; i < columns.moves; ++i) slope[i] = dot<D>(g, columns.tangent[j][i - D]);
    }
  };

  int pairs() const { return moves * (moves + 1) / 2; }

  // The largest |sum of y_i x_i|, from the lengths of the vectors x_i.
  template <class Size>
  double reach(const Size& at) const {
    double sum = 0, square = 0;
    for (int k = 0; k < D; ++k) sum += std::abs(at(k)) * half[k];
    for (int k = D; k < moves; ++k) square += at(k) * at(k);
    return kTurns > 0 ? sum + angle * std::sqrt(square) : sum;
  }

  // The largest sign y' X y / 2, from the entries of X, or their lengths.
  template <class Entry>
  double bow(const Entry& at, double sign = 1) const {
    double sum = 0, across = 0, most = 0;
    for (int i = 0, pair = 0; i < moves; ++i) {
      for (int k = 0; k < i; ++k, ++pair) {
        const double x = std::abs(at(pair));
        if (k < D) sum += x * half[k] * (i < D ? half[i] : angle);
        if (k >= D) across += x * x;
      }
      const double x = std::max(0.0, sign * at(pair++));
      if (i < D) sum += x * half[i] * half[i] / 2;
      if (i >= D) most = std::max(most, x);
    }
    return sum + angle * angle * (most / 2 + std::sqrt(across / 3));
  }

  static double torque_of(const double* v) { return std::sqrt(dot<kTurns>(v + D, v + D)); }

 private:
  double turned_rest(int j) const { return swing[j] * (bent[j] + angle * (change[j] / 2 + angle / 6)); }

  // The change of a . u by components of the position.
  void slope_of(const double* a, double along, int j, double* slope) const {
    for (int k = 0; k < D; ++k) {
      slope[k] = -(a[k] - along * u[j][k]) * inverse[j];
      for (int i = 0; i < D && over_pulley[j]; ++i) slope[k] -= turn[k][i][j] * a[i];
    }
  }

  void add_turns(const double* v, const Lever& lever, const double (&curve)[D][D], int j, Pull& found) const {
    double back[N][D], mixed[D], b[D];
    const double* const r = arm[j];
    for (int i = 0, pair = D * (D + 1) / 2; i < kTurns; ++i) {
      cross(v + D, tangent[j][i], b);
      slope_of(b, dot<D>(b, u[j]), j, back[i]);
      for (int k = 0; k < D; ++k, ++pair) {
        mixed[k] = length * dot<D>(curve[k], tangent[j][i]) + back[i][k];
        found.curve[pair][j] = mixed[k];
      }
      for (int k = 0; k <= i; ++k, ++pair) {
        double bend = i == k ? -dot<D>(r, lever.g) : 0;
        if (kTurns == 3) bend += (r[i] * lever.g[k] + r[k] * lever.g[i]) / 2;
        found.curve[pair][j] =
            length * (dot<D>(tangent[j][k], mixed) + dot<D>(back[k], tangent[j][i])) + bend / length;
      }
    }
  }

  // Finds u and its bounds. The attachment moves by up to `moved`, and off the tangents of turns by up to
  // `curved`.
  void lead(const CertifiedRig& rig, int j, const double* centre, double moved, double curved) {
    double q[D];
    for (int k = 0; k < D; ++k) q[k] = rig.anchors[j * D + k] - arm[j][k] - centre[k];
    const double L = std::sqrt(dot<D>(q, q));
    const bool runs = moved < L && L > kShortest && L < kLongest;  // certainly out of the cell
    for (int k = 0; k < D; ++k) u[j][k] = q[k] / L;
    const double share = moved / (L - moved);
    change[j] = runs ? 2 * std::sin(std::asin(moved / L) / 2) : 2;
    bent[j] = share * share / std::sqrt(3.0);
    if (runs && bent[j] < change[j]) {
      inverse[j] = 1 / L;
      rest[j] = share * share * share / 2 + curved * (angle / 3 + 2 * moved / (std::sqrt(3.0) * L)) / L;
      bent[j] += curved / L;
    } else {
      inverse[j] = 0;
      if (!(change[j] < 1)) {
        change[j] = 1;
        for (int k = 0; k < D; ++k) u[j][k] = 0;
      }
      rest[j] = bent[j] = change[j];
    }
    if (rig.radii != nullptr && rig.radii[j] > 0) lead_over_pulley(rig, j, q, moved, curved);
  }

  // Replaces u of a cable and its bounds by those over its pulley; q is the vector to the anchor.
  void lead_over_pulley(const CertifiedRig& rig, int j, const double* q, double moved, double curved) {
    const PulleyBend<D> bend(q, rig.radii[j], rig.axes + j * D, moved);
    inside_pulley = inside_pulley || bend.within;
    clear_of_pulleys = clear_of_pulleys && bend.clear;
    inverse[j] = 0;
    change[j] = bend.smooth ? bend.steepest * moved : 1;
    const double second = bend.second * moved * moved / 2;
    over_pulley[j] = change[j] < 1 && second < change[j];
    for (int k = 0; k < D; ++k) {
      u[j][k] = change[j] < 1 ? bend.u[k] : 0;
      for (int i = 0; i < D; ++i) turn[k][i][j] = bend.gradient[k][i];
    }
    if (over_pulley[j]) {
      rest[j] = second + bend.steepest * curved * angle / 3;
      bent[j] = second + bend.steepest * curved;
    } else {
      change[j] = std::min(change[j], 1.0);
      rest[j] = bent[j] = change[j];
    }
  }
};

// value + slope . y + y' C y / 2 for the poses y = (dp, t) of a cell; C row by row up to its diagonal.
template <int N, int D>
struct CellBound {
  using Columns = CellColumns<N, D>;

  const Columns& columns;
  double value = 0, slope[N] = {}, curve[Columns::kPairs] = {};

  explicit CellBound(const Columns& over) : columns(over) {}

  void add(double factor, const typename Columns::Pull& pull, int j) {
    value += factor * pull.value[j];
    for (int i = 0; i < columns.moves; ++i) slope[i] += factor * pull.slope[i][j];
    for (int pair = 0; pair < columns.pairs(); ++pair) curve[pair] += factor * pull.curve[pair][j];
  }

  // Makes it a lower bound for all turns, affine in the position.
  void settle() { value -= columns.angle * std::sqrt(dot<N - D>(slope + D, slope + D)) + bow(-1) + doubt(); }

  // The largest y' C y / 2, with this sign.
  double bow(double sign) const {
    return columns.bow([&](int pair) { return curve[pair]; }, sign);
  }

  // The largest change within the cell, and by rounding of the position.
  double reach() const {
    double sum = 0;
    for (int k = 0; k < D; ++k) sum += std::abs(slope[k]) * columns.cell[k];
    return sum;
  }
  double doubt() const {
    double sum = 0;
    for (int k = 0; k < D; ++k) sum += std::abs(slope[k]) * (columns.half[k] - columns.cell[k]);
    return sum;
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
