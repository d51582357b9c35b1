// All tensions that render one wrench, limits aside: the plane W t = w of the cables that have play.
#pragma once

#include "linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The cables of one problem that have play. One whose limits are equal has nothing to choose: its share of the
// wrench is subtracted, its column dropped.
template <class Real, int N, int M>
struct LooseCables {
  int n, count = 0;
  int index[M];         // which they are, in order
  Real columns[N * M];  // of W, each contiguous ...
  Real wrench[N];       // ... and what is left for them, both times a power of two that makes W of size one

  // structure: n rows of m numbers.
  LooseCables(const Real* structure, const Real* asked, const Real* lower, const Real* upper, int components,
              int m)
      : n(components) {
    for (int k = 0; k < n; ++k) wrench[k] = asked[k];
    for (int i = 0; i < m; ++i) {
      const bool loose = lower[i] < upper[i];
      for (int k = 0; k < n; ++k) {
        const Real entry = structure[k * m + i];
        if (loose) {
          columns[count * n + k] = entry;
        } else {
          wrench[k] -= entry * lower[i];
        }
      }
      if (loose) index[count++] = i;
    }
    Real largest = 0;
    for (int e = 0; e < count * n; ++e) largest = larger(largest, magnitude(columns[e]));
    if (largest > 0) {
      int exponent;
      std::frexp(largest, &exponent);
      const Real unit = std::ldexp(Real(1), exponent > -1000 ? -exponent : 1000);
      for (int e = 0; e < count * n; ++e) columns[e] *= unit;
      for (int k = 0; k < n; ++k) wrench[k] *= unit;
    }
  }
};

// Every array of tensions here has one entry for each cable with play. The part of the wrench that these cables
// can never render is left out of account.
template <class Real, int N, int M>
class Equilibrium {
 public:
  const LooseCables<Real, N, M>& cables;

  // Singular values below rank_tolerance times the largest count as zero.
  Equilibrium(const LooseCables<Real, N, M>& loose, Real rank_tolerance)
      : cables(loose), whitening_(loose.columns, loose.n, loose.count, rank_tolerance) {
    // The rows of B W are orthonormal but for rounding, which Gram and Schmidt remove.
    for (int k = 0; k < rank(); ++k) {
      for (int i = 0; i < cables.count; ++i) {
        rows_[k][i] = dot(whitening_.rows[k], cables.columns + i * cables.n, cables.n);
      }
      remove(rows_, k, rows_[k]);
      normalise(rows_[k]);
    }
  }

  int rank() const { return whitening_.rank; }
  int redundancy() const { return cables.count - rank(); }

  // The tensions of the plane that are closest to a start: t += W^+ (w - W t). Twice, because the first step
  // leaves an error of rounding times the condition of W.
  void closest(const Real* start, Real* tensions) const {
    for (int i = 0; i < cables.count; ++i) tensions[i] = start[i];
    for (int round = 0; round < 2; ++round) {
      Real missing[N];
      for (int k = 0; k < cables.n; ++k) {
        missing[k] = cables.wrench[k];
        for (int i = 0; i < cables.count; ++i) missing[k] -= cables.columns[i * cables.n + k] * tensions[i];
      }
      for (int k = 0; k < rank(); ++k) {
        const Real y = dot(whitening_.rows[k], missing, cables.n);
        for (int i = 0; i < cables.count; ++i) tensions[i] += y * rows_[k][i];
      }
    }
  }

  // An orthonormal basis of the null space, as many rows as the redundancy: unit vectors of the cables that can
  // move most, made orthogonal to all rows before them; twice, which is enough (Kahan).
  void null_space(Real (*basis)[M]) const {
    Real freedom[M];
    for (int i = 0; i < cables.count; ++i) {
      freedom[i] = 1;
      for (int k = 0; k < rank(); ++k) freedom[i] -= rows_[k][i] * rows_[k][i];
    }
    for (int d = 0; d < redundancy(); ++d) {
      int most = 0;
      for (int i = 1; i < cables.count; ++i) {
        if (freedom[i] > freedom[most]) most = i;
      }
      for (int i = 0; i < cables.count; ++i) basis[d][i] = i == most ? Real(1) : Real(0);
      for (int round = 0; round < 2; ++round) {
        remove(rows_, rank(), basis[d]);
        remove(basis, d, basis[d]);
        normalise(basis[d]);
      }
      for (int i = 0; i < cables.count; ++i) freedom[i] -= basis[d][i] * basis[d][i];
    }
  }

 private:
  void remove(const Real (*from)[M], int count, Real* x) const {
    for (int k = 0; k < count; ++k) {
      const Real share = dot(from[k], x, cables.count);
      for (int i = 0; i < cables.count; ++i) x[i] -= share * from[k][i];
    }
  }
  void normalise(Real* x) const {
    const Real length = std::sqrt(dot(x, x, cables.count));
    for (int i = 0; i < cables.count; ++i) x[i] /= length;
  }
  static Real dot(const Real* x, const Real* y, int length) {
    Real sum = 0;
    for (int i = 0; i < length; ++i) sum += x[i] * y[i];
    return sum;
  }

  Whitening<Real, N, M> whitening_;
  Real rows_[N][M];
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
