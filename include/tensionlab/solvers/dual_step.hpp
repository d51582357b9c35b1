// Newton's method on the dual of a tension problem, one trial point a step, in every lane at once.
//
// The dual has one variable y for each of the n wrench components. Its tensions are t(y) = clip(t0 + W' y, a, b),
// its gradient is r(y) = w - W t(y), and H = W_F W_F', over the cables F inside their limits, is its curvature.
// A step evaluates all of these at a trial point. Where the slope along the last direction p has fallen far
// enough, the point is taken and the next direction solves H p = r; elsewhere the next trial is the point along p
// where the slope, which is piecewise linear and falls, is zero.
//
// With a proximal weight eps the steps maximise the dual less eps |y - c|^2 / 2, and the centre c follows each
// maximum: the method of multipliers, which also converges where no tensions render w.
#pragma once

#include <limits>

#include "tensionlab/simd/lane_problem.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// Exact line search: the maximum of the dual along a path, in every lane at once.
//
// The slope is piecewise linear and falls, so that its root lies between two breakpoints, where a cable reaches or
// leaves a limit. Newton steps inside a bracket find that piece; where they leave the bracket, the next breakpoint
// is taken.

template <class Real, int L, int N, int M>
class LineSearch {
 public:
  using V = Lanes<Real, L>;

  // wanted: tensions without limits at step 1 along the path. pull and curvature: at step s the slope is
  // pull - curvature (s - 1) less the sum of tension times W_i'path.
  LineSearch(const LaneProblems<Real, L, N, M>& problem, const V (&wanted)[M], const V (&path)[N], const V& pull,
             const V& curvature)
      : problem_(problem), wanted_(wanted), pull_(pull), curvature_(curvature) {
    bend_at_one_ = curvature;
    for (int i = 0; i < problem.m; ++i) {
      along_[i] = problem.along(i, path);
      const auto free = (wanted[i] > problem.lower[i]) & (wanted[i] < problem.upper[i]);
      bend_at_one_ += free ? V(along_[i] * along_[i]) : V{};
    }
  }

  // The step where the slope is zero or negligible, in the open lanes; 1 in the others. first: the slope at step
  // 0, which is positive.
  template <class Mask>
  V root(const V& first, const V& slope_at_one, const V& negligible, const Mask& open_lanes) const {
    const V zero = V{}, one = zero + Real(1);
    V step = one, slope = slope_at_one, bend = bend_at_one_;
    V low = zero, low_slope = first, high = zero + kFar, high_slope = zero - one;
    auto open = open_lanes;
    for (int round = 0; round < kRounds && any(open); ++round) {
      const auto left = slope > zero;
      low = left ? step : low;
      low_slope = left ? slope : low_slope;
      high = left ? high : step;
      high_slope = left ? high_slope : slope;
      V next = step + slope / bend;
      const auto outside = (next <= low) | (next >= high);
      if (any(open & outside)) next = outside ? next_breakpoint(low, low_slope, high, high_slope) : next;
      const auto inside = (next > low) & (next < high);
      step = open ? (inside ? next : low) : step;
      open = open & inside;
      slope = pull_ - curvature_ * (step - one);
      bend = curvature_;
      for (int i = 0; i < problem_.m; ++i) {
        const V wanted = wanted_[i] + (step - one) * along_[i];
        const V tension = smaller(larger(wanted, problem_.lower[i]), problem_.upper[i]);
        slope -= along_[i] * tension;
        const auto free = (wanted > problem_.lower[i]) & (wanted < problem_.upper[i]);
        bend += free ? V(along_[i] * along_[i]) : zero;
      }
      open = open & (magnitude(slope) > negligible);
    }
    return step;
  }

 private:
  static constexpr int kRounds = 2 * M + 8;
  static constexpr Real kFar = Real(1e9);  // beyond all breakpoints

  // The first breakpoint inside the bracket; without one the slope is linear there, and its root is known.
  V next_breakpoint(const V& low, const V& low_slope, const V& high, const V& high_slope) const {
    const V zero = V{}, one = zero + Real(1);
    V first = high;
    for (int i = 0; i < problem_.m; ++i) {
      const V pace = one / (along_[i] == zero ? zero + Real(1e-30) : along_[i]);
      const V at_lower = one + (problem_.lower[i] - wanted_[i]) * pace;
      const V at_upper = one + (problem_.upper[i] - wanted_[i]) * pace;
      first = ((at_lower > low) & (at_lower < first)) ? at_lower : first;
      first = ((at_upper > low) & (at_upper < first)) ? at_upper : first;
    }
    const V root = (low * high_slope - high * low_slope) / (high_slope - low_slope);
    return first < high ? first : root;
  }

