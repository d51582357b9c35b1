// The coordinates in which one policy measures the error of a wrench that is out of reach.
#pragma once

#include <cmath>

#include "simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The problem in x = B w. Multipliers y are converted with it, so that W'y stays the same as far as possible.
template <class Real, int N, int M>
struct Coordinates {
  Real basis[N][N], structure[N * M], wrench[N];

  // Multiplies every component by the root of its weight, so that the error counts by its plain length.
  void weigh(int m, const Real* given, const Real* desired, const Real* roots, Real* y) {
    for (int k = 0; k < N; ++k) {
      for (int j = 0; j < N; ++j) basis[k][j] = k == j ? roots[k] : Real(0);
      wrench[k] = roots[k] * desired[k];
      y[k] /= roots[k];
      for (int i = 0; i < m; ++i) structure[k * m + i] = roots[k] * given[k * m + i];
    }
  }

  // Makes the rows of W orthonormal.
  void whiten(int m, const Real* given, const Real* desired, Real rank_tolerance, Real* y) {
    const Whitening<Real, N, M> whitening(given, N, m, rank_tolerance);
    Real pull[M];
    for (int i = 0; i < m; ++i) {
      pull[i] = 0;
      for (int k = 0; k < N; ++k) pull[i] += given[k * m + i] * y[k];
    }
    for (int r = 0; r < N; ++r) {
      wrench[r] = y[r] = 0;
      for (int k = 0; k < N; ++k) {
        basis[r][k] = r < whitening.rank ? whitening.rows[r][k] : Real(0);
        wrench[r] += basis[r][k] * desired[k];
      }
      for (int i = 0; i < m; ++i) {
        Real sum = 0;
        for (int k = 0; k < N; ++k) sum += basis[r][k] * given[k * m + i];
        structure[r * m + i] = sum;
        y[r] += sum * pull[i];
      }
    }
  }

  // Converts a direction or multiplier back: out = B'd.
  void back(const Real* d, Real* out) const {
    for (int k = 0; k < N; ++k) {
      out[k] = 0;
      for (int j = 0; j < N; ++j) out[k] += basis[j][k] * d[j];
    }
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
