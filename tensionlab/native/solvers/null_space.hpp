// Guess of the cables at their limits, in the null space of W where that has one or two dimensions: for m = n + 1
// or n + 2 cables.
//
// The tensions that render the wrench are u + Z s, with u the optimum without limits and Z an orthonormal basis of
// the null space, which is orthogonal to u - t0. So the optimum is the s nearest to the origin with a <= u + Z s
// <= b: on a line the nearest end of an interval, in a plane the nearest point of a polygon, by a dual active set
// (Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex quadratic programs", 1983).
// Rounding, or a W that lacks a rank, may spoil the guess; the caller checks it.
//
// Where no s keeps all limits, K + 1 of them are in conflict: a combination of their cables is constant over the
// null space, and larger at all tensions inside the limits than at u (Farkas). Its multiplier separates the
// wrench.
#pragma once

#include "tensionlab/simd/lanes.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int L, int N, int M, int K>
class NullSpace {
 public:
  using V = Lanes<double, L>;

  // structure: row by row; m = N + K. gram: of W W'. unlimited: u.
  NullSpace(const V* structure, const Factor<V, N>& gram, const V (&unlimited)[M], const V (&lower)[M],
            const V (&upper)[M])
      : unlimited_(unlimited), lower_(lower), upper_(upper) {
    for (int k = 0; k < K; ++k) project(structure, gram, k);
    if constexpr (K == 1) {
      find_end();
    } else {
      find_corner();
    }
  }

  // Where limits are in conflict. separating: of such lanes, the direction d with W'd = -combination.
  auto conflict() const { return conflict_ > V{}; }
  void separate(const V* structure, const Factor<V, N>& gram, V (&separating)[N]) const {
    V image[N];
    TENSIONLAB_UNROLL
    for (int j = 0; j < N; ++j) image[j] = V{};
    for (int i = 0; i < kCables; ++i) {
      V share = V{};
      for (int k = 0; k <= K; ++k) share = conflicting_[k].cable == V{} + i ? conflicting_[k].share : share;
      if constexpr (K == 1) share *= pace(i);
      TENSIONLAB_UNROLL
      for (int j = 0; j < N; ++j) image[j] -= share * structure[j * kCables + i];
    }
    gram.solve(image, separating);
  }

  // 1 where cable i is at its lower limit, 2 where it is at its upper one, else 0.
  V at(int i) const {
    V found = V{};
    for (int k = 0; k < K; ++k) found = active_[k].cable == V{} + i ? active_[k].side : found;
    return found;
  }

 private:
  static constexpr int kCables = N + K;
  static constexpr int kRounds = 5;
  static constexpr double kTiny = 1e-30, kInside = 1e-12, kFar = 1e300;

  // n's >= c, of a cable at a side: 1 lower, 2 upper; no cable is -1.
  struct Bound {
    V n[2], c, cable, side;
  };

  // A cable of the combination.
  struct Conflicting {
    V cable, share;
  };

  // Direction k of the basis: the part of an arbitrary vector in the null space, orthogonal to those before.
  void project(const V* structure, const Factor<V, N>& gram, int k) {
    V image[N], dual[N];
    TENSIONLAB_UNROLL
    for (int j = 0; j < N; ++j) {
      image[j] = V{};
      for (int i = 0; i < kCables; ++i) image[j] += kProbe[k][i] * structure[j * kCables + i];
    }
    gram.solve(image, dual);
    V square = V{}, along = V{};
    for (int i = 0; i < kCables; ++i) {
      V entry = V{} + kProbe[k][i];
      TENSIONLAB_UNROLL
      for (int j = 0; j < N; ++j) entry -= structure[j * kCables + i] * dual[j];
      basis_[k][i] = entry;
      if (k == 1) along += entry * basis_[0][i];
    }
    for (int i = 0; i < kCables; ++i) {
      if (k == 1) basis_[k][i] -= along * basis_[0][i];
      square += basis_[k][i] * basis_[k][i];
    }
    const V inverse = V{} + 1 / square_root<double, L>(larger(square, V(V{} + kTiny)));
    for (int i = 0; i < kCables; ++i) basis_[k][i] *= inverse;
  }

  // On a line: how far s moves for a tension of cable i.
  V pace(int i) const {
    const V z = basis_[0][i];
    return V{} + 1 / (magnitude(z) < V{} + kTiny ? V{} + kTiny : z);
  }

  // The point of the interval nearest to zero.
  void find_end() {
    Bound low{{}, V{} - kFar, V{}, V{}}, high{{}, V{} + kFar, V{}, V{}};
    for (int i = 0; i < kCables; ++i) {
      const V along = pace(i), a = (lower_[i] - unlimited_[i]) * along, b = (upper_[i] - unlimited_[i]) * along;
      const auto rising = basis_[0][i] > V{};
      const V first = rising ? a : b, last = rising ? b : a;
      const auto higher = first > low.c, lower = last < high.c;
      low.c = higher ? first : low.c;
      low.cable = higher ? V{} + i : low.cable;
      low.side = higher ? (rising ? V{} + 1 : V{} + 2) : low.side;
      high.c = lower ? last : high.c;
      high.cable = lower ? V{} + i : high.cable;
      high.side = lower ? (rising ? V{} + 2 : V{} + 1) : high.side;
    }
    conflict_ = low.c > high.c ? V{} + 1 : V{};
    conflicting_[0] = {low.cable, V{} + 1};
    conflicting_[1] = {high.cable, V{} - 1};
    const auto below = high.c < V{}, outside = below | (low.c > V{});
    active_[0].cable = outside ? (below ? high.cable : low.cable) : V{} - 1;
    active_[0].side = below ? high.side : low.side;
  }