  const LaneProblems<Real, L, N, M>& problem_;
  const V (&wanted_)[M];
  V along_[M], pull_, curvature_, bend_at_one_;
};

template <class Real, int L, int N, int M>
class DualStep {
 public:
  using V = Lanes<Real, L>;

  explicit DualStep(int m) : problem_(m) {}

  // Results of step(): flags, 1 or 0, with any of the others in `found`; direction separates, or is that of the
  // residual that settled.
  V direction[N] = {}, converged = {}, settled = {}, separated = {}, found = {};

  // Begins to look for tensions that render the wrench, in lane l.
  void render(int l, const Problem<Real>& source) {
    source_[l] = source;
    begun_[l] = kRender;
    stale_ = true;
  }

  // Begins to look for the tensions whose wrench is nearest, in lane l, from the multiplier y.
  void approach(int l, const Problem<Real>& source, const Real* y) {
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
    return smaller(larger(read<Real>(wanted_[i], l), read<Real>(problem_.lower[i], l)),
                   read<Real>(problem_.upper[i], l));
  }

  const Problem<Real>& source(int l) const { return source_[l]; }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr bool kDouble = kUlp < Real(1e-10);
  // Error of a rendered wrench, as a share of wrench and tensions. One that is only close gets another step: where
  // W is nearly singular, the error of the tensions is much larger.
  static constexpr Real kClose = (kDouble ? 4096 : 64) * kUlp, kConverged = 64 * kUlp;
  // Least pivots of the factorisation, as shares of the diagonal of W W': first ones, with few cables and with
  // many; their reduction by a step; last ones; those of proximal steps. While the free set is still being found,
  // large ones keep steps short, more so with many cables, of which too few may be free for a while.
  static constexpr Real kLoose = Real(1e-3), kLooser = Real(0.2), kTighten = Real(0.1), kTight = 4096 * kUlp,
                        kSafe = 8 * kUlp;
  // Proximal weight, as a share of the largest entry of that diagonal: first value, reduction, and floors, which
  // bound the effect of rounding errors of the wrench on the tensions.
  static constexpr Real kProximal = kDouble ? Real(1e-5) : Real(0.1), kProximalFall = Real(0.03);
  static constexpr Real kProximalFloor = (kDouble ? 64 : 16384) * kUlp, kProximalShare = kProximal / 10;
  // Line search: the share of the first slope that is accepted, and the one that the search reaches.
  static constexpr Real kFlat = Real(0.5), kRoot = kDouble ? Real(1e-9) : Real(1e-4);
  static constexpr Real kRender = 1, kNearest = 2;

  // Loads the lanes' problems, and initialises the new ones.
  void reload() {
    const V zero = V{}, one = zero + Real(1);
    problem_.load(source_);
    least_size_ = smaller(problem_.desired, V(problem_.gain * problem_.strongest));
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
    close_ = fresh ? zero : close_;
    proximal_ = fresh ? (nearest ? kProximal * problem_.gain * problem_.gain : zero) : proximal_;
    least_pivot_ = fresh ? zero + (problem_.m < 2 * N ? kLoose : kLooser) : least_pivot_;
    unseen_ = fresh ? (nearest ? one : zero + Real(2)) : unseen_;
    for (int l = 0; l < L; ++l) begun_[l] = 0;
    stale_ = false;
  }

