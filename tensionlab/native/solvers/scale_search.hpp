// How much of a wrench can be rendered in its own direction: the largest s in [0, 1] for which tensions inside the
// limits render s w.
//
// Any unit vector d shows that s d'w <= h(d) = sum_i max(d'W_i a_i, d'W_i b_i): the line of d. The nearest wrench
// to s w gives the next d; s falls to the answer from above (Newton's method on the convex distance from s w to
// the available wrench set).
//
// Where w grazes a face of that set, or leaves a set that is flat, a hair off w would take s from 1 to 0. There s
// w counts as rendered where tensions come within a tolerance of it, that of EXACT where s is 1: s then falls with
// the distance. How much of the tolerance a line allows depends on its angle to w, so that s stays exact at a face
// which w meets head on.
#pragma once

#include <cmath>
#include <limits>

#include "simd/lane_problem.hpp"
#include "simd/lanes.hpp"
#include "simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// A line whose normal has a cosine with w below this is grazed.
constexpr double kGrazing = 1e-5;

// s along <= reach, with d of unit length.
template <class Real>
struct ScaleLine {
  Real along, reach;  // d'w and h(d)

  // Moved outwards by a share of the tolerance at s = 1, and a little less of it below: that is for rounding.
  ScaleLine moved(Real tolerance) const {
    constexpr Real kRamp = Real(0.1);
    return {along - kRamp * tolerance, reach + (1 - kRamp) * tolerance};
  }

  // The same by what its angle to w allows: all of the tolerance below half of kGrazing, none above it.
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
  // less: seek s w. best: s can fall no further. hopeless: no s from 0 to 1 can be rendered.
  enum class Outcome { less, best, hopeless };

  Real scale;     // s
  Real proof[N];  // shows that s can be no larger, or that it is hopeless; of unit length, or nought

  // Whether no cut has been tried; whether s w is sought within tolerance.
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

  // d separates s w: take the next s, which is less by at least one number, or none. d is made a unit vector.
  Outcome cut(const Problem<Real>& problem, int m, Real* d) {
    normalise<N>(d);
    const Line line = line_of(problem, m, d);
    if (excluded(line)) return give_up(d);
    if (phase_ == Phase::exact) return cut_exactly(problem, m, d, line);
    if (phase_ == Phase::last) return Outcome::best;
    const Line most = line.moved(tolerance_);
    // What is beyond by rounding alone leaves no scale below.
    const bool beyond = most.excludes(scale) && !(most.along > 0 && most.largest() >= scale);
    if (beyond && !(most.along > 0) && scale < 1) {
      // Too short already, and all that is longer has been excluded.
      mix(problem, d, line.along);
      return give_up(d);
    }
    copy<N>(d, proof);
    // Whether w itself is near enough is for verification to say.
    if (scale == 1 && line.along - line.reach <= kHair * tolerance_) return Outcome::best;
    if (!beyond) phase_ = Phase::last;
    return lower(beyond ? most : line.moved_as_allowed(tolerance_, length_));
  }

  // Nothing above s can be rendered exactly. Might more be within tolerance? Then s is where to look from.
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
  // exact: what can be rendered. near: what can be within tolerance. last: s is known.
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
    // No s at all, as it seems. Is it true beyond the tolerance?
    if (scale < 1) {
      mix(problem, d, line.along);
      if (excluded(line_of(problem, m, d))) return give_up(d);
    }
    phase_ = Phase::near;
    scale = 1;
    return Outcome::less;
  }

  // d shows that s w is too short, the proof that it is too long. Their mean that is normal to w shows it for all
  // s.
  void mix(const Problem<Real>& problem, Real* d, Real along) const {
    const Real other = dot<N>(proof, problem.wrench);
    for (int k = 0; k < N; ++k) d[k] = std::abs(other) * d[k] + std::abs(along) * proof[k];
    normalise<N>(d);
  }

  Outcome give_up(const Real* d) {
    copy<N>(d, proof);
    scale = 1;
    return Outcome::hopeless;
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

  // What it may leave in h(d) of a unit vector d, which is rounded itself.
  Real rounding() const { return 64 * std::numeric_limits<Real>::epsilon() * size_; }

  Real length_, size_, tolerance_;
  Phase phase_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
