// How much of a wrench can be rendered in its own direction: the largest s in [0, 1] for which tensions inside the
// limits render s w, narrowed down from both sides.
//
// Any d shows that s d'w <= h(d) = sum_i max(d'W_i a_i, d'W_i b_i). The nearest wrench to s w gives the next d; s
// falls to the answer from above (Newton's method on the convex distance from s w to the available wrench set).
#pragma once

#include <cmath>
#include <limits>

#include "lanes.hpp"
#include "short_vectors.hpp"
#include "side_by_side.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int N>
class ScaleSearch {
 public:
  // best: s can fall no further. hopeless: no s from 0 to 1 can be rendered.
  enum class Outcome { less, best, hopeless };

  Real scale;     // s
  Real proof[N];  // shows that s can be no larger, or that it is hopeless; of unit length, or nought

  void begin() {
    scale = above_ = 1;
    below_ = -1;
    for (int k = 0; k < N; ++k) proof[k] = from_below_[k] = 0;
  }

  // d separates s w: take the next s. d is made a unit vector.
  Outcome cut(const Source<Real>& problem, int m, Real* d) {
    normalise<N>(d);
    Real rounding;
    const Real dw = dot<N>(d, problem.wrench), reach = support(problem, m, d, &rounding);
    if (reach + rounding < (dw < 0 ? dw : Real(0))) return give_up(d);  // true of all s from 0 to 1
    const Real bound = reach / dw > 0 ? reach / dw : Real(0);
    if (dw > 0) {
      // No scale above the bound will do.
      if (!(bound < scale)) return Outcome::best;
      above_ = bound;
      copy<N>(d, proof);
    } else {
      // No scale below the bound will do: s w is too short already.
      below_ = bound;
      copy<N>(d, from_below_);
    }
    if (below_ > above_) {
      // Nothing is left in between. The mean of both directions that is normal to w proves it for all s.
      const Real* other = dw > 0 ? from_below_ : proof;
      const Real other_dw = dot<N>(other, problem.wrench);
      for (int k = 0; k < N; ++k) d[k] = std::abs(other_dw) * d[k] + std::abs(dw) * other[k];
      normalise<N>(d);
      return give_up(d);
    }
    scale = below_ < 0 ? above_ : (below_ + above_) / 2;
    return Outcome::less;
  }

 private:
  Outcome give_up(const Real* d) {
    copy<N>(d, proof);
    scale = 1;
    return Outcome::hopeless;
  }

  // h(d) of a unit vector d, and the error that rounding, also of d itself, may leave in it.
  static Real support(const Source<Real>& problem, int m, const Real* d, Real* rounding) {
    Real sum = 0, size = 0;
    for (int i = 0; i < m; ++i) {
      const Real lower = problem.lower[i], upper = problem.upper[i];
      const Real most = larger(std::abs(lower), std::abs(upper));
      Real along = 0;
      for (int k = 0; k < N; ++k) {
        along += d[k] * problem.structure[k * m + i];
        size += std::abs(problem.structure[k * m + i]) * most;
      }
      sum += along * (along > 0 ? upper : lower);
    }
    *rounding = 64 * std::numeric_limits<Real>::epsilon() * size;
    return sum;
  }

  Real below_, above_;  // s w is too short, if ever; s w is too long
  Real from_below_[N];  // excludes all s < below_
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
