// The exact tension solver: dual Newton with an exact line search, L problems side by side.
//
//   minimise |t - t0|^2 / 2   subject to   W t = w,  a <= t <= b
//
// The dual has one variable for each of the n wrench components: t(y) = clip(t0 + W' y, a, b), and y is optimal
// where r(y) = w - W t(y) vanishes. A Newton step solves (W_F W_F') p = r over the free cables F. Along p the
// slope of the dual, p'r, is piecewise linear and falling, so its root is found exactly. (Qi & Sun 1993 for the
// semismooth method; Kunisch & Rendl 2003 for box-constrained quadratic programs.)
//
// If some p has p'w > h(p) = sum_i max(p'W_i a_i, p'W_i b_i), no tensions inside the limits render w: p separates
// it from the available wrench set. Then the policy takes over:
//   force      the same iteration with H = W_F W_F' + eps I is the method of multipliers, which converges to
//              the nearest reachable wrench and, among its tensions, to those closest to t0, at a linear rate
//              proportional to eps (Chiche & Gilbert 2016);
//   tension    the same on B W, B w with B from the singular values of W;
//   direction  any separating d shows s <= h(d) / d'w. Solving for the nearest wrench to s w gives the next d; s
//              falls to the answer from above (Newton's method on the convex distance from s w to the set).
//
// No heap, no exceptions; Real may be float, L may be 1: the firmware compiles this file as it is.
#pragma once

#include <cmath>
#include <limits>

#include "lanes.hpp"
#include "linear.hpp"

