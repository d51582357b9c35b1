// The closed forms for one problem: from a starting point, the least change that renders the wrench.
//
// Sources: Pott, Bruckmann & Mikelsons (2009); Pott (2014) for the improved one.
#pragma once

#include <algorithm>
#include <cmath>

#include "solvers/pseudoinverse.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// One problem, all pointers to contiguous numbers. structure is n x m, row by row.
template <class Real>
struct Start {
  const Real *structure, *wrench, *lower, *upper, *tensions;
  int cables;
};

// Brings t inside the limits. Returns the cable that missed them by most, and in `violation` by how much.
template <class Real>
int clip(const Start<Real>& start, Real* tensions, Real* violation) {
  int worst = 0;
  *violation = 0;
  for (int i = 0; i < start.cables; ++i) {
    const Real inside = std::min(std::max(tensions[i], start.lower[i]), start.upper[i]);
    const Real missed = std::abs(tensions[i] - inside);
    if (missed > *violation) {
      *violation = missed;
      worst = i;
    }
    tensions[i] = inside;
  }
  return worst;
}

// The change without limits, then clipped.
template <class Real, int N, int M>
int closed_form(const Start<Real>& start, Real rank_tolerance, Real* tensions) {
  const Pseudoinverse<Real, N, M> inverse(start.structure, start.cables, rank_tolerance);
  std::copy(start.tensions, start.tensions + start.cables, tensions);
  inverse.project(start.structure, start.wrench, tensions);
  Real violation;
  clip(start, tensions, &violation);
  return 0;
}

// While limits are missed, fixes the cable that misses its limit most there, and solves again for the others.
// Returns how many cables it fixed.
template <class Real, int N, int M>
int improved_closed_form(const Start<Real>& start, Real rank_tolerance, Real* tensions) {
  // A limit counts as kept if it is missed by less than this share of the largest one; clipping hides it.
  constexpr Real kRounding = Real(1e-12);
  const int m = start.cables;
  Real loose[N * M], strongest = 0;
  bool free[M];
  int budget = 0;
  for (int i = 0; i < m; ++i) {
    // A cable without play is fixed from the start, and costs no reduction. A fixed cable has a zero column: then
    // the pseudo-inverse gives it no part of the missing wrench.
    free[i] = start.lower[i] < start.upper[i];
    budget += free[i];
    for (int k = 0; k < N; ++k) loose[k * m + i] = free[i] ? start.structure[k * m + i] : Real(0);
    strongest = std::max({strongest, std::abs(start.lower[i]), std::abs(start.upper[i])});
    tensions[i] = free[i] ? start.tensions[i] : start.lower[i];
  }
  for (int fixed = 0;; ++fixed) {
    const Pseudoinverse<Real, N, M> inverse(loose, m, rank_tolerance);
    if (fixed == 0) budget -= inverse.rank;
    inverse.project(start.structure, start.wrench, tensions);
    Real violation;
    const int worst = clip(start, tensions, &violation);
    if (violation <= kRounding * strongest || fixed >= budget) return fixed;
    free[worst] = false;
    for (int k = 0; k < N; ++k) loose[k * m + worst] = 0;
    for (int i = 0; i < m; ++i) {
      if (free[i]) tensions[i] = start.tensions[i];
    }
  }
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
