// The dual of a tension problem whose cables and whose wrench error each have a price, in every lane at once.
//
//   minimise  sum_i price_i(x_i) + price(s)   subject to   A x + s = b
//
// x_i is the position of cable i between its limits, s the part of the wrench that is not rendered. Prices are
// convex, so a multiplier y of the n wrench components fixes both: x_i(A_i'y) where the slope of its price is
// A_i'y, and s(y) where the slope of its price is y. The dual is concave; its gradient is r(y) = b - A x(y) -
// s(y), and its Hessian needs only the derivatives of x_i and s: Newton steps p, with a line search for the root
// of the slope p'r. Every x_i(q) is inside its limits, so that no feasible start is needed.
//
// A Law defines x_i and s (solvers/dual_laws.hpp).
// Source: Boyd & Vandenberghe (2004), "Convex Optimization", sections 5.5.5 and 9.5.
#pragma once

#include <cmath>
#include <limits>

#include "tensionlab/simd/batch.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Law, class Real, int L, int N, int M>
class DualAscent {
 public:
  using V = Lanes<Real, L>;

  DualAscent(int m, const Law& law) : m_(m), law_(law) {
    for (int l = 0; l < L; ++l) idle(l);
  }

  // Gives lane l a problem of zeros.
  void idle(int l) {
    const Real zeros[N * M] = {};
    load(l, {zeros, zeros, zeros, zeros, zeros});
  }

  // The lane begins at y = 0, and its first step only evaluates.
  void load(int l, const Problem<Real>& problem) {
    Real column[M][N], target[N];
    law_.load(l, m_, problem, column, target);
    Real size = 0;
    for (int k = 0; k < N; ++k) {
      size = larger(size, std::abs(target[k]));
      lane<Real>(target_[k], l) = target[k];
      lane<Real>(dual_[k], l) = lane<Real>(residual_[k], l) = 0;
      for (int j = 0; j <= k; ++j) lane<Real>(yield_[k][j], l) = k == j ? Real(1) : Real(0);
    }
    for (int i = 0; i < m_; ++i) {
      Real square = 0;
      for (int k = 0; k < N; ++k) {
        lane<Real>(column_[i][k], l) = column[i][k];
        square += column[i][k] * column[i][k];
      }
      lane<Real>(square_[i], l) = square;
      lane<Real>(give_[i], l) = 0;
      size = larger(size, std::sqrt(square));
    }
    lane<Real>(size_, l) = size;
    control_[l] = Control{};
  }

  void step() {
    direct();
    search();
    if constexpr (Law::kTightens) tighten();
  }

  // Whether lane l is done. Call after step().
  bool finished(int l) {
    Control& control = control_[l];
    ++control.steps;
    const Real error = read<Real>(error_, l);
    bool last = true;
    if constexpr (Law::kTightens) last = law_.tight(l);
    if (last && error <= read<Real>(accepted_, l)) return true;
    // A small error that no longer falls is rounding.
    control.stalls = error < control.least / 2 ? 0 : control.stalls + 1;
    control.least = smaller(control.least, error);
    return control.steps > kStepLimit || (control.stalls > kPatience && error <= kSmall * read<Real>(size_, l));
  }

