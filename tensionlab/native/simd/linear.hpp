// Small dense linear algebra for one problem: the rows of a wide matrix made orthonormal.
#pragma once

#include <cmath>
#include <limits>

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// A matrix B (rank x n) that makes the rows of B * W orthonormal. Its rows span the range of W, and |B r| is the
// length of the shortest tension vector that renders r: r' (W W')^+ r = |B r|^2. Where the rank is n beyond doubt,
// B is the inverse of a triangle, by Gram-Schmidt; elsewhere B = diag(1 / sigma) U' from the singular values of W.
template <class Real, int N, int M>
struct Whitening {
  Real rows[N][N];
  int rank;

  // structure: n x m, row by row; n <= N, m <= M.
  Whitening(const Real* structure, int n, int m, Real rank_tolerance) {
    if (!orthogonalise(structure, n, m)) decompose(structure, n, m, rank_tolerance);
  }

 private:
  // Gram and Schmidt, each row against those before it as they are by then. Loses the condition number in digits,
  // so it is believed only where that is small: |W| |B| bounds it.
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

  // Hestenes (1958): rotate pairs of rows until all are orthogonal.
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
          const Real tangent = (zeta < 0 ? Real(-1) : Real(1)) / (std::abs(zeta) + std::hypot(Real(1), zeta));
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

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
