// Vectors dual to a few columns.
#pragma once

#include <cmath>

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// For `count` columns of N numbers, one a row, vectors in their span that have 1 along their own column and 0
// along the others: by Gram and Schmidt, each column twice, so that what is left of it is right however little it
// is. False if one is within that share of its length from the span of those before it.
template <int N>
bool dual_basis(const double (&column)[N][N], int count, double least_share, double (&basis)[N][N]) {
  double q[N][N], r[N][N];
  const auto dot = [](const double* a, const double* b) {
    double sum = 0;
    for (int k = 0; k < N; ++k) sum += a[k] * b[k];
    return sum;
  };
  for (int a = 0; a < count; ++a) {
    for (int k = 0; k < N; ++k) q[a][k] = column[a][k];
    for (int b = 0; b < a; ++b) r[b][a] = 0;
    for (int pass = 0; pass < 2; ++pass) {
      for (int b = 0; b < a; ++b) {
        const double share = dot(q[a], q[b]);
        for (int k = 0; k < N; ++k) q[a][k] -= share * q[b][k];
        r[b][a] += share;
      }
    }
    r[a][a] = std::sqrt(dot(q[a], q[a]));
    if (!(r[a][a] > least_share * std::sqrt(dot(column[a], column[a])))) return false;
    for (int k = 0; k < N; ++k) q[a][k] /= r[a][a];
  }
  for (int a = count; a-- > 0;) {
    for (int k = 0; k < N; ++k) basis[a][k] = q[a][k];
    for (int b = a + 1; b < count; ++b) {
      for (int k = 0; k < N; ++k) basis[a][k] -= r[a][b] * basis[b][k];
    }
    for (int k = 0; k < N; ++k) basis[a][k] /= r[a][a];
  }
  return true;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
