// A linear program over tensions whose limits close in, exactly.
//
//   maximise S   subject to   A t + g S = f,   l_i(S) <= t_i <= u_i(S)
//
// The limits of every cable close in on each other as S grows, linearly between two values of S and not at all
// outside them. tension_programs.hpp puts the tension programs into this form. As an ordinary linear program it
// would have a row for every limit that moves; here a step costs no more than a product with A, because S itself
// takes the place of one basic variable.
//
// Method: the dual simplex method for bounded variables, on the facets of the set of wrenches that A can make.
// Any direction y bounds S from above: y'f may not exceed the most that y'(A t + g S) can be, which puts every
// cable at the limit to which y pulls it. A step looks at the tensions where that bound is reached. If the free
// cables (those with y'A_i = 0) can make up what is missing inside their limits, they prove each other best. If not,
// the missing wrench, or the free cable that breaks its limit by most, is a direction in which to turn y, and the
// bound falls along it: from breakpoint to breakpoint, at each of which a cable changes limits, until one of them
// would rather become free (the long-step rule: one step passes many bases). All limits are finite, so there is no
// first phase. An orthogonal basis of the free cables, built anew whenever one leaves, makes columns that depend on
// each other harmless. Steps of length nought are counted, and after some Bland's rule takes over, which cannot cycle.
//
// Sources: Lemke (1954) for the dual method; Wagner (1958) for bounded variables; Kirillova et al. (1979) and
// Maros (2003) for the long step; Bland (1977). No heap, no exceptions.
#pragma once

#include <cmath>
#include <limits>

#include "lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// lower + rise s and upper - fall s, where s is S or the end of [open, shut] that S is beyond.
template <class Real>
struct ClosingLimits {
  Real lower, upper, rise, fall, open, shut;
};

template <class Real, int N, int M>
class LinearProgram {
 public:
  explicit LinearProgram(int m) : m_(m) {}

  // The program: set all of these, then solve.
  Real columns[M][N] = {}, gain[N] = {}, target[N] = {};
  ClosingLimits<Real> limits[M] = {};
  Real least = -std::numeric_limits<Real>::infinity();  // no tensions have an S below

  static constexpr int kStepLimit = 50 + 10 * M;

  // From a direction that bounds S, or from nought where nothing is missing while all limits are shut. Returns
  // whether there are such tensions, for any S at all.
  bool solve(const Real* start) {
    begin(start);
    const Cut first = measure(direction_, along_);
    if (!(first.rate < 0 || first.excess > 0)) return true;
    for (steps_ = 1; steps_ <= kStepLimit; ++steps_) {
      Cut cut = measure(direction_, along_), none{0, 0};
      if (!descend(cut, none, 0)) return false;
      if (!turn()) return true;
      if (!search()) return false;
    }
    return false;
  }

  int steps() const { return steps_; }

