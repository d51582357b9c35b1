// A linear program over tensions whose limits close in, solved exactly.
//
//   maximise S   subject to   A t + g S = f,   l_i(S) <= t_i <= u_i(S)
//
// The limits of each cable approach each other as S grows, linearly between two values of S and not at all beyond
// them. tension_programs.hpp puts the tension programs into this form. Written as an ordinary linear program it
// would have a row for every limit that moves; here it has those of A.
//
// Method: dual simplex for bounded variables. Any direction y bounds S from above, because y'(f - g S) may be no
// more than the most that y'A t can be, with every cable held at the limit to which y pulls it. Where that bound
// is attained only free cables, those with y'A_i = 0, are still to be chosen. If they make up the wrench that is
// missing inside their limits, the bound is the answer. Otherwise y turns: towards what no free cable can make up,
// or so as to hold the free cable that breaks its limits by most. The bound falls along the turn. At breakpoints
// other cables change limits, until the one that would stop the fall becomes free (the long-step rule: one step
// passes many bases). All limits are finite, so that no first phase is needed; dependent rows and columns are like
// any others. After some steps of no length Bland's rule takes over, which cannot cycle.
//
// Sources: Lemke (1954), "The dual method of solving the linear programming problem"; Maros (2003), "A generalized
// dual phase-2 simplex algorithm", for the long step; Bland (1977), "New finite pivoting rules for the simplex
// method". No heap, no exceptions.
#pragma once

#include <cmath>
#include <limits>

