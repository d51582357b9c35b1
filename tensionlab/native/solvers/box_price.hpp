// Prices of SPIDAR's program (solvers/dual_ascent.hpp): (t - t0)^2 / 2 for each cable within its limits, s^2 / 2
// for the error, rows times the roots of price / mu.
#pragma once

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
struct BoxPrice {
  using V = Lanes<Real, L>;
  static constexpr bool kTightens = false;
  Real row_roots[N];
  V lower[M] = {}, upper[M] = {}, reference[M] = {};

  template <class Problem>
  void load(int l, int m, const Problem& problem, Real (&column)[M][N], Real (&target)[N]) {
    for (int k = 0; k < N; ++k) {
      target[k] = row_roots[k] * problem.wrench[k];
      for (int i = 0; i < m; ++i) column[i][k] = row_roots[k] * problem.structure[k * m + i];
    }
    for (int i = 0; i < m; ++i) {
      lane<Real>(lower[i], l) = problem.lower[i];
      lane<Real>(upper[i], l) = problem.upper[i];
      lane<Real>(reference[i], l) = problem.reference[i];
    }
  }

  // At y = 0 every cable counts as free, so that the first step has the right length.
  V cable(int i, const V& q, V& give) const {
    const V zero = V{}, one = zero + Real(1);
    const V wanted = reference[i] + q;
    give = (((wanted > lower[i]) & (wanted < upper[i])) | (q == zero)) ? one : zero;
    return smaller(larger(wanted, lower[i]), upper[i]);
  }

  void slack(const V (&y)[N], V (&s)[N], V (&yield)[N][N]) const {
    for (int k = 0; k < N; ++k) {
      s[k] = y[k];
      for (int j = 0; j < k; ++j) yield[k][j] = V{};
      yield[k][k] = V{} + Real(1);
    }
  }

  Real tension(int, int, Real x) const { return x; }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
