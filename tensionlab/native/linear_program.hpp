// A linear program over tensions whose limits close in, solved exactly.
//
//   maximise S   subject to   A t + g S = f,   l_i(S) <= t_i <= u_i(S)
//
// The limits of each cable approach each other as S grows, linearly between two values of S and not at all beyond
// them. tension_programs.hpp puts the tension programs into this form. Written as an ordinary linear program it
// would have a row for every limit that moves; here it has those of A.
//
// Method: dual simplex for bounded variables. Any direction y bounds S from above, because y'(f - g S) may be no
// more than the most that y'A t can be, with every cable at the limit to which y pulls it. Where that bound is
// attained, only free cables (those with y'A_i = 0) are still to be chosen. If they make up the wrench that is
// missing inside their limits, the bound is the answer. Otherwise y turns: towards what no free cable can make up,
// or so as to hold the free cable that breaks its limit by most at that limit. The bound falls along the turn. At
// breakpoints other cables change limits, until the one that would stop the fall becomes free (the long-step rule:
// a step passes many bases). All limits are finite, so that no first phase is needed. An orthogonal basis of the
// free columns, built anew whenever one leaves, takes dependent columns and rows as they come. After some steps of
// no length Bland's rule takes over, which cannot cycle.
//
// Sources: Lemke (1954), "The dual method of solving the linear programming problem"; Maros (2003), "A generalized
// dual phase-2 simplex algorithm", for the long step; Bland (1977), "New finite pivoting rules for the simplex
// method". No heap, no exceptions.
#pragma once

#include <cmath>
#include <limits>

#include "lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// lower + rise s <= t <= upper - fall s, where s is S or, beyond [open, shut], the nearer end.
template <class Real>
struct ClosingLimits {
  Real lower, upper, rise, fall, open, shut;
};

template <class Real, int N, int M>
class LinearProgram {
 public:
  explicit LinearProgram(int m) : m_(m) {}

  // The program: set all of these, then solve.
  Real rows[N][M] = {}, gain[N] = {}, target[N] = {};  // A, g, f
  ClosingLimits<Real> limits[M] = {};
  Real least = std::numeric_limits<Real>::lowest();  // no tensions have a smaller S

  // start: a direction that bounds S; nought where nothing is missing while all limits are shut. Returns whether
  // there are tensions for any S at all, or false after kStepLimit steps, far beyond what any known problem takes.
  bool solve(const Real* start) {
    begin(start);
    for (steps_ = 1; steps_ <= kStepLimit; ++steps_) {
      Cut cut = measure(direction_, along_), still{0, 0};
      if (steps_ == 1 && !(cut.rate < 0 || cut.excess > 0)) return true;
      if (!descend(cut, still, 0)) return false;
      if (!turn()) return true;
      if (!search()) return false;
    }
    return false;
  }

  int steps() const { return steps_; }

