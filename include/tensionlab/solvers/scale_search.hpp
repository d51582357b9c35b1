// The largest s in [0, 1] for which s w is feasible.
//
// Any unit vector d shows that s d'w <= h(d) = sum_i max(d'W_i a_i, d'W_i b_i): the line of d. The wrench nearest
// to s w gives the next d; s falls to the answer from above (Newton's method on the convex distance from s w to
// the available wrench set).
//
// Where w grazes a face of that set, or leaves a flat set, a tiny change of w would take s from 1 to 0. There s w
// counts as rendered where tensions come within a tolerance of it, that of EXACT where s is 1: s then falls with
// the distance. The tolerance that a line allows depends on its angle to w, so that s stays exact at a face that w
// meets at a right angle.
#pragma once

#include <cmath>
#include <limits>

#include "tensionlab/simd/lane_problem.hpp"
#include "tensionlab/simd/lanes.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// w grazes a line whose normal has a cosine with w below this.
constexpr double kGrazing = 1e-5;

// s along <= reach, with d of unit length.
template <class Real>
struct ScaleLine {
  Real along, reach;  // d'w and h(d)

  // Moved outwards by the tolerance at s = 1, and a little less below, to allow for rounding.
  ScaleLine moved(Real tolerance) const {
    constexpr Real kRamp = Real(0.1);
    return {along - kRamp * tolerance, reach + (1 - kRamp) * tolerance};
  }

  // The same by the share that its angle to w allows: all below half of kGrazing, none above kGrazing.
  ScaleLine moved_as_allowed(Real tolerance, Real length) const {
    const Real share = 2 - 2 * along / (Real(kGrazing) * length);
    return share <= 0 ? *this : moved(share < 1 ? share * tolerance : tolerance);
  }

  bool excludes(Real s) const { return s * along > reach; }
  bool excludes_all() const { return reach < 0 && reach < along; }
  Real largest() const { return reach > 0 ? reach / along : Real(0); }  // where along is positive
};

// An upper bound of the length of every feasible wrench.
template <int N, class Real>
Real wrench_bound(const Problem<Real>& problem, int m) {
  Real size = 0;
  for (int i = 0; i < m; ++i) {
    const Real most = larger(std::abs(problem.lower[i]), std::abs(problem.upper[i]));
    for (int k = 0; k < N; ++k) size += std::abs(problem.structure[k * m + i]) * most;
  }
  return size;
}

// size: the bound above.
template <class Real>
Real direction_tolerance(Real tolerance, Real length, Real size) {
  return tolerance * larger(Real(1), smaller(length, size));
}

template <class Real, int N>
class ScaleSearch {
 public:
  // less: try the new s w. best: s cannot fall further. no_scale: no s w with s from 0 to 1 is feasible.
  enum class Outcome { less, best, no_scale };

  Real scale;     // s
  Real proof[N];  // unit vector that shows that s cannot be larger, or that there is none; or zero

  // Whether no cut has been tried; whether s w is tried within tolerance.
  bool fresh() const { return phase_ == Phase::exact && scale == 1; }
  bool near() const { return phase_ != Phase::exact; }

  void begin(const Problem<Real>& problem, int m, Real tolerance) {
    scale = 1;
    phase_ = Phase::exact;
    size_ = wrench_bound<N>(problem, m);
    length_ = std::sqrt(dot<N>(problem.wrench, problem.wrench));
    tolerance_ = direction_tolerance(tolerance, length_, size_);
    for (int k = 0; k < N; ++k) proof[k] = 0;
  }

  // Takes the next, smaller s, as d separates s w. Makes d a unit vector.
  Outcome cut(const Problem<Real>& problem, int m, Real* d) {
    normalise<N>(d);
    const Line line = line_of(problem, m, d);
    if (excluded(line)) return give_up(d);
    if (phase_ == Phase::exact) return cut_exactly(problem, m, d, line);
    if (phase_ == Phase::last) return Outcome::best;
    const Line most = line.moved(tolerance_);
    // A line that is exceeded by rounding alone does not lower s.
    const bool beyond = most.excludes(scale) && !(most.along > 0 && most.largest() >= scale);
    if (beyond && !(most.along > 0) && scale < 1) {
      // s w is too short, and all larger s have been excluded.
      mix(problem, d, line.along);
      return give_up(d);
    }
    copy<N>(d, proof);
    // Verification decides whether w itself is near enough.
    if (scale == 1 && line.along - line.reach <= kHair * tolerance_) return Outcome::best;
    if (!beyond) phase_ = Phase::last;
    return lower(beyond ? most : line.moved_as_allowed(tolerance_, length_));
  }

  // No s above this one is feasible exactly. Returns whether a larger one may be within tolerance, and tries it.
  bool reopen(const Problem<Real>& problem, int m) {
    if (phase_ != Phase::exact) return false;
    const Line line = line_of(problem, m, proof);
    const bool clear = line.along - line.reach > kHair * tolerance_;
    if (clear && line.along >= Real(kGrazing) * length_) return false;
    phase_ = Phase::near;
    scale = 1;
    if (clear) lower(line.moved(tolerance_));
    return true;
  }

 private:
  using Line = ScaleLine<Real>;
  // exact: s w is to be rendered. near: within tolerance. last: s is known.
  enum class Phase { exact, near, last };
  static constexpr Real kHair = Real(1 + 1e-5);

  Outcome lower(const Line& line) {
    if (!(line.along > 0)) return Outcome::best;
    const Real next = line.largest();
    if (!(next < scale)) return Outcome::best;
    scale = next;
    return Outcome::less;
  }

  Outcome cut_exactly(const Problem<Real>& problem, int m, Real* d, const Line& line) {
    if (line.along > rounding() && line.reach >= -rounding()) {
      const Outcome outcome = lower(line);
      if (outcome == Outcome::less) copy<N>(d, proof);
      return outcome;
    }
    // There seems to be no s. Check that this holds beyond the tolerance.
    if (scale < 1) {
      mix(problem, d, line.along);
      if (excluded(line_of(problem, m, d))) return give_up(d);
    }
    phase_ = Phase::near;
    scale = 1;
    return Outcome::less;
  }

  // Mixes d, which shows that s w is too short, with the proof that it is too long: the mean that is normal to w
  // excludes all s.
  void mix(const Problem<Real>& problem, Real* d, Real along) const {
    const Real other = dot<N>(proof, problem.wrench);
    for (int k = 0; k < N; ++k) d[k] = std::abs(other) * d[k] + std::abs(along) * proof[k];
    normalise<N>(d);
  }

  Outcome give_up(const Real* d) {
    copy<N>(d, proof);
    scale = 1;
    return Outcome::no_scale;
  }

  bool excluded(const Line& line) const {
    return Line{line.along, line.reach + rounding()}.moved(tolerance_).excludes_all();
  }

  static Line line_of(const Problem<Real>& problem, int m, const Real* d) {
    Real reach = 0;
    for (int i = 0; i < m; ++i) {
      Real along = 0;
      for (int k = 0; k < N; ++k) along += d[k] * problem.structure[k * m + i];
      reach += along * (along > 0 ? problem.upper[i] : problem.lower[i]);
    }
    return {dot<N>(d, problem.wrench), reach};
  }

  // Rounding error of h(d) for a unit vector d.
  Real rounding() const { return 64 * std::numeric_limits<Real>::epsilon() * size_; }

  Real length_, size_, tolerance_;
  Phase phase_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