  // Evaluates tensions, residual and curvature at the trial point. In a new lane all cables count as free.
  void evaluate(V (&matrix)[N][N], V (&residual)[N]) {
    const V zero = V{};
    // Local copies, which cannot alias members and stay in registers.
    V trial[N], h[N][N], r[N], square = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      r[k] = problem_.wrench[k];
      trial[k] = trial_[k];
      TENSIONLAB_UNROLL
      for (int j = 0; j <= k; ++j) h[k][j] = zero;
    }
    const auto unlimited = unseen_ > zero + Real(1);
    for (int i = 0; i < problem_.m; ++i) {
      const V* column = problem_.structure[i];
      V wanted = problem_.reference[i];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) wanted += column[k] * trial[k];
      wanted_[i] = wanted;
      const V limited = smaller(larger(wanted, problem_.lower[i]), problem_.upper[i]);
      const V tension = unlimited ? wanted : limited;
      const V change = tension - problem_.reference[i];
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
    size_ = larger(V(problem_.gain * (square_root<Real, L>(square) + problem_.furthest)), least_size_);
  }

  // Rates the trial point and chooses the next.
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
    // Rounding error of the wrench: the multiplier of an infeasible one grows with every step.
    const V noise = 4 * kUlp * (size_ + problem_.gain * problem_.gain * furthest);
    const V root = kRoot * first_slope_ + noise * norm;
    const auto close = (error <= kClose * size_) & (unseen_ <= one);
    converged = close & ((error <= kConverged * size_) | (close_ > zero)) ? one : zero;
    close_ = close ? one : zero;
    const auto maximal = (proximal_ > zero) & (steepest <= 4 * noise);
    // The dual is at most the cost of tensions that render w: above a high cost, its multiplier may separate.
    const auto unlikely = (proximal_ == zero) & (unseen_ <= one) & (value > problem_.high_cost);
    const V outside = any(unlikely) ? problem_.separation_margin(trial_) : zero;
    const auto infeasible = unlikely & (outside > zero);
    // Before the root of the slope the dual has grown; beyond it that is checked.
    const auto flat = (magnitude(slope) <= kFlat * first_slope_) & ((slope >= zero) | (value > last_value_));
    const V take =
        ((unseen_ > zero) | maximal | flat | infeasible | close | (magnitude(slope) <= root)) ? one : zero;

    separated = infeasible ? one : zero;
    settled = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) direction[k] = trial_[k];
    V step = one;
    if (any(take == zero)) step = search(slope, root, take);
    if (any(maximal)) recentre(residual, gradient, maximal, noise, error);
    found = converged + separated + settled;

    least_pivot_ = (proximal_ > zero) | close ? zero + kSafe : least_pivot_;
    const auto taken = take > zero;
    const auto rated = taken & (unseen_ == zero);
    const V least = zero + kTight;
    const V tighter = magnitude(slope) <= root ? least : larger(least, V(kTighten * least_pivot_));
    least_pivot_ = rated ? smaller(least_pivot_, tighter) : least_pivot_;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) matrix[k][k] += proximal_;
    V path[N], least_pivot[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) least_pivot[k] = least_pivot_ * problem_.diagonal[k];
    Factor<V, N>(matrix, least_pivot).solve(gradient, path);
    first_slope_ = inner(path, gradient);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      trial_[k] += taken ? path[k] : V((step - one) * path_[k]);
      path_[k] = taken ? path[k] : path_[k];
    }
    last_value_ = taken ? value : last_value_;
    unseen_ = taken ? larger(zero, V(unseen_ - one)) : one;
  }

  // The step to the maximum along the path, where the trial was not taken. Where the dual grows without bound, the
  // path itself separates.
  V search(const V& slope, const V& root, const V& take) {
    const V zero = V{}, one = zero + Real(1);
    V pull = zero, curvature = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      pull += path_[k] * (problem_.wrench[k] - proximal_ * (trial_[k] - centre_[k]));
      curvature += proximal_ * path_[k] * path_[k];
    }
    const auto open = take == zero;
    const V outside = any(open & (slope > zero)) ? problem_.separation_margin(path_) : zero;
    const auto unbounded = open & (proximal_ == zero) & (outside > zero);
    separated = unbounded ? one : separated;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) direction[k] = unbounded ? path_[k] : direction[k];
    return LineSearch<Real, L, N, M>(problem_, wanted_, path_, pull, curvature)
        .root(first_slope_, slope, root, open & !unbounded);
  }

  // At the maximum of a proximal lane: finds whether the residual has settled, and no tension can move along it,
  // and moves the centre there. The proximal weight falls, so that the multiplier converges faster; but not so far
  // that rounding errors of t grow where the wrench is far from feasible.
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
    for (int i = 0; i < problem_.m; ++i) {
      const V along = problem_.along(i, d), lower = problem_.lower[i], upper = problem_.upper[i];
      const V tension = smaller(larger(wanted_[i], lower), upper);
      gap += larger(V(along * (lower - tension)), V(along * (upper - tension)));
    }
    settled = (maximal & (change <= 4 * noise) & (gap <= 4 * noise * norm)) ? one : zero;
    const V least =
        problem_.gain * problem_.gain * larger(V(zero + kProximalFloor), V(kProximalShare * error / size_));
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

  // As given: one entry a lane.
  Problem<Real> source_[L] = {};
  Real start_[N][L] = {}, begun_[L] = {};
  bool stale_ = true;
  // Side by side.
  LaneProblems<Real, L, N, M> problem_;
  V least_size_ = {}, wanted_[M] = {};
  V path_[N] = {}, trial_[N] = {}, centre_[N] = {}, last_[N] = {};
  V close_ = {};  // 1 if the last trial was close
  V first_slope_ = {}, proximal_ = {}, least_pivot_ = {}, size_ = {};
  V value_ = {}, last_value_ = {};  // of the dual
  V unseen_ = {};  // trials that are taken whatever their slope; above 1 they also ignore the limits
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
