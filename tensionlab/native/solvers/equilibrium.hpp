// All tensions that render one wrench, limits aside: the plane W t = w of the cables that have play.
#pragma once

#include <cmath>

#include "solvers/pseudoinverse.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The cables of one problem that have play. One whose limits are equal has nothing to choose: its share of the
// wrench is subtracted, its column dropped.
template <class Real, int N, int M>
struct LooseCables {
  int count = 0;
  int index[M];  // which they are, in order
  Real lower[M], upper[M];
  Real structure[N * M];  // N x count, row by row
  Real wrench[N];         // what is left for them

  // all: N x m, row by row.
  LooseCables(const Real* all, const Real* desired, const Real* low, const Real* high, int m) {
    for (int i = 0; i < m; ++i) {
      if (!(low[i] < high[i])) continue;
      lower[count] = low[i];
      upper[count] = high[i];
      index[count++] = i;
    }
    for (int k = 0; k < N; ++k) {
      wrench[k] = desired[k];
      for (int i = 0; i < m; ++i) wrench[k] -= low[i] < high[i] ? Real(0) : all[k * m + i] * low[i];
      for (int i = 0; i < count; ++i) structure[k * count + i] = all[k * m + index[i]];
    }
  }
};

// Every array of tensions here has one entry for each cable with play. The part of the wrench that these cables
// can never render is left out of account.
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

  // An orthonormal basis of the null space, as many rows as the redundancy: unit vectors of the cables that can
  // move most, made orthogonal to all rows before them; twice, which is enough (Kahan).
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