  // The point of the polygon nearest to the origin.
  void find_corner() {
    for (Bound& each : active_) each = none();
    for (Conflicting& each : conflicting_) each = {V{} - 1, V{}};
    conflict_ = V{};
    V s[2] = {};
    for (int round = 0; round < kRounds; ++round) {
      Bound worst = none();
      V most = V{} + kInside;
      for (int i = 0; i < kCables; ++i) {
        const V p = basis_[0][i], q = basis_[1][i], tension = unlimited_[i] + p * s[0] + q * s[1];
        const V below = lower_[i] - tension, above = tension - upper_[i];
        const auto under = below > above;
        const V off = under ? below : above;
        const auto worse = off > most;
        most = worse ? off : most;
        worst.n[0] = worse ? (under ? p : -p) : worst.n[0];
        worst.n[1] = worse ? (under ? q : -q) : worst.n[1];
        worst.c = worse ? (under ? lower_[i] - unlimited_[i] : unlimited_[i] - upper_[i]) : worst.c;
        worst.cable = worse ? V{} + i : worst.cable;
        worst.side = worse ? (under ? V{} + 1 : V{} + 2) : worst.side;
      }
      const auto violated = (worst.cable >= V{}) & (conflict_ == V{});
      if (!any(violated)) return;
      const auto open = violated & !oppose(worst, violated);
      add(worst, open, s);
    }
  }

  // Whether the other bounds, which meet at s, exclude a bound that s violates; notes their combination.
  template <class Mask>
  auto oppose(const Bound& bound, const Mask& mask) {
    const Bound &a = active_[0], &b = active_[1];
    const V inverse = V{} + 1 / (a.n[0] * b.n[1] - a.n[1] * b.n[0]);
    const V first = (b.n[0] * bound.n[1] - b.n[1] * bound.n[0]) * inverse,
            second = (a.n[1] * bound.n[0] - a.n[0] * bound.n[1]) * inverse;
    const auto opposed = mask & (first >= V{}) & (second >= V{}) & (bound.c + first * a.c + second * b.c > V{});
    const Bound each[3] = {bound, a, b};
    const V price[3] = {V{} + 1, first, second};
    for (int k = 0; k < 3; ++k) {
      conflicting_[k].cable = opposed ? each[k].cable : conflicting_[k].cable;
      conflicting_[k].share = opposed ? (each[k].side > V{} + 1 ? -price[k] : price[k]) : conflicting_[k].share;
    }
    conflict_ = opposed ? V{} + 1 : conflict_;
    return opposed;
  }

  // The nearest point with another bound, in the open lanes: on it alone, or where it meets one of the others.
  template <class Mask>
  void add(const Bound& bound, const Mask& open, V (&s)[2]) {
    const V pace = bound.c / (bound.n[0] * bound.n[0] + bound.n[1] * bound.n[1]);
    const V foot[2] = {bound.n[0] * pace, bound.n[1] * pace};
    V first[2], second[2];
    const auto meets_first = meet(active_[0], bound, first);
    meet(active_[1], bound, second);
    const auto alone = keeps(active_[0], foot) & keeps(active_[1], foot);
    const auto with_first = meets_first & keeps(active_[1], first);
    for (int k = 0; k < 2; ++k) s[k] = open ? (alone ? foot[k] : with_first ? first[k] : second[k]) : s[k];
    const Bound other = choose(with_first, active_[0], active_[1]);
    active_[1] = choose(open, choose(alone, none(), other), active_[1]);
    active_[0] = choose(open, bound, active_[0]);
  }

  // The point where two bounds meet, and whether it is the point nearest to the origin that keeps both.
  static auto meet(const Bound& a, const Bound& b, V (&s)[2]) {
    const V inverse = V{} + 1 / (a.n[0] * b.n[1] - a.n[1] * b.n[0]);
    s[0] = (a.c * b.n[1] - a.n[1] * b.c) * inverse;
    s[1] = (a.n[0] * b.c - a.c * b.n[0]) * inverse;
    const V price_a = (s[0] * b.n[1] - s[1] * b.n[0]) * inverse,
            price_b = (a.n[0] * s[1] - a.n[1] * s[0]) * inverse;
    return (price_a >= V{}) & (price_b >= V{});
  }

  static auto keeps(const Bound& bound, const V (&s)[2]) {
    return bound.n[0] * s[0] + bound.n[1] * s[1] >= bound.c - kInside;
  }

  // A bound of no cable, which every point keeps.
  static Bound none() { return {{V{}, V{}}, V{} - 1, V{} - 1, V{}}; }

  template <class Mask>
  static Bound choose(const Mask& mask, const Bound& a, const Bound& b) {
    return {{mask ? a.n[0] : b.n[0], mask ? a.n[1] : b.n[1]},
            mask ? a.c : b.c,
            mask ? a.cable : b.cable,
            mask ? a.side : b.side};
  }

  // Arbitrary vectors, whose parts in the null space span it.
  static constexpr double kProbe[2][8] = {{1.0, -0.62, 0.81, 0.37, -0.93, 0.56, -0.44, 0.73},
                                          {0.41, 0.88, -0.53, 0.97, 0.34, -0.79, 0.67, 0.59}};

  const V (&unlimited_)[M];
  const V (&lower_)[M];
  const V (&upper_)[M];
  V basis_[K][kCables];
  Bound active_[K];
  Conflicting conflicting_[K + 1];
  V conflict_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
