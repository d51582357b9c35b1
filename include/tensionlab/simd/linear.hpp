// Small dense linear algebra.
#pragma once

#include <cmath>
#include <limits>

#include "tensionlab/simd/batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int N, class Real>
Real dot(const Real* x, const Real* y) {
  Real sum = 0;
  for (int k = 0; k < N; ++k) sum += x[k] * y[k];
  return sum;
}

template <int N, class Real>
void copy(const Real* from, Real* to) {
  for (int k = 0; k < N; ++k) to[k] = from[k];
}

// Makes x a unit vector, or zero if it is; returns its length.
template <int N, class Real>
Real normalise(Real* x) {
  const Real length = std::sqrt(dot<N>(x, x));
  for (int k = 0; k < N; ++k) x[k] = length > 0 ? x[k] / length : Real(0);
  return length;
}

// Factors of a symmetric H, of all lanes at once: H = L D L' with no pivot D below its least, which is positive.
template <class V, int N>
struct Factor {
  V triangle[N][N], inverse[N];  // L below its diagonal of ones; 1 / D
  V raised;                      // number of pivots that were below their least

  // Only the lower triangle of H is read; it is overwritten.
  Factor(V (&matrix)[N][N], const V (&least)[N]) {
    const V one = V{} + 1;
    raised = V{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      V d = matrix[k][k];
      TENSIONLAB_UNROLL
      for (int j = 0; j < k; ++j) {
        V entry = matrix[k][j];
        for (int i = 0; i < j; ++i) entry -= matrix[k][i] * triangle[j][i];
        matrix[k][j] = entry;  // L D
        triangle[k][j] = entry * inverse[j];
        d -= entry * triangle[k][j];
      }
      raised += d < least[k] ? one : V{};
      inverse[k] = one / larger(d, least[k]);
    }
  }

  // Solves H x = right.
  void solve(const V (&right)[N], V (&x)[N]) const {
    V y[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      y[k] = right[k];
      TENSIONLAB_UNROLL
      for (int j = 0; j < k; ++j) y[k] -= triangle[k][j] * y[j];
    }
    TENSIONLAB_UNROLL
    for (int k = N - 1; k >= 0; --k) {
      x[k] = y[k] * inverse[k];
      TENSIONLAB_UNROLL
      for (int j = k + 1; j < N; ++j) x[k] -= triangle[j][k] * x[j];
    }
  }
};

// Matrix B (rank x n) that makes the rows of B W orthonormal. Its rows span the range of W, and |B r| is the
// length of the shortest tension vector that renders r: r' (W W')^+ r = |B r|^2. Where W is well-conditioned, B is
// the inverse of a triangle, by Gram-Schmidt; elsewhere B = diag(1 / sigma) U' from the singular values of W.
template <class Real, int N, int M>
struct Whitening {
  Real rows[N][N];
  int rank;

  // structure: n x m, row by row; n <= N, m <= M.
  Whitening(const Real* structure, int n, int m, Real rank_tolerance) {
    if (!has(Route::gram_schmidt) || !orthogonalise(structure, n, m)) decompose(structure, n, m, rank_tolerance);
  }

 private:
  // Modified Gram-Schmidt. It loses the digits of the condition number, so false where |W| |B|, which bounds that,
  // is large.
  bool orthogonalise(const Real* structure, int n, int m) {
    constexpr Real kWell = 1000;
    if (m < n) return false;
    Real q[N][M] = {};
    Real size = 0, inverse = 0;
    for (int k = 0; k < n; ++k) {
      for (int i = 0; i < m; ++i) q[k][i] = structure[k * m + i];
      for (int j = 0; j < n; ++j) rows[k][j] = k == j ? Real(1) : Real(0);
      size += dot(q[k], q[k], m);
      for (int j = 0; j < k; ++j) {
        const Real share = dot(q[k], q[j], m);
        for (int i = 0; i < m; ++i) q[k][i] -= share * q[j][i];
        for (int i = 0; i <= j; ++i) rows[k][i] -= share * rows[j][i];
      }
      const Real length = std::sqrt(dot(q[k], q[k], m));
      if (!(length > 0)) return false;
      for (int i = 0; i < m; ++i) q[k][i] /= length;
      for (int i = 0; i <= k; ++i) {
        rows[k][i] /= length;
        inverse += rows[k][i] * rows[k][i];
      }
    }
    rank = n;
    return size * inverse < kWell * kWell;
  }

