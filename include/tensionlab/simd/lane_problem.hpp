// The problems of all lanes, and the magnitudes of their numbers.
#pragma once

#include <limits>

#include "tensionlab/simd/batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
struct LaneProblems {
  using V = Lanes<Real, L>;

  int m;
  V structure[M][N], wrench[N], lower[M], upper[M], reference[M];
  V diagonal[N] = {};               // of W W', or 1
  V gain = {}, desired = {};        // root of the largest square of a row, or 1; largest component of the wrench
  V strongest = {}, furthest = {};  // largest limit, and reference
  V high_cost = {};                 // a cost |t - t0|^2 / 2 that few feasible wrenches reach

  explicit LaneProblems(int cables) : m(cables) {}

  void load(const Problem<Real> (&source)[L]) {
    const V zero = V{}, one = zero + Real(1);
    const Real* row[L];
    V largest = zero;
    desired = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      V square = zero;
      for (int l = 0; l < L; ++l) row[l] = source[l].structure + k * m;
      transpose<Real, L>(row, m, [&](int i, const V& entry) {
        structure[i][k] = entry;
        square += entry * entry;
      });
      diagonal[k] = square > zero ? square : one;
      largest = larger(largest, square);
      wrench[k] = gather<Real, L>([&](int l) { return source[l].wrench[k]; });
      desired = larger(desired, magnitude(wrench[k]));
    }
    gain = square_root<Real, L>(largest > zero ? largest : one);
    if (limits_changed(source)) load_limits(source);
  }

  // W_i'd of cable i.
  V along(int i, const V (&d)[N]) const { return inner(structure[i], d); }

  // d'w - h(d), less its rounding error: where positive, d separates w from all feasible wrenches.
  TENSIONLAB_NOINLINE V separation_margin(const V (&d)[N]) const {
    V sum = V{}, size = V{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      sum += d[k] * wrench[k];
      size += magnitude(d[k]);
    }
    for (int i = 0; i < m; ++i) {
      const V pull = along(i, d);
      sum -= larger(V(pull * lower[i]), V(pull * upper[i]));
    }
    return sum - 16 * std::numeric_limits<Real>::epsilon() * Real(m) * gain * strongest * size;
  }

 private:
  // High cost, as a share of the way from the least cost inside the limits to the greatest: with few cables, and
  // with many.
  static constexpr Real kHighCost = Real(0.5), kHighCostOfMany = Real(0.35);

  Problem<Real> loaded_[L] = {};

  bool limits_changed(const Problem<Real> (&source)[L]) {
    bool changed = false;
    for (int l = 0; l < L; ++l) {
      const Problem<Real>&now = source[l], &then = loaded_[l];
      changed = changed || now.lower != then.lower || now.upper != then.upper || now.reference != then.reference;
      loaded_[l] = now;
    }
    return changed;
  }

  void load_limits(const Problem<Real> (&source)[L]) {
    strongest = furthest = V{};
    V least_cost = V{}, greatest_cost = V{};
    for (int i = 0; i < m; ++i) {
      lower[i] = gather<Real, L>([&](int l) { return source[l].lower[i]; });
      upper[i] = gather<Real, L>([&](int l) { return source[l].upper[i]; });
      reference[i] = gather<Real, L>([&](int l) { return source[l].reference[i]; });
      strongest = larger(strongest, larger(V(-lower[i]), upper[i]));
      furthest = larger(furthest, magnitude(reference[i]));
      const V below = lower[i] - reference[i], above = reference[i] - upper[i];
      const V least = larger(larger(below, above), V{}), most = larger(magnitude(below), magnitude(above));
      least_cost += least * least / 2;
      greatest_cost += most * most / 2;
    }
    high_cost = least_cost + (m < 2 * N ? kHighCost : kHighCostOfMany) * (greatest_cost - least_cost);
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