  // Limits of cable i that all of the best tensions keep. Of the tensions with A t + g S = f no others keep them:
  // a cable that y pulls must stay where it is pulled to.
  void face(int i, Real* lower, Real* upper) const {
    *lower = lower_[i].at(value_);
    *upper = upper_[i].at(value_);
    if (along_[i] == 0) return;
    (at_upper_[i] ? *lower : *upper) = at_upper_[i] ? *upper : *lower;
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr Real kInfinite = std::numeric_limits<Real>::infinity();
  static constexpr Real kMissing = 64 * kUlp;   // a wrench that may be missing, against all that there is
  static constexpr Real kNought = 4096 * kUlp;  // a pull on a cable that counts as none, against its column
  static constexpr int kPatience = 2 * N;       // steps of no length before Bland's rule
  static constexpr int kStepLimit = 50 + 10 * M;

  // constant + rate S.
  struct End {
    Real constant, rate;
    Real at(Real s) const { return constant + rate * s; }
  };

  // d'(f - A t - g S) = excess - rate S for a direction d, with all cables but the free ones held at their ends.
  struct Cut {
    Real excess, rate;
  };

  void begin(const Real* start) {
    stalled_ = count_ = 0;
    value_ = size_ = 0;
    for (int k = 0; k < N; ++k) size_ += magnitude(target[k]);
    for (int i = 0; i < m_; ++i) length_[i] = 0;
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < m_; ++i) length_[i] = larger(length_[i], magnitude(rows[k][i]));
    }
    copy(start, direction_);
    normalise(direction_);
    for (int i = 0; i < m_; ++i) free_[i] = false;
    pull(direction_, along_);
    top_ = -kInfinite;
    for (int i = 0; i < m_; ++i) {
      const ClosingLimits<Real>& c = limits[i];
      size_ += length_[i] * larger(magnitude(c.lower + c.rise * c.open), magnitude(c.upper - c.fall * c.open));
      at_upper_[i] = along_[i] > 0;
      follow(i, kInfinite);
      top_ = larger(top_, kink_[i]);
    }
  }

  // The ends of cable i for S just below top, down to the next kink in their course.
  void follow(int i, Real top) {
    const ClosingLimits<Real>& c = limits[i];
    const bool shut = top > c.shut, moving = !shut && top > c.open;
    const Real s = shut ? c.shut : c.open;
    lower_[i] = moving ? End{c.lower, c.rise} : End{c.lower + c.rise * s, 0};
    upper_[i] = moving ? End{c.upper, -c.fall} : End{c.upper - c.fall * s, 0};
    kink_[i] = shut ? c.shut : moving ? c.open : -kInfinite;
    hold(i);
  }

  void hold(int i) {
    const End& end = at_upper_[i] ? upper_[i] : lower_[i];
    held_[i] = free_[i] ? Real(0) : end.constant;
    held_rate_[i] = free_[i] ? Real(0) : end.rate;
  }

  Cut measure(const Real* d, const Real* along) const {
    Cut cut{dot(d, target), dot(d, gain)};
    for (int i = 0; i < m_; ++i) {
      cut.excess -= along[i] * held_[i];
      cut.rate += along[i] * held_rate_[i];
    }
    return cut;
  }

  // Lower S to what the direction y + theta turn allows. Limits begin or cease to move on the way, which changes
  // both cuts. Returns false where no S will do.
  bool descend(Cut& y, Cut& change, Real theta) {
    for (;;) {
      const Real rate = y.rate + theta * change.rate;
      value_ = rate < 0 ? (y.excess + theta * change.excess) / rate : -kInfinite;
      if (value_ >= top_) return value_ >= least;
      const Real passed = top_;
      top_ = -kInfinite;
      for (int i = 0; i < m_; ++i) {
        if (kink_[i] >= passed) follow(i, passed);
        top_ = larger(top_, kink_[i]);
      }
      y = measure(direction_, along_);
      change = measure(turn_, turn_along_);
    }
  }

  // Choose how to turn y. Returns false where the bound is attained.
  bool turn() {
    Real tension[M], missing[N], share[N];
    for (int i = 0; i < m_; ++i) tension[i] = held_[i] + held_rate_[i] * value_;
    for (int k = 0; k < N; ++k) {
      missing[k] = target[k] - gain[k] * value_;
      for (int i = 0; i < m_; ++i) missing[k] -= rows[k][i] * tension[i];
    }
    for (int j = 0; j < count_; ++j) {
      share[j] = dot(basis_[j], missing);
      subtract(basis_[j], share[j], missing);
    }
    if (normalise(missing) > kMissing * size_ && count_ + 1 < N) {
      copy(missing, turn_);
    } else {
      const int worst = worst_free(share);
      if (worst < 0) return false;
      release(worst);
    }
    clean(turn_);
    normalise(turn_);
    return true;
  }

  // Which free cable breaks its limits by most; -1 if none does. Measured is the wrench that would be missing if
  // it stayed at its limit. share: the part of the missing wrench along each vector of the basis.
  int worst_free(const Real* share) {
    Real tension[N], worst = kMissing * size_;
    int found = -1;
    for (int j = count_ - 1; j >= 0; --j) {
      tension[j] = share[j];
      for (int k = j + 1; k < count_; ++k) tension[j] -= triangle_[j][k] * tension[k];
      tension[j] /= triangle_[j][j];
    }
    for (int j = 0; j < count_; ++j) {
      const int i = order_[j];
      const Real below = lower_[i].at(value_) - tension[j], above = tension[j] - upper_[i].at(value_);
      if (!(below > 0 || above > 0)) continue;
      // Row j of the inverse triangle is as long as one over the distance of the column from the span of the
      // others.
      Real row[N] = {}, square = 0;
      for (int k = j; k < count_; ++k) {
        row[k] = k == j ? Real(1) : Real(0);
        for (int p = j; p < k; ++p) row[k] -= row[p] * triangle_[p][k];
        row[k] /= triangle_[k][k];
        square += row[k] * row[k];
      }
      const Real broken = larger(below, above) / std::sqrt(square);
      if (bland() && found >= 0 ? broken <= kMissing * size_ || i > order_[found] : broken <= worst) continue;
      worst = broken;
      found = j;
      at_upper_[i] = above > below;
    }
    return found;
  }

  // The cable in place j is no longer free: turn to where its end pulls, and none of the other free cables.
  void release(int j) {
    const int leaving = order_[j], last = count_;
    free_[leaving] = false;
    hold(leaving);
    count_ = j;
    for (int k = j + 1; k < last; ++k) extend(order_[k]);
    for (int k = 0; k < N; ++k) turn_[k] = at_upper_[leaving] ? rows[k][leaving] : -rows[k][leaving];
  }

  // Turn y until the bound falls no further. Returns false where no S will do.
  bool search() {
    pull(turn_, turn_along_);
    Real breakpoint[M];
    for (int i = 0; i < m_; ++i) {
      const Real pace = at_upper_[i] ? -turn_along_[i] : turn_along_[i];
      const Real distance = at_upper_[i] ? along_[i] : -along_[i];
      breakpoint[i] = pace > 0 ? (distance > 0 ? distance / pace : Real(0)) : kInfinite;
    }
    Cut cut = measure(direction_, along_), change = measure(turn_, turn_along_);
    for (;;) {
      int next = 0;
      for (int i = 1; i < m_; ++i) next = breakpoint[i] < breakpoint[next] ? i : next;
      const Real theta = breakpoint[next];
      if (theta == kInfinite) {
        // The bound falls all the way, so that the turn itself is the better direction.
        copy(turn_, direction_);
        stalled_ = 0;
        settle();
        return true;
      }
      if (!descend(cut, change, theta)) return false;
      if (!bland()) {
        breakpoint[next] = kInfinite;
        at_upper_[next] = !at_upper_[next];
        hold(next);
        cut = measure(direction_, along_);
        change = measure(turn_, turn_along_);
      }
      if (bland() || change.excess - change.rate * value_ <= kMissing * size_) {
        free_[next] = true;
        hold(next);
        extend(next);
        for (int k = 0; k < N; ++k) direction_[k] += theta * turn_[k];
        stalled_ = theta > 0 ? 0 : stalled_ + 1;
        settle();
        return true;
      }
    }
  }

  // Make y normal to the free columns and of unit length.
  void settle() {
    clean(direction_);
    normalise(direction_);
    pull(direction_, along_);
  }

  // One more column for the basis of the free ones.
  void extend(int i) {
    if (count_ >= N) return;  // never: y is normal to them all. The compiler cannot know.
    Real *vector = basis_[count_], part[N] = {};
    for (int k = 0; k < N; ++k) vector[k] = rows[k][i];
    for (int pass = 0; pass < 2; ++pass) {
      for (int j = 0; j < count_; ++j) {
        const Real more = dot(basis_[j], vector);
        part[j] += more;
        subtract(basis_[j], more, vector);
      }
    }
    for (int j = 0; j < count_; ++j) triangle_[j][count_] = part[j];
    triangle_[count_][count_] = normalise(vector);
    order_[count_++] = i;
  }

  // Take out of x its part in the span of the free columns; twice, because rounding leaves some of it the first
  // time.
  void clean(Real* x) const {
    for (int pass = 0; pass < 2; ++pass) {
      for (int j = 0; j < count_; ++j) subtract(basis_[j], dot(basis_[j], x), x);
    }
  }

  bool bland() const { return stalled_ > kPatience; }

  // d'A; nought for free cables, and for those that depend on them but for rounding.
  void pull(const Real* d, Real* along) const {
    for (int i = 0; i < m_; ++i) along[i] = d[0] * rows[0][i];
    for (int k = 1; k < N; ++k) {
      for (int i = 0; i < m_; ++i) along[i] += d[k] * rows[k][i];
    }
    for (int i = 0; i < m_; ++i) {
      along[i] = free_[i] || magnitude(along[i]) <= kNought * length_[i] ? Real(0) : along[i];
    }
  }

  static Real normalise(Real* x) {
    const Real length = std::sqrt(dot(x, x));
    for (int k = 0; k < N; ++k) x[k] = length > 0 ? x[k] / length : Real(0);
    return length;
  }

  static void subtract(const Real* x, Real factor, Real* from) {
    for (int k = 0; k < N; ++k) from[k] -= factor * x[k];
  }

  static void copy(const Real* from, Real* to) {
    for (int k = 0; k < N; ++k) to[k] = from[k];
  }

  static Real dot(const Real* x, const Real* y) {
    Real sum = 0;
    for (int k = 0; k < N; ++k) sum += x[k] * y[k];
    return sum;
  }

  int m_, steps_ = 0, stalled_ = 0;
  Real value_ = 0, top_ = 0,
       size_ = 0;  // the bound on S, the next kink of any limit, what errors are measured against
  Real direction_[N] = {}, turn_[N] = {};                     // y and where it turns
  Real along_[M] = {}, turn_along_[M] = {}, length_[M] = {};  // y'A, turn'A, sizes of the columns
  End lower_[M] = {}, upper_[M] = {};
  Real held_[M] = {}, held_rate_[M] = {}, kink_[M] = {};  // the end at which a cable is held, nought if it is free
  bool at_upper_[M] = {}, free_[M] = {};
  int count_ = 0, order_[N] = {};                // the free cables, in the order of the basis
  Real basis_[N][N] = {}, triangle_[N][N] = {};  // A_free = basis' triangle, each vector of the basis a row
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