#include "free_columns.hpp"
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

  // The program: set all of these, then solve. No tensions have an S below least, and an S above most is as good
  // as most.
  Real rows[N][M] = {}, gain[N] = {}, target[N] = {};  // A, g, f
  ClosingLimits<Real> limits[M] = {};
  Real least = std::numeric_limits<Real>::lowest(), most = std::numeric_limits<Real>::max();

  // start: a direction that bounds S, such as what is missing while all limits are shut; nought if nothing is.
  // Returns whether there are tensions for any S at all, or false after kStepLimit steps, far beyond what any
  // known problem takes.
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

  // Limits of cable i that all of the best tensions keep, while no others with A t + g S = f do: a cable that y
  // pulls must stay where it is held.
  void face(int i, Real* lower, Real* upper) const {
    const ClosingLimits<Real>& c = limits[i];
    const Real s = smaller(larger(smaller(value_, most), c.open), c.shut);
    *lower = c.lower + c.rise * s;
    *upper = c.upper - c.fall * s;
    if (value_ >= most || along_[i] == 0) return;
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

  // d'(f - A t - g S) = excess - rate S for a direction d, with all cables held at their ends but the free ones.
  struct Cut {
    Real excess, rate;
  };

  void begin(const Real* start) {
    stalled_ = 0;
    value_ = kInfinite;
    top_ = -kInfinite;
    size_ = 0;
    for (int k = 0; k < N; ++k) size_ += magnitude(target[k]);
    for (int i = 0; i < m_; ++i) {
      const ClosingLimits<Real>& c = limits[i];
      length_[i] = 0;
      for (int k = 0; k < N; ++k) length_[i] = larger(length_[i], magnitude(rows[k][i]));
      size_ += length_[i] * larger(magnitude(c.lower + c.rise * c.open), magnitude(c.upper - c.fall * c.open));
      free_[i] = false;
    }
    columns_.clear();
    copy<N>(start, direction_);
    settle();
    for (int i = 0; i < m_; ++i) {
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
    Cut cut{dot<N>(d, target), dot<N>(d, gain)};
    for (int i = 0; i < m_; ++i) {
      cut.excess -= along[i] * held_[i];
      cut.rate += along[i] * held_rate_[i];
    }
    return cut;
  }

  // Lower S to what the direction y + theta turn allows. Limits begin or cease to move on the way, which changes
  // both cuts. Returns false where no S will do.
  bool descend(Cut& y, Cut& change, Real theta) {
    const Real rounding = kMissing * size_ * (1 + theta);
    for (Real passed = kInfinite;;) {
      const Real excess = y.excess + theta * change.excess, rate = y.rate + theta * change.rate;
      value_ = smaller(rate < 0 ? excess / rate : -kInfinite, passed);
      // A kink is passed only where that makes a difference: beyond it the bound may have no slope left.
      if (excess - rate * top_ <= rounding) value_ = larger(value_, top_);
      if (value_ >= top_) return value_ >= least;
      passed = top_;
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
    Real tension[M], share[N] = {};
    for (int i = 0; i < m_; ++i) tension[i] = held_[i] + held_rate_[i] * value_;
    for (int k = 0; k < N; ++k) {
      turn_[k] = target[k] - gain[k] * value_;
      for (int i = 0; i < m_; ++i) turn_[k] -= rows[k][i] * tension[i];
    }
    columns_.take_out(turn_, share);
    if (!(normalise<N>(turn_) > kMissing * size_ && columns_.count() + 1 < N)) {
      columns_.solve(share);
      const int place = worst_free(share);
      if (place < 0) return false;
      // Turn to where its end pulls, and none of the other free cables.
      const int leaving = columns_.cable(place);
      for (int k = 0; k < N; ++k) turn_[k] = at_upper_[leaving] ? rows[k][leaving] : -rows[k][leaving];
      columns_.drop(place);
      free_[leaving] = false;
      hold(leaving);
      columns_.take_out(turn_, share);
      normalise<N>(turn_);
    }
    columns_.take_out(turn_, share);
    normalise<N>(turn_);
    return true;
  }

  // The place of the free cable that breaks its limits by most; -1 if none does. Measured is the wrench that would
  // be missing if it stayed at its limit.
  int worst_free(const Real* tension) {
    Real worst = kMissing * size_;
    int found = -1;
    for (int j = 0; j < columns_.count(); ++j) {
      const int i = columns_.cable(j);
      const Real below = lower_[i].at(value_) - tension[j], above = tension[j] - upper_[i].at(value_);
      if (!(below > 0 || above > 0)) continue;
      const Real broken = larger(below, above) * columns_.distance(j);
      if (!(broken > (bland() ? kMissing * size_ : worst))) continue;
      if (bland() && found >= 0 && i > columns_.cable(found)) continue;
      worst = broken;
      found = j;
      at_upper_[i] = above > below;
    }
    return found;
  }

  // Turn y until the bound falls no further. Returns false where no S will do.
  bool search() {
    Real breakpoint[M];
    pull(turn_, turn_along_);
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
        copy<N>(turn_, direction_);
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
        release(next, theta);
        return true;
      }
    }
  }

  // The turn ends at theta, where cable i becomes free.
  void release(int i, Real theta) {
    Real column[N];
    for (int k = 0; k < N; ++k) {
      column[k] = rows[k][i];
      direction_[k] += theta * turn_[k];
    }
    columns_.add(i, column);
    free_[i] = true;
    hold(i);
    stalled_ = theta > 0 ? 0 : stalled_ + 1;
    settle();
  }

  // Make y normal to the free columns and of unit length.
  void settle() {
    Real share[N] = {};
    columns_.take_out(direction_, share);
    columns_.take_out(direction_, share);
    normalise<N>(direction_);
    pull(direction_, along_);
  }

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

  bool bland() const { return stalled_ > kPatience; }

  int m_, steps_ = 0, stalled_ = 0;
  Real value_ = 0;                                            // the bound on S
  Real top_ = 0;                                              // the next kink in the course of any limit
  Real size_ = 0;                                             // what errors are measured against
  Real direction_[N] = {}, turn_[N] = {};                     // y and where it turns
  Real along_[M] = {}, turn_along_[M] = {}, length_[M] = {};  // y'A, turn'A, sizes of the columns
  End lower_[M] = {}, upper_[M] = {};
  Real held_[M] = {}, held_rate_[M] = {}, kink_[M] = {};  // the end at which a cable is held, nought if it is free
  bool at_upper_[M] = {}, free_[M] = {};
  FreeColumns<Real, N> columns_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
