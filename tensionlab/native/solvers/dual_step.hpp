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

#include "simd/lane_problem.hpp"
#include "simd/linear.hpp"
#include "solvers/line_search.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class DualStep {
 public:
  using V = Lanes<Real, L>;

  explicit DualStep(int m) : problem_(m) {}

  // What step() found. Flags are 1 or 0, any of the others in `found`; direction separates, or is that of the
  // residual which settled.
  V direction[N] = {}, converged = {}, settled = {}, separated = {}, found = {};

  // Look for tensions that render the wrench, in lane l.
  void render(int l, const Problem<Real>& source) {
    source_[l] = source;
    begun_[l] = kRender;
    stale_ = true;
  }

  // Look for the tensions whose wrench is nearest, in lane l, from the multiplier y.
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
  // Error of a rendered wrench, against wrench and tensions. One that is only close gets one more step: where W is
  // nearly singular, what is missing of the wrench makes much more of the tensions.
  static constexpr Real kClose = (kDouble ? 4096 : 64) * kUlp, kConverged = 64 * kUlp;
  // Least pivots of the factorisation, against the diagonal of W W': at first, what a step leaves of them, and to
  // finish with. While the free set is still being found, large ones keep steps short; proximal steps need none.
  // Cables to spare make it likelier that too few of them are free for a while.
  static constexpr Real kLoose = Real(1e-3), kLooser = Real(0.2), kTighten = Real(0.1), kTight = 4096 * kUlp,
                        kSafe = 8 * kUlp;
  // Proximal weight, against the largest entry of that diagonal: at first, how fast it falls, and its floors. What
  // rounding leaves of a wrench moves the tensions by so much more.
  static constexpr Real kProximal = kDouble ? Real(1e-5) : Real(0.1), kProximalFall = Real(0.03);
  static constexpr Real kProximalFloor = (kDouble ? 64 : 16384) * kUlp, kProximalShare = kProximal / 10;
  // Line search: what may be left of the first slope, and what the search leaves of it.
  static constexpr Real kFlat = Real(0.5), kRoot = kDouble ? Real(1e-9) : Real(1e-4);
  static constexpr Real kRender = 1, kNearest = 2;

  // The lanes' problems, and the beginnings of the new ones.
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
    looseness_ = fresh ? zero + (problem_.m < 2 * N ? kLoose : kLooser) : looseness_;
    unseen_ = fresh ? (nearest ? one : zero + Real(2)) : unseen_;
    for (int l = 0; l < L; ++l) begun_[l] = 0;
    stale_ = false;
  }

  // Tensions, residual and curvature at the trial point. A lane that begins takes its cables for free.
  void evaluate(V (&matrix)[N][N], V (&residual)[N]) {
    const V zero = V{};
    // Copies that cannot alias the members, so that they stay in registers.
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

  // Rate the trial point and choose the next.
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
    const V noise = 4 * kUlp * (size_ + problem_.gain * problem_.gain * furthest);
    const V root = kRoot * first_slope_ + noise * norm;
    const auto close = (error <= kClose * size_) & (unseen_ <= one);
    converged = close & ((error <= kConverged * size_) | (close_ > zero)) ? one : zero;
    close_ = close ? one : zero;
    const auto maximal = (proximal_ > zero) & (steepest <= 4 * noise);
    // The dual is never above the cost of tensions that render w: where few cost more, its multiplier may
    // separate.
    const auto doubtful = (proximal_ == zero) & (unseen_ <= one) & (value > problem_.high_cost);
    const V outside = any(doubtful) ? problem_.separation_margin(trial_) : zero;
    const auto lost = doubtful & (outside > zero);
    // Before the root of the slope the dual has grown; beyond it that must be seen.
    const auto flat = (magnitude(slope) <= kFlat * first_slope_) & ((slope >= zero) | (value > last_value_));
    const V take = ((unseen_ > zero) | maximal | flat | lost | close | (magnitude(slope) <= root)) ? one : zero;

    separated = lost ? one : zero;
    settled = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) direction[k] = trial_[k];
    V step = one;
    if (any(take == zero)) step = search(slope, root, take);
    if (any(maximal)) recentre(residual, gradient, maximal, noise, error);
    found = converged + separated + settled;

    looseness_ = (proximal_ > zero) | close ? zero + kSafe : looseness_;
    const auto taken = take > zero;
    const auto rated = taken & (unseen_ == zero);
    const V least = zero + kTight;
    const V tighter = magnitude(slope) <= root ? least : larger(least, V(kTighten * looseness_));
    looseness_ = rated ? smaller(looseness_, tighter) : looseness_;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) matrix[k][k] += proximal_;
    V path[N], least_pivot[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) least_pivot[k] = looseness_ * problem_.diagonal[k];
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

  // The step to the maximum along the path, where it was not taken. Where the dual grows without end, the path
  // itself separates.
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
    const auto endless = open & (proximal_ == zero) & (outside > zero);
    separated = endless ? one : separated;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) direction[k] = endless ? path_[k] : direction[k];
    return LineSearch<Real, L, N, M>(problem_, wanted_, path_, pull, curvature)
        .root(first_slope_, slope, root, open & !endless);
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
  V close_ = {};  // whether the trial before was close
  V first_slope_ = {}, proximal_ = {}, looseness_ = {}, size_ = {};
  V value_ = {}, last_value_ = {};  // of the dual
  V unseen_ = {};                   // trials to take whatever their slope; above 1, without limits too
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
