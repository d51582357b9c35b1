// The closed forms and the puncture method, for one problem. A closed form takes the smallest change of a starting
// point, the problem's reference, that renders the wrench.
//
// Sources: Pott, Bruckmann & Mikelsons (2009); Pott (2014) for the improved closed form; Mueller, Reichert &
// Bruckmann (2015) for the puncture method.
#pragma once

#include <algorithm>
#include <cmath>

#include "solvers/pseudoinverse.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// Clips tensions into the limits. Returns the cable that missed them by most, and in `violation` by how much.
template <class Real>
int clip(const Problem<Real>& problem, int m, Real* tensions, Real* violation) {
  int worst = 0;
  *violation = 0;
  for (int i = 0; i < m; ++i) {
    const Real inside = std::min(std::max(tensions[i], problem.lower[i]), problem.upper[i]);
    const Real missed = std::abs(tensions[i] - inside);
    if (missed > *violation) {
      *violation = missed;
      worst = i;
    }
    tensions[i] = inside;
  }
  return worst;
}

// The change that ignores the limits, then clipped.
template <class Real, int N, int M>
void closed_form(const Problem<Real>& problem, int m, Real rank_tolerance, Real* tensions) {
  const Pseudoinverse<Real, N, M> inverse(problem.structure, m, rank_tolerance);
  std::copy_n(problem.reference, m, tensions);
  inverse.project(problem.structure, problem.wrench, tensions);
  Real violation;
  clip(problem, m, tensions, &violation);
}

// While limits are missed, fixes the cable that misses its limit most there, and solves again for the others.
// Returns the number of cables that it fixed.
template <class Real, int N, int M>
int improved_closed_form(const Problem<Real>& problem, int m, Real rank_tolerance, Real* tensions) {
  // A limit counts as kept if it is missed by less than this share of the largest one; clipping hides it.
  constexpr Real kRounding = Real(1e-12);
  Real loose[N * M], strongest = 0;
  bool free[M];
  int budget = 0;
  for (int i = 0; i < m; ++i) {
    // A cable whose limits are equal is fixed from the start, and costs no reduction. A fixed cable has a zero
    // column, so that the pseudo-inverse gives it no part of the missing wrench.
    free[i] = problem.lower[i] < problem.upper[i];
    budget += free[i];
    for (int k = 0; k < N; ++k) loose[k * m + i] = free[i] ? problem.structure[k * m + i] : Real(0);
    strongest = std::max({strongest, std::abs(problem.lower[i]), std::abs(problem.upper[i])});
    tensions[i] = free[i] ? problem.reference[i] : problem.lower[i];
  }
  for (int fixed = 0;; ++fixed) {
    const Pseudoinverse<Real, N, M> inverse(loose, m, rank_tolerance);
    if (fixed == 0) budget -= inverse.rank;
    inverse.project(problem.structure, problem.wrench, tensions);
    Real violation;
    const int worst = clip(problem, m, tensions, &violation);
    if (violation <= kRounding * strongest || fixed >= budget) return fixed;
    free[worst] = false;
    for (int k = 0; k < N; ++k) loose[k * m + worst] = 0;
    for (int i = 0; i < m; ++i) {
      if (free[i]) tensions[i] = problem.reference[i];
    }
  }
}

// Puncture: t = t_p + s (t_cf - t_p) with the least s in [0, 1] that keeps the limits, or s = 1 if none does. t_p
// is the solution of least norm, t_cf the one closest to the middle of the limits.
template <class Real, int N, int M>
void puncture_tensions(const LooseCables<Real, N, M>& loose, Real rank_tolerance, Real* tensions) {
  const Equilibrium<Real, N, M> plane(loose, rank_tolerance);
  Real least[M], central[M];
  for (int i = 0; i < loose.count; ++i) {
    least[i] = 0;
    central[i] = (loose.lower[i] + loose.upper[i]) / 2;
  }
  plane.project(least);
  plane.project(central);

  Real from = 0, to = 1;  // the s that keep all limits
  for (int i = 0; i < loose.count; ++i) {
    const Real low = loose.lower[i], high = loose.upper[i], way = central[i] - least[i];
    if (least[i] < low) from = way > 0 ? larger(from, (low - least[i]) / way) : Real(2);
    if (least[i] > high) from = way < 0 ? larger(from, (high - least[i]) / way) : Real(2);
    if (way > 0 && least[i] <= high) to = smaller(to, (high - least[i]) / way);
    if (way < 0 && least[i] >= low) to = smaller(to, (low - least[i]) / way);
  }
  const Real s = from <= to ? from : Real(1);
  for (int i = 0; i < loose.count; ++i) tensions[i] = least[i] + s * (central[i] - least[i]);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