namespace tensionlab {

enum class Policy { force, tension, direction };

inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class Newton {
 public:
  using V = Lanes<Real, L>;

  // One problem, all pointers to contiguous numbers. structure is n x m, row by row.
  struct Problem {
    const Real *structure, *wrench, *lower, *upper, *reference;
  };

  // m cables; weight_roots: square roots of the n wrench weights.
  Newton(int m, const Real* weight_roots, Policy policy, Real rank_tolerance)
      : m_(m), policy_(policy), rank_tolerance_(rank_tolerance) {
    for (int k = 0; k < N; ++k) weight_roots_[k] = weight_roots[k];
    for (int l = 0; l < L; ++l) park(l);
  }

  // Give lane l a problem whose numbers are all zero, so that it rests.
  void park(int l) {
    const Real zeros[N * M] = {};
    load(l, {zeros, zeros, zeros, zeros, zeros});
  }

  void load(int l, const Problem& problem) {
    Control& control = control_[l];
    control = Control{};
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < m_; ++i) {
        lane<Real>(structure_[i][k], l) = weight_roots_[k] * problem.structure[k * m_ + i];
      }
      control.wrench[k] = weight_roots_[k] * problem.wrench[k];
      control.basis[k][k] = weight_roots_[k];
      lane<Real>(wrench_[k], l) = control.wrench[k];
      lane<Real>(dual_[k], l) = lane<Real>(centre_[k], l) = 0;
    }
    for (int i = 0; i < m_; ++i) {
      lane<Real>(lower_[i], l) = problem.lower[i];
      lane<Real>(upper_[i], l) = problem.upper[i];
      lane<Real>(reference_[i], l) = problem.reference[i];
    }
    prepare(l);
    lane<Real>(all_free_, l) = 1;
  }

  // One Newton step in every lane.
  void step() {
    linearise();
    factorise();
    try_full_step();
    search();
  }

  // Whether lane l is done; moves it to its next stage where there is one. Call after step().
  bool finished(int l) {
    Control& control = control_[l];
    ++control.iterations;
    ++control.in_stage;
    if (lane<Real>(converged_, l) != 0) return true;
    const bool separated = lane<Real>(separated_, l) > 0;
    Real d[N];
    for (int k = 0; k < N; ++k) d[k] = lane<Real>(direction_[k], l);
    if (control.stage == Stage::render) {
      if (!separated && control.in_stage < kRenderLimit) return false;
      const bool first = control.scale == Real(1);  // a rough cut comes for nothing; later ones must be good
      if (separated && first && policy_ == Policy::direction && cut(l, d)) return false;
      approach(l);
      return false;
    }
    if (lane<Real>(settled_, l) == 0 && control.in_stage < kNearestLimit) return false;
    if (policy_ == Policy::direction && !control.hopeless) {
      return control.iterations >= kIterationLimit || !cut(l, d);
    }
    if (!control.hopeless) keep(l, d);
    return true;
  }

  // The answer of lane l: tensions (m), a separating direction or zeros (n). Returns the iterations spent.
  int store(int l, Real* tensions, Real* separation) const {
    const Control& control = control_[l];
    for (int i = 0; i < m_; ++i) {
      const Real wanted = read(wanted_[i], l) + read(along_[i], l);
      tensions[i] = smaller(larger(wanted, read(lower_[i], l)), read(upper_[i], l));
    }
    for (int k = 0; k < N; ++k) {
      separation[k] = 0;
      for (int j = 0; j < N; ++j) separation[k] += control.basis[j][k] * control.separation[j];
    }
    return control.iterations;
  }

  // Never reached in the tests' millions of problems; a problem that does keeps its best answer so far.
  static constexpr int kRenderLimit = 100, kNearestLimit = 200, kIterationLimit = 1000;

 private:
  // render: look for W t = s w. nearest: as close to s w as the limits allow. (s is 1 but for the direction policy.)
  enum class Stage { render, nearest };

  // What the lanes do not share: the rare decisions, in plain numbers.
  struct Control {
    Stage stage = Stage::render;
    int iterations = 0, in_stage = 0;
    Real wrench[N] = {};      // as asked
    Real separation[N] = {};  // the best direction found so far
    Real scale = 1;           // s of the direction policy
    Real below = -1, above = 1;  // where s w was too short (if ever), and where it was still too long
    bool hopeless = false;       // no s keeps the direction
    Real basis[N][N] = {};       // lane coordinates = basis * wrench coordinates
  };

  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr Real kConverged = 4096 * kUlp;   // of the residual, against wrench and tensions
  static constexpr Real kLoose = Real(1e-3);        // least pivots while the free set is still being found
  static constexpr Real kTighten = Real(0.1);       // what a step leaves of them
  static constexpr Real kTight = 4096 * kUlp;       // least pivots to finish with
  static constexpr Real kProximal = kUlp < Real(1e-10) ? Real(1e-5) : Real(1e-2);

  static constexpr Real kLeastProximal = 64 * kUlp;
  static constexpr Real kProximalShare = kProximal / 10;
  static constexpr Real kProximalFall = Real(0.03);

  static Real read(const V& v, int l) { return lane<Real>(const_cast<V&>(v), l); }

  // Scales of the lane's matrix; called whenever the matrix changes.
  void prepare(int l) {
    Real largest = 0;
    for (int k = 0; k < N; ++k) {
      Real square = 0;
      for (int i = 0; i < m_; ++i) {
        const Real entry = lane<Real>(structure_[i][k], l);
        square += entry * entry;
      }
      lane<Real>(diagonal_[k], l) = square > 0 ? square : Real(1);
      if (square > largest) largest = square;
    }
    largest = largest > 0 ? largest : Real(1);
    lane<Real>(gain_, l) = std::sqrt(largest);
    const bool render = control_[l].stage == Stage::render;
    lane<Real>(looseness_, l) = render ? kLoose : 8 * kUlp;
    lane<Real>(proximal_, l) = render ? Real(0) : kProximal * largest;
  }

  // Tensions, residual and the matrix of the step at the current dual point.
  void linearise() {
    const V zero = V{};
    V residual[N], largest = zero;
    for (int k = 0; k < N; ++k) {
      residual[k] = wrench_[k];
      for (int j = 0; j <= k; ++j) matrix_[k][j] = zero;
    }
    const auto start = all_free_ > zero;
    for (int i = 0; i < m_; ++i) {
      const V* column = structure_[i];
      V wanted = reference_[i];
      for (int k = 0; k < N; ++k) wanted += column[k] * dual_[k];
      const V tension = smaller(larger(wanted, lower_[i]), upper_[i]);
      wanted_[i] = wanted;
      largest = larger(largest, magnitude(tension));
      const auto free = start | ((wanted > lower_[i]) & (wanted < upper_[i]));
      for (int k = 0; k < N; ++k) {
        residual[k] -= column[k] * tension;
        const V part = free ? column[k] : zero;
        for (int j = 0; j <= k; ++j) matrix_[k][j] += part * column[j];
      }
    }
    V size = gain_ * largest;
    for (int k = 0; k < N; ++k) {
      size = larger(size, magnitude(wrench_[k]));
      residual_[k] = residual[k];
      gradient_[k] = residual[k] - proximal_ * (dual_[k] - centre_[k]);
      matrix_[k][k] += proximal_;
    }
    size_ = size;
    all_free_ = zero;
  }

  // p from H p = g, the gradient of the dual, with H = L D L' and the pivots D kept positive; the slope p'g along p.
  void factorise() {
    const V zero = V{};
    V pivot[N], y[N];
    V regularised = zero;
    for (int k = 0; k < N; ++k) {
      V sum = gradient_[k];
      for (int j = 0; j < k; ++j) {
        V entry = matrix_[k][j];
        for (int i = 0; i < j; ++i) entry -= matrix_[k][i] * factor_[j][i];
        matrix_[k][j] = entry;            // L D
        factor_[k][j] = entry / pivot[j];  // L
        sum -= factor_[k][j] * y[j];
      }
      V d = matrix_[k][k];
      for (int j = 0; j < k; ++j) d -= matrix_[k][j] * factor_[k][j];
      const V least = looseness_ * diagonal_[k];
      pivot[k] = larger(d, least);
      y[k] = sum;
      const V z = sum / pivot[k];
      regularised += (pivot[k] - d) * z * z;
    }
    V slope = zero, square = zero;
    for (int k = N - 1; k >= 0; --k) {
      V p = y[k] / pivot[k];
      for (int j = k + 1; j < N; ++j) p -= factor_[j][k] * direction_[j];
      direction_[k] = p;
      slope += p * gradient_[k];
      square += p * p;
    }
    slope_ = slope;
    curvature_ = regularised + proximal_ * square;
  }

  // Try the full step: is the residual there nought, or as before? And does p separate w?
  void try_full_step() {
    const V zero = V{}, one = zero + Real(1);
    V residual[N], support = zero, norm = zero, pull = zero, error = zero, change = zero;
    wrench_along_ = zero;
    for (int k = 0; k < N; ++k) {
      residual[k] = wrench_[k];
      wrench_along_ += direction_[k] * wrench_[k];
      pull += direction_[k] * (dual_[k] - centre_[k]);
      norm = larger(norm, magnitude(direction_[k]));
    }
    V bend = curvature_;
    for (int i = 0; i < m_; ++i) {
      const V* column = structure_[i];
      V along = zero;
      for (int k = 0; k < N; ++k) along += column[k] * direction_[k];
      along_[i] = along;
      const V wanted = wanted_[i] + along;
      const V tension = smaller(larger(wanted, lower_[i]), upper_[i]);
      for (int k = 0; k < N; ++k) residual[k] -= column[k] * tension;
      const auto free = (wanted > lower_[i]) & (wanted < upper_[i]);
      bend += free ? V(along * along) : zero;
      support += larger(V(along * lower_[i]), V(along * upper_[i]));
    }
    separated_ = wrench_along_ - support - kConverged * size_ * norm;
    wrench_along_ -= proximal_ * pull;
    V slope = -proximal_ * pull - curvature_, largest = zero;
    for (int k = 0; k < N; ++k) {
      largest = larger(largest, magnitude(V(dual_[k] + direction_[k])));
      slope += direction_[k] * residual[k];
      error = larger(error, magnitude(residual[k]));
      change = larger(change, magnitude(V(residual[k] - residual_[k])));
    }
    // What rounding leaves of a wrench: the multiplier of an unreachable one grows with every step.
    const V noise = 4 * kUlp * (size_ + gain_ * gain_ * largest);
    root_ = kRoot * slope_ + noise * norm;
    full_step_ = magnitude(slope) <= root_ ? one : zero;
    converged_ = error <= kConverged * size_ ? one : zero;
    // Nearest: the residual no longer changes, and no tension could still move along it.
    const V gap = support - wrench_along_ + slope + curvature_;
    settled_ = (change <= 4 * noise) & (gap <= 4 * noise * norm) ? full_step_ * centred_ : zero;
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
        const V tension = smaller(larger(wanted, lower_[i]), upper_[i]);
        slope -= along_[i] * tension;
        const auto free = (wanted > lower_[i]) & (wanted < upper_[i]);
        bend += free ? V(along_[i] * along_[i]) : zero;
      }
      open = open & (magnitude(slope) > root_);
    }
    const auto full = full_step_ > zero;
    for (int k = 0; k < N; ++k) {
      dual_[k] += step * direction_[k];
      centre_[k] = full ? dual_[k] : centre_[k];
    }
    // A multiplier that still has far to go, or that converges slowly, wants less proximity; but no less than
    // keeps the rounding of t small where the wrench is far out of reach.
    const V least = gain_ * gain_ * larger(V(zero + kLeastProximal), V(kProximalShare * error_ / size_));
    const V lower = smaller(proximal_, larger(V(kProximalFall * proximal_), least));
    proximal_ = full & (centred_ > zero) ? lower : proximal_;
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
      const V at_lower = (lower_[i] - wanted_[i]) * pace, at_upper = (upper_[i] - wanted_[i]) * pace;
      first = (at_lower > low) & (at_lower < first) ? at_lower : first;
      first = (at_upper > low) & (at_upper < first) ? at_upper : first;
    }
    const V root = (low * high_slope - high * low_slope) / (high_slope - low_slope);
    return first < high ? first : root;
  }

  static constexpr int kSearchRounds = 2 * M + 8;
  static constexpr Real kRoot = kUlp < Real(1e-10) ? Real(1e-9) : Real(1e-4);
  static constexpr Real kFar = Real(1e30);

  // Seek the reachable wrench nearest to s w.
  void approach(int l) {
    if (policy_ == Policy::tension) whiten(l);
    restart(l, Stage::nearest);
  }

  // Begin a stage at the multiplier zero.
  void restart(int l, Stage stage) {
    Control& control = control_[l];
    control.stage = stage;
    control.in_stage = 0;
    for (int k = 0; k < N; ++k) {
      lane<Real>(wrench_[k], l) = control.scale * control.wrench[k];
      lane<Real>(dual_[k], l) = lane<Real>(centre_[k], l) = 0;
    }
    prepare(l);
    lane<Real>(all_free_, l) = 1;
    lane<Real>(centred_, l) = 1;
  }

  // Lane coordinates in which the rows of W are orthonormal.
  void whiten(int l) {
    Control& control = control_[l];
    Real columns[M * N], w[N];
    for (int k = 0; k < N; ++k) {
      for (int i = 0; i < m_; ++i) columns[i * N + k] = lane<Real>(structure_[i][k], l) / weight_roots_[k];
      w[k] = control.wrench[k] / weight_roots_[k];
    }
    const Whitening<Real, N, M> whitening(columns, N, m_, rank_tolerance_);
    for (int r = 0; r < N; ++r) {
      for (int k = 0; k < N; ++k) control.basis[r][k] = r < whitening.rank ? whitening.rows[r][k] : Real(0);
      control.wrench[r] = dot(control.basis[r], w);
      for (int i = 0; i < m_; ++i) lane<Real>(structure_[i][r], l) = dot(control.basis[r], columns + i * N);
    }
  }

  // d, of unit length, is the best separating direction so far.
  void keep(int l, const Real* d) {
    const Real length = std::sqrt(dot(d, d));
    for (int k = 0; k < N; ++k) control_[l].separation[k] = length > 0 ? d[k] / length : Real(0);
  }

  // d separates s w from what can be rendered: take the next s. Returns false if s can fall no further.
  bool cut(int l, const Real* d) {
    Control& control = control_[l];
    const Real dw = dot(d, control.wrench), reach = support(l, d);
    if (reach < (dw < 0 ? dw : Real(0))) {
      // d separates all of the segment from 0 to w, and the nearest wrench to w is what remains.
      keep(l, d);
      control.hopeless = true;
      control.scale = 1;
      approach(l);
      return true;
    }
    // Beyond reach / dw no scale will do. If s w is too short, none will: a direction in between proves it.
    (dw > 0 ? control.above : control.below) = control.scale;
    const Real next = control.below < 0 ? reach / dw : (control.below + control.above) / 2;
    if (!(next < control.above)) return false;
    if (dw > 0) keep(l, d);
    control.scale = next;
    restart(l, Stage::render);
    return true;
  }

  Real support(int l, const Real* d) const {
    Real sum = 0;
    for (int i = 0; i < m_; ++i) {
      Real along = 0;
      for (int k = 0; k < N; ++k) along += d[k] * read(structure_[i][k], l);
      sum += along * (along > 0 ? read(upper_[i], l) : read(lower_[i], l));
    }
    return sum;
  }

  static Real dot(const Real* x, const Real* y) {
    Real sum = 0;
    for (int k = 0; k < N; ++k) sum += x[k] * y[k];
    return sum;
  }

  int m_;
  Policy policy_;
  Real rank_tolerance_;
  Real weight_roots_[N];
  V structure_[M][N], lower_[M], upper_[M], reference_[M];
  V wrench_[N], dual_[N], centre_[N], residual_[N], gradient_[N], direction_[N];
  V wanted_[M], along_[M];
  V matrix_[N][N], factor_[N][N];
  V diagonal_[N], gain_, size_, looseness_, proximal_, slope_, curvature_, wrench_along_, full_slope_, full_bend_, root_;
  V error_, converged_, settled_, separated_, full_step_, centred_, all_free_;
  Control control_[L];
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