  // The limits that all of the best tensions keep, and no others that satisfy A t + g S = f: a cable that the
  // direction pulls stays where it is pulled to.
  void face(int i, Real* lower, Real* upper) const {
    *lower = end(i, false).at(value_);
    *upper = end(i, true).at(value_);
    if (free_[i] || magnitude(along_[i]) <= kTie * length_[i]) return;
    (upper_[i] ? *lower : *upper) = upper_[i] ? *upper : *lower;
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr Real kMissing = 64 * kUlp;    // a wrench that may be missing, against all that there is
  static constexpr Real kDepends = 4096 * kUlp;  // a column less its part along others, against the column
  static constexpr Real kTie = 65536 * kUlp;       // a pull that may be nought, against the column
  static constexpr int kPatience = 2 * N;        // steps of length nought before Bland's rule
  static constexpr Real kInfinite = std::numeric_limits<Real>::infinity();

  // Where the limits of a cable are in their course, from S = infinity downwards.
  enum class Course { shut, moving, open };

  struct End {
    Real constant, rate;
    Real at(Real s) const { return rate == 0 ? constant : constant + rate * s; }
  };

  // For a direction d: d'(f - A t - g S) is excess - rate S, with all cables but the free ones at their ends.
  struct Cut {
    Real excess, rate;
  };

  void begin(const Real* start) {
    steps_ = stalled_ = count_ = 0;
    value_ = -kInfinite;
    size_ = 0;
    for (int k = 0; k < N; ++k) size_ += magnitude(target[k]);
    for (int i = 0; i < m_; ++i) {
      length_[i] = std::sqrt(dot(columns[i], columns[i]));
      const ClosingLimits<Real>& c = limits[i];
      course_[i] = c.shut > c.open ? Course::shut : Course::open;
      free_[i] = false;
      const Real lower = c.lower + c.rise * c.open, upper = c.upper - c.fall * c.open;
      size_ += length_[i] * larger(magnitude(lower), magnitude(upper));
      value_ = larger(value_, next_kink(i));
    }
    copy(start, direction_);
    normalise(direction_);
    for (int i = 0; i < m_; ++i) {
      along_[i] = dot(direction_, columns[i]);
      upper_[i] = along_[i] > 0;
    }
  }

  // The lower or upper end of cable i, as a function of S.
  End end(int i, bool upper) const {
    const ClosingLimits<Real>& c = limits[i];
    const Real constant = upper ? c.upper : c.lower, rate = upper ? -c.fall : c.rise;
    if (course_[i] == Course::moving) return {constant, rate};
    const Real s = course_[i] == Course::shut ? c.shut : c.open;
    return {rate == 0 ? constant : constant + rate * s, 0};
  }

  Real next_kink(int i) const {
    if (course_[i] == Course::shut) return limits[i].shut;
    return course_[i] == Course::moving ? limits[i].open : -kInfinite;
  }

  Cut measure(const Real* d, const Real* along) const {
    Cut cut{dot(d, target), dot(d, gain)};
    for (int i = 0; i < m_; ++i) {
      if (free_[i]) continue;
      const End e = end(i, upper_[i]);
      cut.excess -= along[i] * e.constant;
      cut.rate += along[i] * e.rate;
    }
    return cut;
  }

  // Lower S to what the direction y + theta d allows. Cables begin or end to move on the way, which changes both
  // cuts. Returns false where no S will do.
  bool descend(Cut& y, Cut& d, Real theta) {
    for (;;) {
      const Real excess = y.excess + theta * d.excess, rate = y.rate + theta * d.rate;
      Real kink = -kInfinite;
      for (int i = 0; i < m_; ++i) kink = larger(kink, next_kink(i));
      const Real allowed = rate < 0 ? excess / rate : -kInfinite;
      if (allowed < least || (allowed == -kInfinite && kink == -kInfinite)) return false;
      if (allowed >= kink) {
        value_ = allowed;
        return true;
      }
      for (int i = 0; i < m_; ++i) {
        if (course_[i] == Course::shut && limits[i].shut >= kink) course_[i] = Course::moving;
        if (course_[i] == Course::moving && limits[i].open >= kink) course_[i] = Course::open;
      }
      y = measure(direction_, along_);
      if (theta != 0) d = measure(turn_, turn_along_);
    }
  }

  // The direction in which to turn y. Returns false where the tensions are the best.
  bool turn() {
    Real missing[N], share[N];
    for (int k = 0; k < N; ++k) missing[k] = target[k] - gain[k] * value_;
    for (int i = 0; i < m_; ++i) {
      if (free_[i]) continue;
      const Real tension = end(i, upper_[i]).at(value_);
      for (int k = 0; k < N; ++k) missing[k] -= tension * columns[i][k];
    }
    for (int j = 0; j < count_; ++j) {
      share[j] = dot(basis_[j], missing);
      subtract(basis_[j], share[j], missing);
    }
    copy(missing, turn_);
    if (normalise(turn_) > kMissing * size_ && count_ + 1 < N) return true;
    const int worst = worst_free(share);
    if (worst < 0) return false;
    release(worst);
    return true;
  }

  // Which free cable breaks its limits by most, and which one that is (upper_); -1 if none does. share: the part of
  // the missing wrench along each column of the basis. Measured is the wrench that would be missing if it stayed
  // at its limit.
  int worst_free(const Real* share) {
    const bool bland = stalled_ > kPatience;
    Real tension[N], worst = kMissing * size_;
    int found = -1;
    for (int j = count_ - 1; j >= 0; --j) {
      tension[j] = share[j];
      for (int k = j + 1; k < count_; ++k) tension[j] -= triangle_[j][k] * tension[k];
      tension[j] /= triangle_[j][j];
    }
    for (int j = 0; j < count_; ++j) {
      const int i = order_[j];
      const Real below = end(i, false).at(value_) - tension[j], above = tension[j] - end(i, true).at(value_);
      const Real broken = larger(below, above);
      if (!(broken > 0)) continue;
      // The length of row j of the inverse triangle is 1 / distance of the column from the span of the others.
      Real row[N] = {}, square = 0;
      for (int k = j; k < count_; ++k) {
        Real sum = k == j ? Real(1) : Real(0);
        for (int p = j; p < k; ++p) sum -= row[p] * triangle_[p][k];
        row[k] = sum / triangle_[k][k];
        square += row[k] * row[k];
      }
      const Real wrench = broken / std::sqrt(square);
      if (!(wrench > kMissing * size_) || !(bland ? found < 0 || i < order_[found] : wrench > worst)) continue;
      worst = wrench;
      found = j;
      upper_[i] = above > below;
    }
    return found;
  }

  // Cable order_[j] is no longer free. Turn so that it is pulled to its end, and the others stay free.
  void release(int j) {
    const int leaving = order_[j];
    free_[leaving] = false;
    along_[leaving] = 0;
    const int last = count_;
    count_ = j;
    for (int k = j + 1; k < last; ++k) extend(order_[k]);
    copy(columns[leaving], turn_);
    clean(turn_);
    const Real length = normalise(turn_);
    if (!upper_[leaving] && length > 0) {
      for (int k = 0; k < N; ++k) turn_[k] = -turn_[k];
    }
  }

  // Turn y until its bound on S no longer falls. Returns false where no S will do.
  bool search() {
    const bool bland = stalled_ > kPatience;
    for (int i = 0; i < m_; ++i) {
      turn_along_[i] = free_[i] ? Real(0) : dot(turn_, columns[i]);
      if (magnitude(turn_along_[i]) <= kDepends * length_[i]) turn_along_[i] = 0;
    }
    Cut cut = measure(direction_, along_), change = measure(turn_, turn_along_);
    for (;;) {
      int next = -1;
      Real theta = kInfinite;
      for (int i = 0; i < m_; ++i) {
        const Real pace = upper_[i] ? -turn_along_[i] : turn_along_[i];
        if (free_[i] || !(pace > 0)) continue;
        const Real distance = upper_[i] ? along_[i] : -along_[i];
        const Real at = distance > 0 ? distance / pace : Real(0);
        if (at < theta) {
          theta = at;
          next = i;
        }
      }
      if (next < 0) {
        // The bound falls all the way: the turn itself is the better direction.
        stalled_ = 0;
        copy(turn_, direction_);
        settle();
        return true;
      }
      if (!descend(cut, change, theta)) return false;
      if (!bland) {
        upper_[next] = !upper_[next];
        cut = measure(direction_, along_);
        change = measure(turn_, turn_along_);
      }
      if (bland || change.excess - change.rate * value_ <= kMissing * size_) {
        stalled_ = theta > 0 ? 0 : stalled_ + 1;
        free_[next] = true;
        extend(next);
        for (int k = 0; k < N; ++k) direction_[k] += theta * turn_[k];
        settle();
        return true;
      }
    }
  }

  // Make the direction normal to all free cables, of unit length.
  void settle() {
    clean(direction_);
    normalise(direction_);
    for (int i = 0; i < m_; ++i) along_[i] = free_[i] ? Real(0) : dot(direction_, columns[i]);
  }

  // One more column for the basis of the free cables.
  void extend(int i) {
    Real* column = basis_[count_];
    copy(columns[i], column);
    for (int j = 0; j < count_; ++j) triangle_[j][count_] = 0;
    for (int pass = 0; pass < 2; ++pass) {
      for (int j = 0; j < count_; ++j) {
        const Real part = dot(basis_[j], column);
        triangle_[j][count_] += part;
        subtract(basis_[j], part, column);
      }
    }
    triangle_[count_][count_] = normalise(column);
    order_[count_++] = i;
  }

  // Take out of x its part in the span of the free cables; twice is enough.
  void clean(Real* x) const {
    for (int pass = 0; pass < 2; ++pass) {
      for (int j = 0; j < count_; ++j) subtract(basis_[j], dot(basis_[j], x), x);
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
  Real value_ = 0, size_ = 0;  // the bound on S; what errors are measured against
  Real direction_[N] = {}, turn_[N] = {};
  Real along_[M] = {}, turn_along_[M] = {}, length_[M] = {};  // y'A_i, turn'A_i, |A_i|
  bool upper_[M] = {}, free_[M] = {};                         // at the upper end, or at neither
  Course course_[M] = {};
  int count_ = 0, order_[N] = {};                // the free cables, in the order of the basis
  Real basis_[N][N] = {}, triangle_[N][N] = {};  // A_free = basis * triangle; a row of basis_ is a column
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
