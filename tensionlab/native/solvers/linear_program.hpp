// The tension programs as linear programs whose limits close in.
//
//   least cost     minimise c't                                 [W; c'] t + (0, 1) S = (w, 0),  a <= t <= b
//   minimax        minimise max t, which is -S                  W t = w,  a <= t <= min(b, -S)
//   optimally safe maximise S, a + S <= t <= b - alpha S        W t = w
//
// In the last two a cable whose limits are equal does not count, neither as the largest tension nor as the least
// margin.
#pragma once

#include <cmath>
#include <limits>

#include "solvers/simplex_basis.hpp"
#include "tensionlab/simd/batch.hpp"

namespace tensionlab {

enum class Program { least_cost, minimax, safe };

inline namespace TENSIONLAB_BUILD {

// A linear program over tensions whose limits close in, solved exactly.
//
//   maximise S   subject to   A t + g S = f,   l_i(S) <= t_i <= u_i(S)
//
// The limits of each cable approach each other as S grows (solvers/simplex_basis.hpp). Written as an ordinary
// linear program it would have a row for every limit that moves; here it has those of A.
//
// Method: dual simplex for bounded variables. Any direction y bounds S from above, because y'(f - g S) is at most
// the largest y'A t, with every cable held at the limit to which y pulls it. Where that bound is attained only the
// free cables, those with y'A_i = 0, are undetermined. If they render the missing wrench inside their limits, the
// bound is the answer. Otherwise y turns: towards what no free cable can render, or so as to hold the free cable
// that breaks its limits most. The bound falls along the turn. At breakpoints other cables change limits, until
// the one that would stop the fall becomes free (the long-step rule: one step passes many bases). All limits are
// finite, so that no first phase is needed; dependent rows and columns need no special case. After some steps of
// length zero Bland's rule takes over, which cannot cycle.
//
// Sources: Lemke (1954), "The dual method of solving the linear programming problem"; Maros (2003), "A generalized
// dual phase-2 simplex algorithm", for the long step; Bland (1977), "New finite pivoting rules for the simplex
// method". No heap, no exceptions.

template <class Real, int N, int M>
class LinearProgram {
 public:
  explicit LinearProgram(int m) : m_(m) {}

  // The program: set all of these and cables.limits, then solve. No tensions have an S below least; an S above
  // most is as good as most.
  Real rows[N][M] = {}, gain[N] = {}, target[N] = {};  // A, g, f
  HeldCables<Real, M> cables;
  Real least = std::numeric_limits<Real>::lowest(), most = std::numeric_limits<Real>::max();

  // start: a direction that bounds S, such as the error while all limits are closed; zero if there is none.
  // Returns whether there are tensions for any S, or false after kStepLimit steps, far beyond any known problem.
  bool solve(const Real* start) {
    begin(start);
    for (steps_ = 1; steps_ <= kStepLimit; ++steps_) {
      Cut cut = measure(direction_, along_), still{0, 0};
      if (steps_ == 1 && !(cut.rate < 0 || cut.excess > 0)) return true;
      if (!descend(cut, still, 0)) return false;
      if (!turn(cut.rate)) return true;
      if (!search()) return false;
    }
    return false;
  }

  int steps() const { return steps_; }
  const Real* direction() const { return direction_; }

  // Finds limits that the best tensions keep, and no others with A t + g S = f.
  void face(Real* lower, Real* upper) const {
    const Real best = smaller(value_, most);
    int ties = 0;
    for (int i = 0; i < m_; ++i) {
      lower[i] = cables.limits[i].least(best);
      upper[i] = cables.limits[i].most(best);
      ties += along_[i] == 0 && lower[i] < upper[i] ? 1 : 0;
    }
    if (best < value_) return;
    for (int i = 0; i < m_; ++i) {
      // A cable that y pulls stays where it is held.
      if (along_[i] != 0) (cables.at_upper[i] ? lower[i] : upper[i]) = cables.at_upper[i] ? upper[i] : lower[i];
    }
    if (ties > columns_.count() || forgiven_ > 0) return;
    for (int j = 0; j < columns_.count(); ++j) {
      // Independent free columns without others are determined, too.
      const int i = columns_.cable(j);
      lower[i] = upper[i] = smaller(larger(tension_[j], lower[i]), upper[i]);
    }
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr Real kInfinite = std::numeric_limits<Real>::infinity();
  static constexpr Real kMissing = 64 * kUlp;   // negligible error of the wrench, as a share of all terms
  static constexpr Real kNoPull = 4096 * kUlp;  // negligible pull on a cable, as a share of its column
  static constexpr int kPatience = 2 * N;       // steps of length zero before Bland's rule
  static constexpr int kStepLimit = 50 + 10 * M;

  // d'(f - A t - g S) = excess - rate S for a direction d, with all cables but the free ones held at their ends.
  struct Cut {
    Real excess, rate;
  };

  void begin(const Real* start) {
    stalled_ = 0;
    value_ = kInfinite;
    size_ = forgiven_ = 0;
    columns_.clear();
    for (int k = 0; k < N; ++k) size_ += magnitude(target[k]);
    for (int i = 0; i < m_; ++i) {
      cables.free[i] = false;
      length_[i] = 0;
      for (int k = 0; k < N; ++k) length_[i] = larger(length_[i], magnitude(rows[k][i]));
    }
    copy<N>(start, direction_);
    settle();
    cables.begin(m_, along_);
  }

  Cut measure(const Real* d, const Real* along) const {
    Cut cut{dot<N>(d, target), dot<N>(d, gain)};
    for (int i = 0; i < m_; ++i) {
      cut.excess -= along[i] * cables.held[i];
      cut.rate += along[i] * cables.held_rate[i];
    }
    return cut;
  }

  // Lowers S to what the direction y + theta turn allows. Limits begin or cease to move on the way, which changes
  // both cuts. Returns false if no S is feasible.
  bool descend(Cut& y, Cut& change, Real theta) {
    const Real rounding = kMissing * size_ * (1 + theta);
    for (Real passed = kInfinite;;) {
      const Real excess = y.excess + theta * change.excess, rate = y.rate + theta * change.rate;
      const Real kink = cables.kink();
      value_ = smaller(rate < 0 ? excess / rate : -kInfinite, passed);
      // A kink is passed only where that changes something: beyond it the bound may have no slope.
      if (excess - rate * kink <= rounding) value_ = larger(value_, kink);
      if (value_ >= kink) return value_ >= least;
      passed = kink;
      cables.pass_kink();
      y = measure(direction_, along_);
      change = measure(turn_, turn_along_);
    }
  }

  // Whether a wrench is missing along the turn. S is known from y's cut alone, and poorly where its rate is small:
  // what a slightly different S would render is not missing. rate: that of y as far as it is turned.
  bool missing(Real wrench, Real rate, Real y_rate, Real turn_rate) {
    const Real square = y_rate * y_rate + turn_rate * turn_rate, least_wrench = kMissing * size_;
    if (!(wrench > least_wrench)) return false;
    if (rate == 0 || wrench * magnitude(rate) > least_wrench * std::sqrt(square)) return true;
    if (wrench > forgiven_) {
      forgiven_ = wrench;
      shift_ = wrench * turn_rate / square;
    }
    return false;
  }

  // Finds the tensions of the free cables where the bound is attained. What they cannot render becomes the turn,
  // of unit length; returns its length before. closing: the change with S of what they must render.
  Real attain(Real* closing, Real* closing_part) {
    size_ = 0;
    for (int i = 0; i < m_; ++i) size_ += length_[i] * magnitude(cables.held[i] + cables.held_rate[i] * value_);
    for (int k = 0; k < N; ++k) {
      size_ += magnitude(target[k]);
      turn_[k] = target[k];
      closing[k] = gain[k];
      for (int i = 0; i < m_; ++i) {
        turn_[k] -= rows[k][i] * cables.held[i];
        closing[k] += rows[k][i] * cables.held_rate[i];
      }
      turn_[k] -= closing[k] * value_;
      tension_[k] = closing_part[k] = 0;
    }
    columns_.take_out(turn_, tension_);
    columns_.take_out(closing, closing_part);
    for (int j = 0; j < columns_.count(); ++j) size_ += magnitude(tension_[j]);
    columns_.solve(tension_);
    return normalise<N>(turn_);
  }

  // Chooses how to turn y. Returns false where the bound is attained.
  bool turn(Real rate) {
    Real closing[N], part[N];
    forgiven_ = 0;
    const Real length = attain(closing, part);
    if (!(columns_.count() + 1 < N && missing(length, rate, rate, dot<N>(turn_, closing)))) {
      const int place = worst_free(part, rate);
      if (place < 0) {
        if (forgiven_ > 0) {
          value_ += shift_;
          forgiven_ = 0;
          attain(closing, part);
          worst_free(part, rate);
        }
        return false;
      }
      hold(place);
    }
    for (int pass = 0; pass < 2; ++pass) {
      columns_.take_out(turn_, part);
      normalise<N>(turn_);
    }
    return true;
  }

  // The place of the free cable that breaks its limits most, by the wrench that would be missing if it stayed at
  // its limit; -1 if none does.
  int worst_free(const Real* closing_part, Real rate) {
    Real worst = 0;
    int found = -1;
    for (int j = 0; j < columns_.count(); ++j) {
      const int i = columns_.cable(j);
      const auto &lower = cables.end(i, false), &upper = cables.end(i, true);
      const Real below = lower.at(value_) - tension_[j], above = tension_[j] - upper.at(value_);
      if (!(below > 0 || above > 0)) continue;
      Real closing;
      const Real length = columns_.own(j, closing_part, &closing);
      const Real wrench = length * larger(below, above);
      const Real turn_rate = above > 0 ? closing + length * upper.rate : -closing - length * lower.rate;
      if (!missing(wrench, rate, rate, turn_rate)) continue;
      if (found >= 0 && (bland() ? i > columns_.cable(found) : wrench <= worst)) continue;
      worst = wrench;
      found = j;
    }
    return found;
  }

  // Holds the free cable in this place at the limit that it breaks, and turns to where that pulls.
  void hold(int place) {
    const int i = columns_.cable(place);
    const bool upper = tension_[place] > cables.end(i, true).at(value_);
    for (int k = 0; k < N; ++k) turn_[k] = upper ? rows[k][i] : -rows[k][i];
    columns_.drop(place);
    cables.hold(i, upper);
  }

  // Turns y until the bound falls no further. Returns false if no S is feasible.
  bool search() {
    Real breakpoint[M];
    pull(turn_, turn_along_);
    for (int i = 0; i < m_; ++i) {
      const Real pace = cables.at_upper[i] ? -turn_along_[i] : turn_along_[i];
      const Real distance = cables.at_upper[i] ? along_[i] : -along_[i];
      breakpoint[i] = pace > 0 ? (distance > 0 ? distance / pace : Real(0)) : kInfinite;
    }
    Cut cut = measure(direction_, along_), change = measure(turn_, turn_along_);
    for (;;) {
      int next = 0;
      for (int i = 1; i < m_; ++i) next = breakpoint[i] < breakpoint[next] ? i : next;
      const Real theta = breakpoint[next];
      if (theta == kInfinite) {
        // The bound falls without end, so that the turn itself is the better direction.
        copy<N>(turn_, direction_);
        stalled_ = 0;
        settle();
        return true;
      }
      if (!descend(cut, change, theta)) return false;
      if (!bland()) {
        breakpoint[next] = kInfinite;
        cables.hold(next, !cables.at_upper[next]);
        cut = measure(direction_, along_);
        change = measure(turn_, turn_along_);
      }
      const Real rate = cut.rate + theta * change.rate, wrench = change.excess - change.rate * value_;
      if (bland() || !missing(wrench, rate, cut.rate, change.rate)) {
        release(next, theta);
        return true;
      }
    }
  }

  // Ends the turn at theta, where cable i becomes free.
  void release(int i, Real theta) {
    Real column[N];
    for (int k = 0; k < N; ++k) {
      column[k] = rows[k][i];
      direction_[k] += theta * turn_[k];
    }
    columns_.add(i, column);
    cables.release(i);
    stalled_ = theta > 0 ? 0 : stalled_ + 1;
    settle();
  }

  // Makes y normal to the free columns and of unit length.
  void settle() {
    Real part[N] = {};
    columns_.take_out(direction_, part);
    columns_.take_out(direction_, part);
    normalise<N>(direction_);
    pull(direction_, along_);
  }

  // d'A, with zeros for free cables, and for those that depend on them up to rounding.
  void pull(const Real* d, Real* along) const {
    for (int i = 0; i < m_; ++i) along[i] = d[0] * rows[0][i];
    for (int k = 1; k < N; ++k) {
      for (int i = 0; i < m_; ++i) along[i] += d[k] * rows[k][i];
    }
    for (int i = 0; i < m_; ++i) {
      along[i] = cables.free[i] || magnitude(along[i]) <= kNoPull * length_[i] ? Real(0) : along[i];
    }
  }

  bool bland() const { return stalled_ > kPatience; }

  int m_, steps_ = 0, stalled_ = 0;
  Real value_ = 0, size_ = 0;              // the bound on S; the sum of all terms of the wrench
  Real forgiven_ = 0, shift_ = 0;          // the largest error accepted, and the change of S that would remove it
  Real direction_[N] = {}, turn_[N] = {};  // y and where it turns
  Real along_[M] = {}, turn_along_[M] = {}, length_[M] = {};  // y'A, turn'A, sizes of the columns
  FreeColumns<Real, N> columns_;
  Real tension_[N] = {};  // of the free cables
};

template <class Real, int N, int M>
class TensionProgram {
 public:
  // N: wrench components, and one more for the least cost. alpha: of the optimally safe tensions only.
  TensionProgram(int m, Program program, Real alpha) : m_(m), program_(program), alpha_(alpha), linear_(m) {}

  // Finds limits that the best tensions keep, and no others that render the wrench; those of the problem if it is
  // infeasible. costs: c, and multipliers: y with c't >= y'w + min (c - W'y)'t for all t, where the least is
  // equal; zeros if there is none. Both of the least cost only. Returns the steps.
  int tighten(const Problem<Real>& problem, const Real* costs, Real* lower, Real* upper, Real* multipliers) {
    const bool found = load(problem, costs);
    if (program_ == Program::least_cost) {
      const Real* y = linear_.direction();
      for (int k = 0; k < N - 1; ++k) multipliers[k] = found && y[N - 1] < 0 ? -y[k] / y[N - 1] : Real(0);
    }
    if (found) linear_.face(lower, upper);
    for (int i = 0; i < m_; ++i) {
      const Real a = problem.lower[i], b = problem.upper[i];
      if (!found) {
        lower[i] = a;
        upper[i] = b;
      }
      lower[i] = smaller(larger(lower[i], a), b);
      upper[i] = smaller(larger(upper[i], lower[i]), b);  // rounding may have crossed them
    }
    return linear_.steps();
  }

 private:
  // Solves the program; returns whether the wrench is feasible.
  bool load(const Problem<Real>& problem, const Real* costs) {
    const bool sum = program_ == Program::least_cost;
    const int n = sum ? N - 1 : N;
    Real start[N] = {};
    for (int k = 0; k < n; ++k) {
      const Real* row = problem.structure + k * m_;
      linear_.target[k] = start[k] = problem.wrench[k];
      for (int i = 0; i < m_; ++i) linear_.rows[k][i] = row[i];
    }
    linear_.most = std::numeric_limits<Real>::max();
    for (int i = 0; i < m_; ++i) {
      const Real a = problem.lower[i], b = problem.upper[i];
      ClosingLimits<Real>& limits = linear_.cables.limits[i];
      if (sum) limits = {a, b, 0, 0, 0, 0};
      if (program_ == Program::minimax) limits = {a, 0, 0, 1, -b, -a};
      if (program_ == Program::safe) limits = {a, b, 1, alpha_, 0, (b - a) / (1 + alpha_)};
      if (sum) linear_.rows[n][i] = costs[i];
      // S has its best value where the first cable has no more room, though the others have.
      if (!sum && a < b) linear_.most = smaller(linear_.most, limits.shut);
      const Real closed = limits.lower + limits.rise * limits.shut;
      for (int k = 0; k < n; ++k) start[k] -= closed * linear_.rows[k][i];
    }
    if (sum) {
      // The start is the cost alone. Otherwise it is the error of the tensions when all limits are closed.
      for (int k = 0; k < n; ++k) start[k] = 0;
      start[n] = -1;
      linear_.gain[n] = 1;
      linear_.least = 0;
      for (int i = 0; i < m_; ++i)
        linear_.least -= larger(costs[i] * problem.lower[i], costs[i] * problem.upper[i]);
    }
    return linear_.solve(start);
  }

  int m_;
  Program program_;
  Real alpha_;
  LinearProgram<Real, N, M> linear_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
