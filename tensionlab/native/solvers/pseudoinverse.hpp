// The pseudo-inverse of one structure matrix, and the projection onto the tensions that render a wrench.
#pragma once

#include "simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// W+ = Q' B, where B makes the rows of Q = B W orthonormal. Rows beyond the rank of W are zero.
template <class Real, int N, int M>
struct Pseudoinverse {
  Real basis[N][N];    // B
  Real columns[M][N];  // Q, column by column
  int rank;

  // structure: W, n x m, row by row.
  Pseudoinverse(const Real* structure, int m, Real rank_tolerance) : cables_(m) {
    const Whitening<Real, N, M> whitening(structure, N, m, rank_tolerance);
    rank = whitening.rank;
    for (int r = 0; r < N; ++r) {
      for (int k = 0; k < N; ++k) basis[r][k] = r < rank ? whitening.rows[r][k] : Real(0);
      for (int i = 0; i < m; ++i) {
        columns[i][r] = 0;
        for (int k = 0; k < N; ++k) columns[i][r] += basis[r][k] * structure[k * m + i];
      }
    }
  }

  // t += W+ (w - V t): the least change that makes V t = w, if any does. V is W, or W with more columns that are
  // zero here: the tensions of those cables stay. The second pass takes away the rounding that B, as large as W is
  // nearly singular, leaves in V t after the first.
  void project(const Real* structure, const Real* wrench, Real* tensions) const {
    for (int pass = 0; pass < 2; ++pass) {
      Real missing[N], pull[N];
      for (int k = 0; k < N; ++k) {
        missing[k] = wrench[k];
        for (int i = 0; i < cables_; ++i) missing[k] -= structure[k * cables_ + i] * tensions[i];
      }
      for (int r = 0; r < N; ++r) pull[r] = dot(basis[r], missing);
      for (int i = 0; i < cables_; ++i) tensions[i] += dot(columns[i], pull);
    }
  }

 private:
  static Real dot(const Real* x, const Real* y) {
    Real sum = 0;
    for (int k = 0; k < N; ++k) sum += x[k] * y[k];
    return sum;
  }

  int cables_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
