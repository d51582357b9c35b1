// One Newton step on the dual of a tension problem, in every lane at once.
//
// The dual has one variable y for each of the n wrench components. Its tensions are t(y) = clip(t0 + W' y, a, b)
// and its gradient is r(y) = w - W t(y). A step solves (W_F W_F') p = r over the cables F that are inside their
// limits; along p the slope of the dual, p'r, is piecewise linear and falling, so that its root is found exactly.
//
// With a proximal weight eps the steps maximise the dual less eps |y - c|^2 / 2, and the centre c follows each
// maximum: the method of multipliers, which also converges where no tensions render w.
#pragma once

#include <cmath>
#include <limits>

#include "lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class DualStep {
 public:
  using V = Lanes<Real, L>;

  explicit DualStep(int m) : m_(m) {}

  // The problem of each lane: set these, then begin() the lane. Errors are measured against the wrench asked for,
  // or against what the strongest cable can do where that is less.
  V structure[M][N] = {}, wrench[N] = {}, lower[M] = {}, upper[M] = {}, reference[M] = {};
  V asked = {}, strongest = {};

  // What step() found. Flags are 1 or 0; separated is positive where direction separates w from all W t.
  V direction[N] = {}, converged = {}, settled = {}, separated = {};

  // Start lane l at the multiplier zero, with a proximal term or without.
  void begin(int l, bool proximal) {
    Real largest = 0;
    for (int k = 0; k < N; ++k) {
      Real square = 0;
      for (int i = 0; i < m_; ++i) {
        const Real entry = read<Real>(structure[i][k], l);
        square += entry * entry;
      }
      lane<Real>(diagonal_[k], l) = square > 0 ? square : Real(1);
      if (square > largest) largest = square;
      lane<Real>(dual_[k], l) = lane<Real>(centre_[k], l) = 0;
    }
    largest = largest > 0 ? largest : Real(1);
    lane<Real>(gain_, l) = std::sqrt(largest);
    lane<Real>(looseness_, l) = proximal ? kSafe : kLoose;
    lane<Real>(proximal_, l) = proximal ? kProximal * largest : Real(0);
    lane<Real>(all_free_, l) = lane<Real>(centred_, l) = 1;
  }

  void step() {
    V matrix[N][N];  // H, here and not a member, so that it may live in registers
    linearise(matrix);
    solve(matrix);
    try_full_step();
    search();
  }

  // Tension of cable i in lane l after the full step: the answer, once the lane has converged or settled.
  Real tension(int i, int l) const {
    const Real wanted = read<Real>(wanted_[i], l) + read<Real>(along_[i], l);
    return smaller(larger(wanted, read<Real>(lower[i], l)), read<Real>(upper[i], l));
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr bool kDouble = kUlp < Real(1e-10);
  static constexpr Real kConverged = 4096 * kUlp;  // error of a rendered wrench, against wrench and tensions
  // Least pivots of the factorisation, against the diagonal of W W': at first, what a step leaves of them, and to
  // finish with. While the free set is still being found, large ones keep steps short; proximal steps need none.
  static constexpr Real kLoose = Real(1e-3), kTighten = Real(0.1), kTight = 4096 * kUlp, kSafe = 8 * kUlp;
  // Proximal weight, against the largest entry of that diagonal: at first, how fast it falls, and its floors.
  static constexpr Real kProximal = kDouble ? Real(1e-5) : Real(1e-2), kProximalFall = Real(0.03);
  static constexpr Real kProximalFloor = 64 * kUlp, kProximalShare = kProximal / 10;
  // Line search: rounds, slope of a root against the first slope, and beyond all breakpoints.
  static constexpr int kSearchRounds = 2 * M + 8;
  static constexpr Real kRoot = kDouble ? Real(1e-9) : Real(1e-4), kFar = Real(1e30);

  // Tensions, residual and the matrix of the step at the current dual point.
  void linearise(V (&matrix)[N][N]) {
    const V zero = V{};
    V residual[N], dual[N], largest = zero;
    for (int k = 0; k < N; ++k) {
      residual[k] = wrench[k];
      dual[k] = dual_[k];
      for (int j = 0; j <= k; ++j) matrix[k][j] = zero;
    }
    const auto start = all_free_ > zero;
    for (int i = 0; i < m_; ++i) {
      const V* column = structure[i];
      V wanted = reference[i];
      for (int k = 0; k < N; ++k) wanted += column[k] * dual[k];
      const V tension = smaller(larger(wanted, lower[i]), upper[i]);
      wanted_[i] = wanted;
      largest = larger(largest, larger(magnitude(tension), magnitude(reference[i])));
      const auto free = start | ((wanted > lower[i]) & (wanted < upper[i]));
      for (int k = 0; k < N; ++k) {
        residual[k] -= column[k] * tension;
        const V part = free ? column[k] : zero;
        for (int j = 0; j <= k; ++j) matrix[k][j] += part * column[j];
      }
    }
    size_ = gain_ * largest;
    size_ = larger(size_, smaller(asked, V(gain_ * strongest)));
    for (int k = 0; k < N; ++k) {
      residual_[k] = residual[k];
      gradient_[k] = residual[k] - proximal_ * (dual_[k] - centre_[k]);
      matrix[k][k] += proximal_;
    }
    all_free_ = zero;
  }

  // The step p from H p = g, where g is the gradient of the dual and H = L D L' with its pivots D kept positive.
  void solve(V (&matrix)[N][N]) {
    const V zero = V{};
    V factor[N][N], inverse[N], y[N];  // L, 1 / D
    V regularised = zero;
    for (int k = 0; k < N; ++k) {
      V sum = gradient_[k], d = matrix[k][k];
      for (int j = 0; j < k; ++j) {
        V entry = matrix[k][j];
        for (int i = 0; i < j; ++i) entry -= matrix[k][i] * factor[j][i];
        matrix[k][j] = entry;  // L D
        factor[k][j] = entry * inverse[j];
        sum -= factor[k][j] * y[j];
        d -= entry * factor[k][j];
      }
      const V pivot = larger(d, V(looseness_ * diagonal_[k]));
      inverse[k] = Real(1) / pivot;
      y[k] = sum;
      const V z = sum * inverse[k];
      regularised += (pivot - d) * z * z;
    }
    V p[N], slope = zero, square = zero;
    for (int k = N - 1; k >= 0; --k) {
      p[k] = y[k] * inverse[k];
      for (int j = k + 1; j < N; ++j) p[k] -= factor[j][k] * p[j];
      direction[k] = p[k];
      slope += p[k] * gradient_[k];
      square += p[k] * p[k];
    }
    slope_ = slope;
    curvature_ = regularised + proximal_ * square;
  }

  // Try the full step: is the residual there nought, or as before? And does p separate w?
  void try_full_step() {
    const V zero = V{}, one = zero + Real(1);
    V p[N], residual[N], support = zero, norm = zero, pull = zero, error = zero, change = zero;
    wrench_along_ = zero;
    for (int k = 0; k < N; ++k) {
      p[k] = direction[k];
      residual[k] = wrench[k];
      wrench_along_ += p[k] * wrench[k];
      pull += p[k] * (dual_[k] - centre_[k]);
      norm = larger(norm, magnitude(p[k]));
    }
    V bend = curvature_;
    for (int i = 0; i < m_; ++i) {
      const V* column = structure[i];
      V along = zero;
      for (int k = 0; k < N; ++k) along += column[k] * p[k];
      along_[i] = along;
      const V wanted = wanted_[i] + along;
      const V tension = smaller(larger(wanted, lower[i]), upper[i]);
      for (int k = 0; k < N; ++k) residual[k] -= column[k] * tension;
      const auto free = (wanted > lower[i]) & (wanted < upper[i]);
      bend += free ? V(along * along) : zero;
      support += larger(V(along * lower[i]), V(along * upper[i]));
    }
    separated = wrench_along_ - support - kConverged * size_ * norm;
    wrench_along_ -= proximal_ * pull;
    V slope = -proximal_ * pull - curvature_, largest = zero;
    for (int k = 0; k < N; ++k) {
      largest = larger(largest, magnitude(V(dual_[k] + p[k])));
      slope += p[k] * residual[k];
      error = larger(error, magnitude(residual[k]));
      change = larger(change, magnitude(V(residual[k] - residual_[k])));
    }
    // What rounding leaves of a wrench: the multiplier of an unreachable one grows with every step.
    const V noise = 4 * kUlp * (size_ + gain_ * gain_ * largest);
    root_ = kRoot * slope_ + noise * norm;
    full_step_ = magnitude(slope) <= root_ ? one : zero;
    converged = error <= kConverged * size_ ? one : zero;
    // Nearest: the residual no longer changes, and no tension could still move along it.
    const V gap = support - wrench_along_ + slope + curvature_;
    settled = (change <= 4 * noise) & (gap <= 4 * noise * norm) ? full_step_ * centred_ : zero;
    error_ = error;
    full_slope_ = slope;
    full_bend_ = bend;
  }

  // The root of the dual slope along p, which is piecewise linear and falls: Newton steps inside a bracket, from
  // breakpoint to breakpoint where they leave it.
  void search() {
    const V zero = V{}, one = zero + Real(1);
    V low = zero, low_slope = slope_, high = zero + kFar, high_slope = zero - one, step = one;
    V slope = full_slope_, bend = full_bend_;
    auto open = (slope_ > zero) & (full_step_ == zero);
    for (int round = 0; round < kSearchRounds && any(open); ++round) {
      const auto left = slope > zero;
      low = left ? step : low;
      low_slope = left ? slope : low_slope;
      high = left ? high : step;
      high_slope = left ? high_slope : slope;
      V next = step + slope / bend;
      const auto astray = (next <= low) | (next >= high);
      if (any(open & astray)) next = astray ? next_breakpoint(low, low_slope, high, high_slope) : next;
      const auto inside = (next > low) & (next < high);
      step = open ? (inside ? next : low) : step;
      open = open & inside;
      slope = wrench_along_ - curvature_ * step;
      bend = curvature_;
      for (int i = 0; i < m_; ++i) {
        const V wanted = wanted_[i] + step * along_[i];
        const V tension = smaller(larger(wanted, lower[i]), upper[i]);
        slope -= along_[i] * tension;
        const auto free = (wanted > lower[i]) & (wanted < upper[i]);
        bend += free ? V(along_[i] * along_[i]) : zero;
      }
      open = open & (magnitude(slope) > root_);
    }
    const auto full = full_step_ > zero;
    for (int k = 0; k < N; ++k) {
      dual_[k] += step * direction[k];
      centre_[k] = full ? dual_[k] : centre_[k];
    }
    // A multiplier that still has far to go, or that converges slowly, wants less proximity; but no less than
    // keeps the rounding of t small where the wrench is far out of reach.
    const V least = gain_ * gain_ * larger(V(zero + kProximalFloor), V(kProximalShare * error_ / size_));
    const V less = smaller(proximal_, larger(V(kProximalFall * proximal_), least));
    proximal_ = full & (centred_ > zero) ? less : proximal_;
    centred_ = full_step_;
    looseness_ = smaller(looseness_, larger(V(zero + kTight), V(kTighten * looseness_)));
    looseness_ = full ? smaller(looseness_, V(zero + kTight)) : looseness_;
  }

  // The first breakpoint inside the bracket; where there is none the slope is linear, and its root is known.
  V next_breakpoint(const V& low, const V& low_slope, const V& high, const V& high_slope) const {
    const V zero = V{};
    V first = high;
    for (int i = 0; i < m_; ++i) {
      const V pace = Real(1) / (along_[i] == zero ? zero + Real(1) / kFar : along_[i]);
      const V at_lower = (lower[i] - wanted_[i]) * pace, at_upper = (upper[i] - wanted_[i]) * pace;
      first = (at_lower > low) & (at_lower < first) ? at_lower : first;
      first = (at_upper > low) & (at_upper < first) ? at_upper : first;
    }
    const V root = (low * high_slope - high * low_slope) / (high_slope - low_slope);
    return first < high ? first : root;
  }

  int m_;
  V dual_[N] = {}, centre_[N] = {}, residual_[N] = {}, gradient_[N] = {};
  V wanted_[M] = {}, along_[M] = {};
  V diagonal_[N] = {}, gain_ = {}, looseness_ = {}, proximal_ = {};  // scales and weights of the lane's problem
  V size_ = {}, error_ = {}, root_ = {};                             // what errors are measured against
  V slope_ = {}, curvature_ = {}, full_slope_ = {}, full_bend_ = {}, wrench_along_ = {};
  V full_step_ = {}, centred_ = {}, all_free_ = {};
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
