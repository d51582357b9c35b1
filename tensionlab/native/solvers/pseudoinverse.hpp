// The pseudo-inverse of one structure matrix, and the plane W t = w of all tensions that render a wrench.
#pragma once

#include <cmath>

#include "tensionlab/simd/batch.hpp"
#include "tensionlab/simd/linear.hpp"

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
      for (int r = 0; r < N; ++r) pull[r] = dot<N>(basis[r], missing);
      for (int i = 0; i < cables_; ++i) tensions[i] += dot<N>(columns[i], pull);
    }
  }

 private:
  int cables_;
};

// The cables of one problem whose limits differ. One whose limits are equal has its share of the wrench
// subtracted, and its column dropped.
template <class Real, int N, int M>
struct LooseCables {
  int count = 0;
  int index[M];  // which they are, in order
  Real lower[M], upper[M];
  Real structure[N * M];  // N x count, row by row
  Real wrench[N];         // remaining for them

  LooseCables(const Problem<Real>& problem, int m) {
    const Real *low = problem.lower, *high = problem.upper;
    for (int i = 0; i < m; ++i) {
      if (!(low[i] < high[i])) continue;
      lower[count] = low[i];
      upper[count] = high[i];
      index[count++] = i;
    }
    for (int k = 0; k < N; ++k) {
      const Real* row = problem.structure + k * m;
      wrench[k] = problem.wrench[k];
      for (int i = 0; i < m; ++i) wrench[k] -= low[i] < high[i] ? Real(0) : row[i] * low[i];
      for (int i = 0; i < count; ++i) structure[k * count + i] = row[index[i]];
    }
  }
};

// Every array of tensions here has one entry for each loose cable. The part of the wrench that these cables can
// never render is ignored.
template <class Real, int N, int M>
class Equilibrium {
 public:
  const LooseCables<Real, N, M>& cables;
  int redundancy;

  // Singular values below rank_tolerance times the largest count as zero.
  Equilibrium(const LooseCables<Real, N, M>& loose, Real rank_tolerance)
      : cables(loose), inverse_(loose.structure, loose.count, rank_tolerance) {
    redundancy = cables.count - inverse_.rank;
  }

  // Moves tensions to the closest ones of the plane.
  void project(Real* tensions) const { inverse_.project(cables.structure, cables.wrench, tensions); }

  // Finds an orthonormal basis of the null space, a row for each degree of redundancy: unit vectors of the cables
  // that can move most, made orthogonal to all rows before them; twice, which is enough (Kahan).
  void null_space(Real (*basis)[M]) const {
    Real freedom[M];
    for (int i = 0; i < cables.count; ++i) {
      freedom[i] = 1;
      for (int k = 0; k < N; ++k) freedom[i] -= inverse_.columns[i][k] * inverse_.columns[i][k];
    }
    for (int d = 0; d < redundancy; ++d) {
      int most = 0;
      for (int i = 1; i < cables.count; ++i) {
        if (freedom[i] > freedom[most]) most = i;
      }
      Real* x = basis[d];
      for (int i = 0; i < cables.count; ++i) x[i] = i == most ? Real(1) : Real(0);
      for (int round = 0; round < 2; ++round) {
        Real pull[N] = {};
        for (int i = 0; i < cables.count; ++i) {
          for (int k = 0; k < N; ++k) pull[k] += inverse_.columns[i][k] * x[i];
        }
        for (int i = 0; i < cables.count; ++i) {
          for (int k = 0; k < N; ++k) x[i] -= inverse_.columns[i][k] * pull[k];
        }
        for (int e = 0; e < d; ++e) {
          const Real share = dot(basis[e], x);
          for (int i = 0; i < cables.count; ++i) x[i] -= share * basis[e][i];
        }
        const Real length = std::sqrt(dot(x, x));
        for (int i = 0; i < cables.count; ++i) x[i] /= length;
      }
      for (int i = 0; i < cables.count; ++i) freedom[i] -= x[i] * x[i];
    }
  }

 private:
  Real dot(const Real* x, const Real* y) const {
    Real sum = 0;
    for (int i = 0; i < cables.count; ++i) sum += x[i] * y[i];
    return sum;
  }

  Pseudoinverse<Real, N, M> inverse_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
