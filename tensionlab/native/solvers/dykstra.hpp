// Dykstra's alternating projections between the equilibrium space {t: W t = w} and the limits, in every lane at
// once.
//
// With B from the singular values of W, so that the rows of Q = B W are orthonormal, the pseudo-inverse is Q' B
// and the projection of x is x + Q' (B w - Q x). Before clipping, the iterates stay in t0 + range(Q'), so n
// numbers u represent them, and an iteration, the two projections and the correction, is
//
//   z = clip(t0 + Q' u, a, b),   u += B w - Q z
//
// A lane is done when |w - W z| is small or, for an infeasible wrench, when the duality gap proves that z is as
// close to the equilibrium space as the limits allow.
//
// Sources: Boyle & Dykstra (1986) for the method; Bauschke & Borwein (1994) for its limit where nothing
// intersects.
#pragma once

#include <cmath>

#include "solvers/pseudoinverse.hpp"
#include "tensionlab/simd/batch.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class Dykstra {
 public:
  // m cables. An error of the wrench up to tolerance max(1, |w|) is accepted.
  Dykstra(int m, Real tolerance, long long iteration_limit, Real rank_tolerance)
      : m_(m), tolerance_(tolerance), limit_(iteration_limit), rank_tolerance_(rank_tolerance) {
    // A step must end at the limit, in every lane.
    while (limit_ % period_ != 0) --period_;
    for (int l = 0; l < L; ++l) idle(l);
  }

  // Gives lane l a problem of zeros.
  void idle(int l) {
    const Real zeros[N * M] = {};
    load(l, {zeros, zeros, zeros, zeros, zeros});
  }

  void load(int l, const Problem<Real>& problem) {
    const Pseudoinverse<Real, N, M> inverse(problem.structure, m_, rank_tolerance_);
    Real square = 0;
    for (int k = 0; k < N; ++k) square += problem.wrench[k] * problem.wrench[k];
    lane<Real>(accepted_, l) = tolerance_ * larger(Real(1), std::sqrt(square));
    for (int r = 0; r < N; ++r) {
      Real target = 0, back[N] = {};
      for (int k = 0; k < N; ++k) target += inverse.basis[r][k] * problem.wrench[k];
      Real pull = target;
      for (int i = 0; i < m_; ++i) {
        const Real entry = inverse.columns[i][r];
        lane<Real>(columns_[i][r], l) = entry;
        pull -= entry * problem.reference[i];
        for (int k = 0; k < N; ++k) back[k] += problem.structure[k * m_ + i] * entry;
      }
      lane<Real>(target_[r], l) = target;
      lane<Real>(pull_[r], l) = pull;
      for (int k = 0; k < N; ++k) lane<Real>(back_[r][k], l) = back[k];
    }
    for (int i = 0; i < m_; ++i) {
      lane<Real>(lower_[i], l) = problem.lower[i];
      lane<Real>(upper_[i], l) = problem.upper[i];
      lane<Real>(reference_[i], l) = problem.reference[i];
    }
    iterations_[l] = 0;
  }

  // Some iterations in every lane, then a test.
  void step() {
    V pull[N], missing[N];
    for (int r = 0; r < N; ++r) pull[r] = pull_[r];
    for (int k = 1; k < period_; ++k) {
      iterate(pull, missing, [](int, const V&) {});
      for (int r = 0; r < N; ++r) pull[r] += missing[r];
    }
    iterate(pull, missing, [this](int i, const V& tension) { tensions_[i] = tension; });
    for (int r = 0; r < N; ++r) pull_[r] = pull[r] + missing[r];
    test(missing);
  }

  // Whether lane l is done. Call after step().
  bool finished(int l) {
    iterations_[l] += period_;
    return read<Real>(done_, l) != 0 || iterations_[l] >= limit_;
  }

  // Stores the tensions of lane l. Returns its iterations.
  long long store(int l, Real* tensions) const {
    for (int i = 0; i < m_; ++i) tensions[i] = read<Real>(tensions_[i], l);
    return iterations_[l];
  }

 private:
  using V = Lanes<Real, L>;

  // One iteration except its last sum: missing = B w - Q z. The cables go in pairs, for two independent sums; a
  // missing partner has zeros.
  template <class Visit>
  void iterate(const V (&pull)[N], V (&missing)[N], const Visit& visit) const {
    V other[N];
    for (int r = 0; r < N; ++r) {
      missing[r] = target_[r];
      other[r] = V{};
    }
    for (int i = 0; i < m_; i += 2) {
      const V first = tension(i, pull), second = tension(i + 1, pull);
      for (int r = 0; r < N; ++r) {
        missing[r] -= columns_[i][r] * first;
        other[r] -= columns_[i + 1][r] * second;
      }
      visit(i, first);
      visit(i + 1, second);
    }
    for (int r = 0; r < N; ++r) missing[r] += other[r];
  }

  V tension(int i, const V (&pull)[N]) const {
    V wanted = reference_[i];
    for (int r = 0; r < N; ++r) wanted += columns_[i][r] * pull[r];
    return smaller(larger(wanted, lower_[i]), upper_[i]);
  }

  // Q' missing leads from z to the equilibrium space, so its length, |missing|, is the distance. No tensions
  // inside the limits are closer than that less the gap: how far the limits extend beyond z along Q' missing.
  void test(const V (&missing)[N]) {
    V error = V{}, distance = V{}, gap = V{};
    for (int k = 0; k < N; ++k) {
      V component = V{};
      for (int r = 0; r < N; ++r) component += back_[r][k] * missing[r];
      error += component * component;
      distance += missing[k] * missing[k];
    }
    for (int i = 0; i < m_; ++i) {
      V along = V{};
      for (int r = 0; r < N; ++r) along += columns_[i][r] * missing[r];
      gap += larger(V(along * (lower_[i] - tensions_[i])), V(along * (upper_[i] - tensions_[i])));
    }
    const V square = accepted_ * accepted_;
    done_ = ((error <= square) | (gap * gap <= square * distance)) ? V{} + Real(1) : V{};
  }

  int m_, period_ = 8;  // iterations in a step; the test at its end costs about as much as two
  Real tolerance_;
  long long limit_;
  Real rank_tolerance_;
  // Of each lane: Q, cable by cable; B w; and W Q', which makes w - W z of B w - Q z.
  V columns_[M][N] = {}, target_[N] = {}, back_[N][N] = {};
  V lower_[M] = {}, upper_[M] = {}, reference_[M] = {}, accepted_ = {};
  V pull_[N] = {}, tensions_[M] = {}, done_ = {};  // u, z
  long long iterations_[L] = {};
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
