// The Newton step of all lanes at once: a small symmetric system with pivots kept positive.
#pragma once

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// H = L D L' with no pivot D below its least, which is positive: L below its diagonal of ones, and 1 / D.
template <class V, int N>
struct Factor {
  V triangle[N][N], inverse[N];
  V raised;  // how many pivots were below

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

  // x from H x = r.
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

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
