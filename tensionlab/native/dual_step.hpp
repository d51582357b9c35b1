// Newton's method on the dual of a tension problem, one trial point a step, in every lane at once.
//
// The dual has one variable y for each of the n wrench components. Its tensions are t(y) = clip(t0 + W' y, a, b),
// its gradient is r(y) = w - W t(y), and H = W_F W_F', over the cables F inside their limits, is its curvature.
// A step evaluates all of these at a trial point. Where the slope along the last direction p has fallen far
// enough, the point is taken and the next direction solves H p = r; elsewhere the next trial is the point along p
// where the slope is nought, which is piecewise linear and falls, so that its root is found exactly.
//
// With a proximal weight eps the steps maximise the dual less eps |y - c|^2 / 2, and the centre c follows each
// maximum: the method of multipliers, which also converges where no tensions render w.
#pragma once

#include <limits>

#include "factor.hpp"
#include "lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class DualStep {
 public:
  using V = Lanes<Real, L>;

  // The numbers of one problem, each array contiguous; structure is n x m, row by row.
  struct Source {
    const Real *structure, *wrench, *lower, *upper, *reference;
  };

  explicit DualStep(int m) : m_(m) {}

  // What step() found. Flags are 1 or 0, any of the others in `found`; direction separates, or is that of the
  // residual which settled.
  V direction[N] = {}, converged = {}, settled = {}, separated = {}, found = {};

  // Look for tensions that render the wrench, in lane l.
  void render(int l, const Source& source) {
    source_[l] = source;
    begun_[l] = kRender;
    stale_ = true;
  }

  // Look for the tensions whose wrench is nearest, in lane l, from the multiplier y.
  void approach(int l, const Source& source, const Real* y) {
    render(l, source);
    begun_[l] = kNearest;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) start_[k][l] = y[k];
  }

  void step() {
    if (stale_) reload();
    V matrix[N][N], residual[N];  // here and not members, so that they may live in registers
    evaluate(matrix, residual);
    advance(matrix, residual);
  }

  // Tension of cable i in lane l: the answer, once the lane has converged or settled.
  Real tension(int i, int l) const {
    return smaller(larger(read<Real>(wanted_[i], l), read<Real>(lower_[i], l)), read<Real>(upper_[i], l));
  }

  const Source& source(int l) const { return source_[l]; }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr bool kDouble = kUlp < Real(1e-10);
  static constexpr Real kConverged = 4096 * kUlp;  // error of a rendered wrench, against wrench and tensions
  // Least pivots of the factorisation, against the diagonal of W W': at first, what a step leaves of them, and to
  // finish with. While the free set is still being found, large ones keep steps short; proximal steps need none.
  // Cables to spare make it likelier that too few of them are free for a while.
  static constexpr Real kLoose = Real(1e-3), kLooser = Real(0.2), kTighten = Real(0.1), kTight = 4096 * kUlp,
                        kSafe = 8 * kUlp;
  // Proximal weight, against the largest entry of that diagonal: at first, how fast it falls, and its floors.
  static constexpr Real kProximal = kDouble ? Real(1e-5) : Real(1e-2), kProximalFall = Real(0.03);
  static constexpr Real kProximalFloor = 64 * kUlp, kProximalShare = kProximal / 10;
  // Line search: what may be left of the first slope, what the search leaves of it, and beyond all breakpoints.
  static constexpr Real kFlat = Real(0.5), kRoot = kDouble ? Real(1e-9) : Real(1e-4), kFar = Real(1e9);
  // How much of the way from the least cost to the greatest is dear; with cables to spare, less is.
  static constexpr Real kDear = Real(0.5), kDearToo = Real(0.35);
  static constexpr int kSearchRounds = 2 * M + 8;
  static constexpr Real kRender = 1, kNearest = 2;

  // Numbers of the lanes' problems, side by side.
  void reload() {
    const V zero = V{}, one = zero + Real(1);
    const Real* row[L];
    V largest = zero, asked = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      V square = zero;
      for (int l = 0; l < L; ++l) row[l] = source_[l].structure + k * m_;
      transpose<Real, L>(row, m_, [&](int i, const V& entry) {
        structure_[i][k] = entry;
        square += entry * entry;
      });
      diagonal_[k] = square > zero ? square : one;
      largest = larger(largest, square);
      wrench_[k] = gather<Real, L>([&](int l) { return source_[l].wrench[k]; });
      asked = larger(asked, magnitude(wrench_[k]));
    }
    gain_ = square_root<Real, L>(largest > zero ? largest : one);
    if (limits_changed()) reload_limits();
    least_size_ = smaller(asked, V(gain_ * strongest_));
    const V begun = gather<Real, L>([&](int l) { return begun_[l]; });
    const auto fresh = begun > zero;
    const auto nearest = begun > one;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      const V start = gather<Real, L>([&](int l) { return start_[k][l]; });
      trial_[k] = fresh ? (nearest ? start : zero) : trial_[k];
      centre_[k] = fresh ? zero : centre_[k];
      path_[k] = fresh ? zero : path_[k];
      last_[k] = fresh ? zero : last_[k];
    }
    proximal_ = fresh ? (nearest ? kProximal * gain_ * gain_ : zero) : proximal_;
    looseness_ = fresh ? zero + (m_ < 2 * N ? kLoose : kLooser) : looseness_;
    unseen_ = fresh ? (nearest ? one : zero + Real(2)) : unseen_;
    for (int l = 0; l < L; ++l) begun_[l] = 0;
    stale_ = false;
  }

  bool limits_changed() {
    bool changed = false;
    for (int l = 0; l < L; ++l) {
      const Source &now = source_[l], &then = limits_of_[l];
      changed = changed || now.lower != then.lower || now.upper != then.upper || now.reference != then.reference;
      limits_of_[l] = now;
    }
    return changed;
  }

  void reload_limits() {
    strongest_ = furthest_ = V{};
    V cheapest = V{}, dearest = V{};
    for (int i = 0; i < m_; ++i) {
      lower_[i] = gather<Real, L>([&](int l) { return source_[l].lower[i]; });
      upper_[i] = gather<Real, L>([&](int l) { return source_[l].upper[i]; });
      reference_[i] = gather<Real, L>([&](int l) { return source_[l].reference[i]; });
      strongest_ = larger(strongest_, larger(V(-lower_[i]), upper_[i]));
      furthest_ = larger(furthest_, magnitude(reference_[i]));
      const V below = lower_[i] - reference_[i], above = reference_[i] - upper_[i];
      const V least = larger(larger(below, above), V{}), most = larger(magnitude(below), magnitude(above));
      cheapest += least * least / 2;
      dearest += most * most / 2;
    }
    dear_ = cheapest + (m_ < 2 * N ? kDear : kDearToo) * (dearest - cheapest);
  }

  // Tensions, residual and curvature at the trial point. A lane that begins takes its cables for free.
  void evaluate(V (&matrix)[N][N], V (&residual)[N]) {
    const V zero = V{};
    V trial[N], h[N][N], r[N],
        square = zero;  // copies that cannot alias the members, so that they stay in registers
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      r[k] = wrench_[k];
      trial[k] = trial_[k];
      TENSIONLAB_UNROLL
      for (int j = 0; j <= k; ++j) h[k][j] = zero;
    }
    const auto unlimited = unseen_ > zero + Real(1);
    for (int i = 0; i < m_; ++i) {
      const V* column = structure_[i];
      V wanted = reference_[i];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) wanted += column[k] * trial[k];
      wanted_[i] = wanted;
      const V limited = smaller(larger(wanted, lower_[i]), upper_[i]);
      const V tension = unlimited ? wanted : limited;
      const V change = tension - reference_[i];
      square += change * change;
      const auto free = tension == wanted;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) {
        r[k] -= column[k] * tension;
        const V part = free ? column[k] : zero;
        TENSIONLAB_UNROLL
        for (int j = 0; j <= k; ++j) h[k][j] += part * column[j];
      }
    }
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      residual[k] = r[k];
      TENSIONLAB_UNROLL
      for (int j = 0; j <= k; ++j) matrix[k][j] = h[k][j];
    }
    value_ = square / 2;
    size_ = larger(V(gain_ * (square_root<Real, L>(square) + furthest_)), least_size_);
  }

  // Judge the trial point and choose the next.
  void advance(V (&matrix)[N][N], const V (&residual)[N]) {
    const V zero = V{}, one = zero + Real(1);
    V gradient[N], error = zero, slope = zero, steepest = zero, furthest = zero, norm = zero, value = value_;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      const V off = trial_[k] - centre_[k];
      gradient[k] = residual[k] - proximal_ * off;
      value += residual[k] * trial_[k] - proximal_ * off * off / 2;
      slope += path_[k] * gradient[k];
      error = larger(error, magnitude(residual[k]));
      steepest = larger(steepest, magnitude(gradient[k]));
      furthest = larger(furthest, magnitude(trial_[k]));
      norm = larger(norm, magnitude(path_[k]));
    }
    // What rounding leaves of a wrench: the multiplier of an unreachable one grows with every step.
    const V noise = 4 * kUlp * (size_ + gain_ * gain_ * furthest);
    const V root = kRoot * first_slope_ + noise * norm;
    converged = (error <= kConverged * size_) & (unseen_ <= one) ? one : zero;
    const auto maximal = (proximal_ > zero) & (steepest <= 4 * noise);
    // No tensions cost more than the dearest: a dual that comes near may well have a multiplier that separates.
    const auto doubtful = (proximal_ == zero) & (unseen_ <= one) & (value > dear_);
    const V outside = any(doubtful) ? how_far_outside(trial_) : zero;
    const auto lost = doubtful & (outside > zero);
    // Before the root of the slope the dual has grown; beyond it that must be seen.
    const auto flat = (magnitude(slope) <= kFlat * first_slope_) & ((slope >= zero) | (value > last_value_));
    const V take = (unseen_ > zero) | maximal | flat | lost | (magnitude(slope) <= root) ? one : zero;

    separated = lost ? one : zero;
    settled = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) direction[k] = trial_[k];
    V step = one;
    if (any(take == zero)) step = root_along_path(slope, root, take);
    if (any(maximal)) recentre(residual, gradient, maximal, noise, error);
    found = converged + separated + settled;

    looseness_ = proximal_ > zero ? zero + kSafe : looseness_;
    const auto taken = take > zero;
    const auto judged = taken & (unseen_ == zero);
    const V least = zero + kTight;
    const V tighter = magnitude(slope) <= root ? least : larger(least, V(kTighten * looseness_));
    looseness_ = judged ? smaller(looseness_, tighter) : looseness_;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) matrix[k][k] += proximal_;
    V path[N], least_pivot[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) least_pivot[k] = looseness_ * diagonal_[k];
    solve_with_pivots(matrix, gradient, least_pivot, path, first_slope_);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      trial_[k] += taken ? path[k] : V((step - one) * path_[k]);
      path_[k] = taken ? path[k] : path_[k];
    }
    last_value_ = taken ? value : last_value_;
    unseen_ = taken ? larger(zero, V(unseen_ - one)) : one;
  }

  // d'w - h(d), less what rounding may make of it: above nought, d separates w from all that can be rendered.
  TENSIONLAB_APART V how_far_outside(const V (&d)[N]) const {
    V sum = V{}, size = V{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      sum += d[k] * wrench_[k];
      size += magnitude(d[k]);
    }
    for (int i = 0; i < m_; ++i) {
      V along = V{};
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) along += structure_[i][k] * d[k];
      sum -= larger(V(along * lower_[i]), V(along * upper_[i]));
    }
    return sum - 16 * kUlp * Real(m_) * gain_ * strongest_ * size;
  }

  // The step at which the slope of the dual along the path is nought: Newton steps inside a bracket, from
  // breakpoint to breakpoint where they leave it.
  V root_along_path(const V& first_slope, const V& root, const V& take) {
    const V zero = V{}, one = zero + Real(1);
    V along[M], pull = zero, curvature = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      pull += path_[k] * (wrench_[k] - proximal_ * (trial_[k] - centre_[k]));
      curvature += proximal_ * path_[k] * path_[k];
    }
    V bend = curvature;
    for (int i = 0; i < m_; ++i) {
      V sum = zero;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) sum += structure_[i][k] * path_[k];
      along[i] = sum;
      const auto free = (wanted_[i] > lower_[i]) & (wanted_[i] < upper_[i]);
      bend += free ? V(sum * sum) : zero;
    }
    V slope = first_slope, step = one;
    V low = zero, low_slope = first_slope_, high = zero + kFar, high_slope = zero - one;
    // Where the dual grows along the path without end, the path separates.
    const V outside = any((take == zero) & (slope > zero)) ? how_far_outside(path_) : zero;
    const auto endless = (take == zero) & (proximal_ == zero) & (outside > zero);
    separated = endless ? one : separated;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) direction[k] = endless ? path_[k] : direction[k];
    auto open = (take == zero) & !endless;
    for (int round = 0; round < kSearchRounds && any(open); ++round) {
      const auto left = slope > zero;
      low = left ? step : low;
      low_slope = left ? slope : low_slope;
      high = left ? high : step;
      high_slope = left ? high_slope : slope;
      V next = step + slope / bend;
      const auto astray = (next <= low) | (next >= high);
      if (any(open & astray)) {
        next = astray ? next_breakpoint(along, low, low_slope, high, high_slope) : next;
      }
      const auto inside = (next > low) & (next < high);
      step = open ? (inside ? next : low) : step;
      open = open & inside;
      slope = pull - curvature * (step - one);
      bend = curvature;
      for (int i = 0; i < m_; ++i) {
        const V wanted = wanted_[i] + (step - one) * along[i];
        const V tension = smaller(larger(wanted, lower_[i]), upper_[i]);
        slope -= along[i] * tension;
        const auto free = (wanted > lower_[i]) & (wanted < upper_[i]);
        bend += free ? V(along[i] * along[i]) : zero;
      }
      open = open & (magnitude(slope) > root);
    }
    return step;
  }

  // The first breakpoint inside the bracket; where there is none the slope is linear, and its root is known.
  V next_breakpoint(const V (&along)[M], const V& low, const V& low_slope, const V& high,
                    const V& high_slope) const {
    const V zero = V{}, one = zero + Real(1);
    V first = high;
    for (int i = 0; i < m_; ++i) {
      const V pace = one / (along[i] == zero ? zero + Real(1e-30) : along[i]);
      const V at_lower = one + (lower_[i] - wanted_[i]) * pace, at_upper = one + (upper_[i] - wanted_[i]) * pace;
      first = (at_lower > low) & (at_lower < first) ? at_lower : first;
      first = (at_upper > low) & (at_upper < first) ? at_upper : first;
    }
    const V root = (low * high_slope - high * low_slope) / (high_slope - low_slope);
    return first < high ? first : root;
  }

  // At the maximum of a proximal lane: could any tension still move along the residual, and does the residual
  // still change? If so move the centre there. A multiplier that still has far to go, or that converges slowly,
  // wants less proximity; but no less than keeps the rounding of t small where the wrench is far out of reach.
  template <class Mask>
  void recentre(const V (&residual)[N], V (&gradient)[N], const Mask& maximal, const V& noise, const V& error) {
    const V zero = V{}, one = zero + Real(1);
    V d[N], norm = zero, change = zero, gap = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      d[k] = trial_[k] - centre_[k];
      change = larger(change, magnitude(V(residual[k] - last_[k])));
      norm = larger(norm, magnitude(d[k]));
    }
    for (int i = 0; i < m_; ++i) {
      V along = zero;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) along += structure_[i][k] * d[k];
      const V tension = smaller(larger(wanted_[i], lower_[i]), upper_[i]);
      gap += larger(V(along * (lower_[i] - tension)), V(along * (upper_[i] - tension)));
    }
    settled = maximal & (change <= 4 * noise) & (gap <= 4 * noise * norm) ? one : zero;
    const V least = gain_ * gain_ * larger(V(zero + kProximalFloor), V(kProximalShare * error / size_));
    const V less = smaller(proximal_, larger(V(kProximalFall * proximal_), least));
    proximal_ = maximal ? less : proximal_;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      direction[k] = maximal ? d[k] : direction[k];
      centre_[k] = maximal ? trial_[k] : centre_[k];
      gradient[k] = maximal ? residual[k] : gradient[k];
      last_[k] = maximal ? residual[k] : last_[k];
    }
  }

  int m_;
  // As given: one entry a lane.
  Source source_[L] = {}, limits_of_[L] = {};
  Real start_[N][L] = {}, begun_[L] = {};
  bool stale_ = true;
  // Side by side.
  V structure_[M][N] = {}, wrench_[N] = {}, lower_[M] = {}, upper_[M] = {}, reference_[M] = {}, wanted_[M] = {};
  V diagonal_[N] = {}, gain_ = {}, strongest_ = {}, furthest_ = {}, dear_ = {},
    least_size_ = {};  // scales of the problem
  V path_[N] = {}, trial_[N] = {}, centre_[N] = {}, last_[N] = {};
  V first_slope_ = {}, proximal_ = {}, looseness_ = {}, size_ = {};
  V value_ = {}, last_value_ = {};  // of the dual
  V unseen_ = {};                   // trials to take whatever their slope; above 1, without limits too
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
