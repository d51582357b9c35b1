// The Newton step of all lanes at once: a small symmetric system with pivots kept positive.
#pragma once

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// x from H x = r, with H = L D L' and no pivot D below its least, which is positive; and the product x'r. Only the
// lower triangle of H is read; it is overwritten. Returns how many pivots were below.
template <class V, int N>
inline V solve_with_pivots(V (&matrix)[N][N], const V (&right)[N], const V (&least)[N], V (&x)[N], V& product) {
  V factor[N][N], inverse[N], y[N];  // L, 1 / D
  const V one = V{} + 1;
  V raised = V{};
  TENSIONLAB_UNROLL
  for (int k = 0; k < N; ++k) {
    V sum = right[k], d = matrix[k][k];
    TENSIONLAB_UNROLL
    for (int j = 0; j < k; ++j) {
      V entry = matrix[k][j];
      for (int i = 0; i < j; ++i) entry -= matrix[k][i] * factor[j][i];
      matrix[k][j] = entry;  // L D
      factor[k][j] = entry * inverse[j];
      sum -= factor[k][j] * y[j];
      d -= entry * factor[k][j];
    }
    raised += d < least[k] ? one : V{};
    inverse[k] = one / larger(d, least[k]);
    y[k] = sum;
  }
  product = V{};
  TENSIONLAB_UNROLL
  for (int k = N - 1; k >= 0; --k) {
    x[k] = y[k] * inverse[k];
    TENSIONLAB_UNROLL
    for (int j = k + 1; j < N; ++j) x[k] -= factor[j][k] * x[j];
    product += x[k] * right[k];
  }
  return raised;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