  // Stores the tensions (m) of lane l. Returns its Newton steps.
  int store(int l, Real* tensions) const {
    for (int i = 0; i < m_; ++i) tensions[i] = law_.tension(i, l, read<Real>(value_[i], l));
    return control_[l].steps - 1;
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr Real kConverged = 1024 * kUlp, kSmall = Real(1e6) * kUlp;
  static constexpr Real kLeastPivot = 8 * kUlp;  // as a share of the diagonal of the Hessian
  // Line search: the accepted share of the first slope, less where a law tightens after good steps; an unbounded
  // step; the largest extension of a step.
  static constexpr Real kRoot = Real(Law::kTightens ? 0.02 : 0.1);
  static constexpr Real kFar = Real(1e30), kLeap = 16, kShrink = Real(1e-3);
  static constexpr int kSearchRounds = 40, kPatience = 4, kStepLimit = 300;

  struct Control {
    int steps = 0, stalls = 0;
    Real least = std::numeric_limits<Real>::max();
  };

  // Solves H p = r for the Newton step p, with H = A diag(x') A' + s' = L D L' and positive pivots D.
  void direct() {
    const V zero = V{};
    V matrix[N][N], least[N];
    for (int k = 0; k < N; ++k) {
      for (int j = 0; j <= k; ++j) matrix[k][j] = yield_[k][j];
    }
    for (int i = 0; i < m_; ++i) {
      for (int k = 0; k < N; ++k) {
        const V part = give_[i] * column_[i][k];
        for (int j = 0; j <= k; ++j) matrix[k][j] += part * column_[i][j];
      }
    }
    for (int k = 0; k < N; ++k) {
      const V share = kLeastPivot * matrix[k][k];
      least[k] = share > zero ? share : zero + Real(1);
      origin_[k] = dual_[k];
    }
    Factor<V, N>(matrix, least).solve(residual_, direction_);
    slope_ = inner(direction_, residual_);
  }

  // Goes along p until the slope p'r, which falls, is a small part of the first. Newton steps inside a bracket;
  // leaps where there is none yet and the slope hardly falls. For wrenches far from feasible x_i jumps from one
  // side to the other, and the root may be many orders of magnitude away: brackets are halved in their logarithm.
  void search() {
    const V zero = V{}, one = zero + Real(1);
    V step = one, low = zero, high = zero + kFar;
    evaluate(step);
    auto open = slope_ > zero;
    full_ = ((open & (magnitude(along_) <= kRoot * slope_)) | (error_ <= accepted_)) ? one : zero;
    for (int round = 0; round < kSearchRounds; ++round) {
      open = open & (magnitude(along_) > kRoot * slope_) & (error_ > accepted_);
      if (!any(open)) return;
      low = along_ > zero ? larger(low, step) : low;
      high = along_ > zero ? high : smaller(high, step);
      const V newton = step + along_ / (bend_ > zero ? bend_ : zero + Real(1) / kFar);
      const V middle = square_root<Real, L>(V(larger(low, V(kShrink * high)) * high));
      const auto unbounded = high >= zero + kFar;
      const V careful = round % 3 == 2 ? middle : newton;  // Newton steps alone may creep
      const V next = unbounded ? (newton > Real(1.9) * step ? V(kLeap * step) : newton) : careful;
      step = open ? (((next > low) & (next < high)) ? next : middle) : step;
      evaluate(step);
    }
    step = open ? low : step;
    evaluate(step);
  }

  // Lets the law tighten after a step of full length, and recomputes what depends on s.
  void tighten() {
    V s[N], error = V{};
    for (int k = 0; k < N; ++k) residual_[k] += slack_[k];
    law_.tighten(full_);
    law_.slack(dual_, s, yield_);
    for (int k = 0; k < N; ++k) {
      residual_[k] -= s[k];
      error = larger(error, magnitude(residual_[k]));
    }
    error_ = error;
  }

  // Evaluates tensions, error and their derivatives at y = origin + step p.
  void evaluate(const V& step) {
    const V zero = V{};
    V point[N], residual[N], error = zero, length = zero;
    for (int k = 0; k < N; ++k) {
      dual_[k] = point[k] = origin_[k] + step * direction_[k];
      length = larger(length, magnitude(point[k]));
    }
    law_.slack(point, residual, yield_);
    bend_ = zero;
    for (int k = 0; k < N; ++k) {
      slack_[k] = residual[k];
      residual[k] = target_[k] - residual[k];
      V row = zero;
      for (int j = 0; j < k; ++j) row += yield_[k][j] * direction_[j];
      bend_ += direction_[k] * (yield_[k][k] * direction_[k] + Real(2) * row);
    }
    V pull[M], noise = zero;
    for (int i = 0; i < m_; ++i) {
      pull[i] = zero;
      for (int k = 0; k < N; ++k) pull[i] += column_[i][k] * point[k];
    }
    law_.cables(m_, pull, value_, give_);
    for (int i = 0; i < m_; ++i) {
      V turn = zero;
      for (int k = 0; k < N; ++k) {
        turn += column_[i][k] * direction_[k];
        residual[k] -= column_[i][k] * value_[i];
      }
      bend_ += give_[i] * turn * turn;
      noise += give_[i] * square_[i];
    }
    along_ = zero;
    for (int k = 0; k < N; ++k) {
      residual_[k] = residual[k];
      along_ += residual[k] * direction_[k];
      error = larger(error, magnitude(residual[k]));
    }
    error_ = error;
    accepted_ = kConverged * size_ + 4 * kUlp * length * noise;  // A_i'y is rounded, and moves x_i
  }

  int m_;
  Law law_;
  V column_[M][N] = {}, target_[N] = {}, square_[M] = {}, size_ = {};  // A, b, the squares of A's columns
  V dual_[N] = {}, origin_[N] = {}, direction_[N] = {};
  V value_[M] = {}, give_[M] = {}, slack_[N] = {}, yield_[N][N] = {};  // x, s and their derivatives
  V residual_[N] = {}, error_ = {}, accepted_ = {};
  V full_ = {};                            // 1 where the whole of p was a good step
  V slope_ = {}, along_ = {}, bend_ = {};  // of the dual along p: at its start, here, and how fast it falls here
  Control control_[L];
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