  // One-sided Jacobi rotations (Hestenes 1958).
  void decompose(const Real* structure, int n, int m, Real rank_tolerance) {
    Real a[N][M];
    Real u[N][N];
    for (int k = 0; k < n; ++k) {
      for (int i = 0; i < m; ++i) a[k][i] = structure[k * m + i];
      for (int j = 0; j < n; ++j) u[k][j] = k == j ? Real(1) : Real(0);
    }
    const Real tiny = 4 * std::numeric_limits<Real>::epsilon();
    bool rotated = true;
    for (int sweep = 0; sweep < 30 && rotated; ++sweep) {
      rotated = false;
      for (int p = 0; p + 1 < n; ++p) {
        for (int q = p + 1; q < n; ++q) {
          const Real pp = dot(a[p], a[p], m), qq = dot(a[q], a[q], m), pq = dot(a[p], a[q], m);
          if (!(std::abs(pq) > tiny * std::sqrt(pp * qq))) continue;
          rotated = true;
          const Real zeta = (qq - pp) / (2 * pq);
          const Real tangent = (zeta < 0 ? Real(-1) : Real(1)) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
          const Real cosine = 1 / std::sqrt(1 + tangent * tangent), sine = cosine * tangent;
          rotate(a[p], a[q], m, cosine, sine);
          rotate(u[p], u[q], n, cosine, sine);
        }
      }
    }
    Real sigma[N], largest = 0;
    for (int k = 0; k < n; ++k) {
      sigma[k] = std::sqrt(dot(a[k], a[k], m));
      if (sigma[k] > largest) largest = sigma[k];
    }
    rank = 0;
    for (int k = 0; k < n; ++k) {
      if (!(sigma[k] > rank_tolerance * largest)) continue;
      for (int j = 0; j < n; ++j) rows[rank][j] = u[k][j] / sigma[k];
      ++rank;
    }
  }

  static Real dot(const Real* x, const Real* y, int length) {
    Real sum = 0;
    for (int i = 0; i < length; ++i) sum += x[i] * y[i];
    return sum;
  }
  static void rotate(Real* x, Real* y, int length, Real cosine, Real sine) {
    for (int i = 0; i < length; ++i) {
      const Real old = x[i];
      x[i] = cosine * old - sine * y[i];
      y[i] = sine * old + cosine * y[i];
    }
  }
};

// Independent columns of N numbers, and an orthonormal basis of their span by Gram-Schmidt, each column twice, so
// that even a small remainder is accurate: columns = basis * triangle.
template <class Real, int N>
struct OrthogonalColumns {
  int count = 0;
  Real basis[N][N], triangle[N][N];  // a row of the basis for each column

  // Adds a column, unless its distance from the span of the others is at most this share of its length.
  bool add(const Real* column, Real least_share) {
    if (count >= N) return false;
    Real *last = basis[count], part[N] = {};
    copy<N>(column, last);
    take_out(last, part);
    take_out(last, part);
    const Real length = normalise<N>(last);
    if (!(length > least_share * std::sqrt(dot<N>(column, column)))) return false;
    for (int j = 0; j < count; ++j) triangle[j][count] = part[j];
    triangle[count][count] = length;
    ++count;
    return true;
  }

  // Subtracts from x its part in the span, and adds the part along each vector of the basis to share. Called twice
  // where x may be nearly inside the span, as rounding leaves some of it.
  void take_out(Real* x, Real* share) const {
    for (int j = 0; j < count; ++j) {
      const Real part = dot<N>(basis[j], x);
      share[j] += part;
      for (int k = 0; k < N; ++k) x[k] -= part * basis[j][k];
    }
  }
};

// Finds the dual basis of `count` columns (a row each): vectors in their span, each with product 1 with its own
// column and 0 with the others. Returns false if a column's distance from the span of those before it is below
// least_share of its length.
template <int N>
bool dual_basis(const double (&column)[N][N], int count, double least_share, double (&basis)[N][N]) {
  OrthogonalColumns<double, N> span;
  for (int a = 0; a < count; ++a) {
    if (!span.add(column[a], least_share)) return false;
  }
  for (int a = count; a-- > 0;) {
    copy<N>(span.basis[a], basis[a]);
    for (int b = a + 1; b < count; ++b) {
      for (int k = 0; k < N; ++k) basis[a][k] -= span.triangle[a][b] * basis[b][k];
    }
    for (int k = 0; k < N; ++k) basis[a][k] /= span.triangle[a][a];
  }
  return true;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
