// Tensions from the middle of their limits, t = c + h x with x from -1 to 1, for laws of solvers/dual_ascent.hpp:
// the columns are h_i W_i and the target is w - W c, rows times the roots of the wrench weights, in units of the
// largest column. A cable without play has h = 0: no column, and no part in anything.
#pragma once

#include <cmath>

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
struct Middle {
  Real centre[L][M], half[L][M];
  Real weight_roots[N];

  template <class Problem>
  void load(int l, int m, const Problem& problem, Real (&column)[M][N], Real (&target)[N]) {
    for (int k = 0; k < N; ++k) target[k] = problem.wrench[k];
    Real unit = 0;
    for (int i = 0; i < m; ++i) {
      const Real a = problem.lower[i], b = problem.upper[i];
      centre[l][i] = a + (b - a) / 2;
      half[l][i] = (b - a) / 2;
      Real square = 0;
      for (int k = 0; k < N; ++k) {
        const Real entry = problem.structure[k * m + i];
        target[k] -= entry * centre[l][i];
        column[i][k] = weight_roots[k] * entry * half[l][i];
        square += column[i][k] * column[i][k];
      }
      unit = larger(unit, std::sqrt(square));
    }
    unit = unit > 0 ? unit : Real(1);
    for (int k = 0; k < N; ++k) {
      target[k] *= weight_roots[k] / unit;
      for (int i = 0; i < m; ++i) column[i][k] /= unit;
    }
  }

  Real tension(int i, int l, Real x) const { return centre[l][i] + half[l][i] * x; }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
