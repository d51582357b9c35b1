// Vectors of N plain numbers.
#pragma once

#include <cmath>

#include "simd/lanes.hpp"

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

// Make x a unit vector, or nought if it is; returns its length.
template <int N, class Real>
Real normalise(Real* x) {
  const Real length = std::sqrt(dot<N>(x, x));
  for (int k = 0; k < N; ++k) x[k] = length > 0 ? x[k] / length : Real(0);
  return length;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
