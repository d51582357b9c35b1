// The reachable wrench nearest to one that is out of reach, in every lane at once.
//
//   minimise |w - W t|^2   subject to   a <= t <= b
//
// What tensions can render is bounded by flat faces. On the one that is nearest, all cables pull with a limit but a
// few, whose columns are independent. A direction that separates w tells nearly which: the cables that it hardly
// moves are free, the others at the limit that it points to. From there an active set: the free cables step to their
// least squares; the first to meet a limit stays there; where all have room, the cable that would most reduce the
// error comes free. The error falls with every step, so that no set comes twice.
//
// Found is an answer only where it is the only one: the error r is at right angles to the columns of the free cables,
// and clearly on the proper side of all others. Then r also separates w.
//
// Source: Stark and Parker (1995), "Bounded-variable least-squares: an algorithm and applications".
#pragma once

#include <cmath>
#include <limits>

#include "factor.hpp"
#include "lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class NearestFace {
 public:
  // structure is n x m, row by row; direction: one that nearly separates the wrench.
  struct Problem {
    const Real *structure, *wrench, *lower, *upper, *direction;
  };

  // m cables; weight_roots: square roots of the n wrench weights.
  NearestFace(int m, const Real* weight_roots) : m_(m) {
    for (int k = 0; k < N; ++k) weight_roots_[k] = weight_roots[k];
  }

  // One problem for each lane.
  void solve(const Problem (&problems)[L]) {
    load(problems);
    for (int round = 0; round < kStepLimit; ++round) {
      look();
      if (!any(open_ > V{})) break;
      step();
    }
  }

  // Whether lane l has the answer.
  bool found(int l) const { return read<Real>(found_, l) != 0; }

  // The answer of lane l: tensions (m) and the separating direction (n), of unit length. Returns the steps taken.
  int store(int l, Real* tensions, Real* separation) const {
    for (int i = 0; i < m_; ++i) tensions[i] = read<Real>(tension_[i], l);
    for (int s = 0; s < N; ++s) {
      const int cable = static_cast<int>(read<Real>(cable_[s], l));
      if (cable >= 0) tensions[cable] = read<Real>(free_[s], l);
    }
    Real square = 0;
    for (int k = 0; k < N; ++k) {
      separation[k] = weight_roots_[k] * read<Real>(error_[k], l);
      square += separation[k] * separation[k];
    }
    const Real length = std::sqrt(square);
    for (int k = 0; k < N; ++k) separation[k] /= length;
    return static_cast<int>(read<Real>(steps_, l));
  }

 private:
  using V = Lanes<Real, L>;

  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr bool kDouble = kUlp < Real(1e-10);
  static constexpr int kStepLimit = 4 * N + 4;  // hardly one in a million takes more
  // Least pivot of independent columns, against their squared length; what an error is more than, against wrench and
  // tensions; and what is clearly not at right angles.
  static constexpr Real kPivot = kDouble ? Real(1e-8) : Real(1e-3), kError = kDouble ? Real(1e-10) : Real(1e-4),
                        kAngle = kDouble ? Real(1e-9) : Real(1e-4);
  static constexpr Real kNever = std::numeric_limits<Real>::max();

  // A cable that comes free.
  struct Pick {
    V merit, cable, column[N], tension, lower, upper;
  };

  void load(const Problem (&problems)[L]) {
    const V zero = V{}, one = zero + Real(1);
    const Real* row[L];
    V direction[N];
    V largest = zero;
    size_ = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      V square = zero;
      for (int l = 0; l < L; ++l) row[l] = problems[l].structure + k * m_;
      transpose<Real, L>(row, m_, [&](int i, const V& entry) {
        column_[i][k] = entry * weight_roots_[k];
        square += column_[i][k] * column_[i][k];
      });
      largest = larger(largest, square);
      wrench_[k] = gather<Real, L>([&](int l) { return problems[l].wrench[k]; }) * weight_roots_[k];
      direction[k] = gather<Real, L>([&](int l) { return problems[l].direction[k]; }) / weight_roots_[k];
      size_ = larger(size_, magnitude(wrench_[k]));
    }
    gain_ = square_root<Real, L>(largest);
    V merit[M], strongest = zero;
    for (int i = 0; i < m_; ++i) {
      lower_[i] = gather<Real, L>([&](int l) { return problems[l].lower[i]; });
      upper_[i] = gather<Real, L>([&](int l) { return problems[l].upper[i]; });
      strongest = larger(strongest, larger(magnitude(lower_[i]), magnitude(upper_[i])));
      V along = zero;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) along += direction[k] * column_[i][k];
      const auto up = along > zero;
      tension_[i] = up ? upper_[i] : lower_[i];
      room_[i] = up ? -one : one;
      merit[i] = -magnitude(along);
    }
    size_ = larger(size_, V(gain_ * strongest));
    for (int s = 0; s < N; ++s) {
      cable_[s] = -one;
      free_[s] = least_[s] = most_[s] = zero;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) own_[s][k] = zero;
    }
    for (int s = 0; s < (m_ < N - 1 ? m_ : N - 1); ++s) {
      Pick pick = best(merit);
      pick.tension = (pick.lower + pick.upper) / 2;
      admit(pick, one > zero);
    }
    open_ = one;
    found_ = dependent_ = steps_ = zero;
  }

  // The cable at a limit with the greatest merit.
  Pick best(const V* merit) const {
    const V zero = V{};
    Pick pick;
    pick.merit = zero - kNever;
    pick.cable = pick.tension = pick.lower = pick.upper = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) pick.column[k] = zero;
    for (int i = 0; i < m_; ++i) {
      const auto better = (room_[i] != zero) & (merit[i] > pick.merit);
      pick.merit = better ? merit[i] : pick.merit;
      pick.cable = better ? zero + Real(i) : pick.cable;
      pick.tension = better ? tension_[i] : pick.tension;
      pick.lower = better ? lower_[i] : pick.lower;
      pick.upper = better ? upper_[i] : pick.upper;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) pick.column[k] = better ? column_[i][k] : pick.column[k];
    }
    return pick;
  }

  // Make the cable free, in the lanes of the mask.
  template <class Mask>
  void admit(const Pick& pick, const Mask& mask) {
    const V zero = V{};
    auto waiting = mask;
    for (int s = 0; s < N; ++s) {
      const auto here = waiting & (cable_[s] < zero);
      waiting = waiting & !here;
      cable_[s] = here ? pick.cable : cable_[s];
      free_[s] = here ? pick.tension : free_[s];
      least_[s] = here ? pick.lower : least_[s];
      most_[s] = here ? pick.upper : most_[s];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) own_[s][k] = here ? pick.column[k] : own_[s][k];
    }
    for (int i = 0; i < m_; ++i) {
      const auto it = mask & (pick.cable == zero + Real(i));
      room_[i] = it ? zero : room_[i];
      tension_[i] = it ? zero : tension_[i];
    }
  }

  // The error. Where the free columns are at right angles to it, is any other cable on the wrong side?
  void look() {
    const V zero = V{}, one = zero + Real(1);
    V error[N], norm = zero, steepest = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error[k] = wrench_[k];
    for (int i = 0; i < m_; ++i) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= column_[i][k] * tension_[i];
    }
    for (int s = 0; s < N; ++s) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= own_[s][k] * free_[s];
    }
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      error_[k] = error[k];
      norm = larger(norm, magnitude(error[k]));
    }
    for (int s = 0; s < N; ++s) {
      along_[s] = inner(own_[s], error);
      steepest = larger(steepest, magnitude(along_[s]));
    }
    const V noise = 64 * kUlp * gain_ * size_;
    const auto flat = (open_ > zero) & (steepest <= noise);
    if (!any(flat)) return;
    V merit[M];
    for (int i = 0; i < m_; ++i) merit[i] = room_[i] * inner(column_[i], error);
    const Pick pick = best(merit);
    const V clear = noise + kAngle * gain_ * norm;
    const auto wrong = flat & (pick.merit > clear);
    const auto end = flat & (pick.merit <= clear);
    const auto sure = (pick.merit < -clear) & (norm > kError * size_) & (dependent_ == zero);
    found_ = end & sure ? one : found_;
    open_ = end ? zero : open_;
    if (!any(wrong)) return;
    admit(pick, wrong);
    for (int s = 0; s < N; ++s) along_[s] = inner(own_[s], error);
  }

  // The free cables step to their least squares, or as far as the first limit.
  void step() {
    const V zero = V{}, one = zero + Real(1);
    const auto open = open_ > zero;
    V gram[N][N], least[N], change[N], product, dependent = zero;
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      TENSIONLAB_UNROLL
      for (int r = 0; r <= s; ++r) gram[s][r] = inner(own_[s], own_[r]);
      const auto none = gram[s][s] == zero;
      dependent = none & (cable_[s] >= zero) ? one : dependent;
      gram[s][s] = none ? one : gram[s][s];
      least[s] = kPivot * gram[s][s];
    }
    dependent += solve_with_pivots(gram, along_, least, change, product);
    dependent_ = open ? dependent : dependent_;
    V pace = one, stop = zero - one, cable = zero - one, limit = zero, room = zero;
    for (int s = 0; s < N; ++s) {
      const auto up = change[s] > zero;
      const V end = up ? most_[s] : least_[s];
      const V ratio = (end - free_[s]) / change[s];  // of what does not move: none or not a number
      const auto nearer = (ratio >= zero) & (ratio < pace);
      pace = nearer ? ratio : pace;
      stop = nearer ? zero + Real(s) : stop;
      cable = nearer ? cable_[s] : cable;
      limit = nearer ? end : limit;
      room = nearer ? (up ? -one : one) : room;
    }
    const auto leaves = open & (stop >= zero);
    for (int s = 0; s < N; ++s) {
      const auto here = leaves & (stop == zero + Real(s));
      const V moved = smaller(larger(V(free_[s] + pace * change[s]), least_[s]), most_[s]);
      free_[s] = here ? zero : (open ? moved : free_[s]);
      cable_[s] = here ? zero - one : cable_[s];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) own_[s][k] = here ? zero : own_[s][k];
    }
    steps_ += open ? one : zero;
    if (!any(leaves)) return;
    for (int i = 0; i < m_; ++i) {
      const auto it = leaves & (cable == zero + Real(i));
      tension_[i] = it ? limit : tension_[i];
      room_[i] = it ? room : room_[i];
    }
  }

  static V inner(const V (&x)[N], const V (&y)[N]) {
    V sum = x[0] * y[0];
    TENSIONLAB_UNROLL
    for (int k = 1; k < N; ++k) sum += x[k] * y[k];
    return sum;
  }

  int m_;
  Real weight_roots_[N];
  V column_[M][N] = {}, wrench_[N] = {}, lower_[M] = {}, upper_[M] = {}, gain_ = {}, size_ = {};
  V tension_[M] = {}, room_[M] = {};  // of a cable at a limit; where it has room: 1 above, -1 below, 0 if it is free
  // Free cables: which, or -1; column, tension and limits.
  V cable_[N] = {}, own_[N][N] = {}, free_[N] = {}, least_[N] = {}, most_[N] = {};
  V error_[N] = {}, along_[N] = {};
  V open_ = {}, found_ = {}, dependent_ = {};  // flags
  V steps_ = {};
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
