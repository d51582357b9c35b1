// Laws of solvers/dual_ascent.hpp: the prices of the analytic centre, of the slack p-norm and of SPIDAR's program.
#pragma once

#include <cmath>
#include <limits>

#include "tensionlab/simd/batch.hpp"

namespace tensionlab {

struct SlackPrices {
  double p, c1, c2, kappa, epsilon, gamma;
};

inline namespace TENSIONLAB_BUILD {

// Tensions from the middle of their limits, t = c + h x with x from -1 to 1: the columns are h_i W_i and the
// target is w - W c, rows times the roots of the wrench weights, in units of the largest column. A cable whose
// limits are equal has h = 0: no column, and no part in anything.
template <class Real, int L, int N, int M>
struct FromMiddle {
  Real centre[L][M], half[L][M];
  Real weight_roots[N];

  void load(int l, int m, const Problem<Real>& problem, Real (&column)[M][N], Real (&target)[N]) {
    for (int k = 0; k < N; ++k) target[k] = problem.wrench[k];
    Real unit = 0;
    for (int i = 0; i < m; ++i) {
      const Real a = problem.lower[i], b = problem.upper[i];
      centre[l][i] = a + (b - a) / 2;
      half[l][i] = (b - a) / 2;
      Real square = 0;
      for (int k = 0; k < N; ++k) {
        const Real entry = problem.structure[k * m + i];
        target[k] -= entry * centre[l][i];
        column[i][k] = weight_roots[k] * entry * half[l][i];
        square += column[i][k] * column[i][k];
      }
      unit = larger(unit, std::sqrt(square));
    }
    unit = unit > 0 ? unit : Real(1);
    for (int k = 0; k < N; ++k) {
      target[k] *= weight_roots[k] / unit;
      for (int i = 0; i < m; ++i) column[i][k] /= unit;
    }
  }

  Real tension(int i, int l, Real x) const { return centre[l][i] + half[l][i] * x; }
};

// Analytic centre: -ln(t - a) - ln(b - t) for each cable, whose slope 2 x / (1 - x^2) is q at x = q / (1 + sqrt(1
// + q^2)). The error costs (3/4) P^(-1/3) |s|^(4/3), so that s = P |y|^2 y, which is next to nothing while the
// tensions are clear of their limits. Where no tensions inside the limits render the wrench, it keeps y finite,
// and the error nearly the least. There x(q) is almost a jump from -1 to 1, which Newton steps find hard, so P
// begins larger and falls as they succeed.
template <class Real, int L, int N, int M>
struct LogBarrier : FromMiddle<Real, L, N, M> {
  using V = Lanes<Real, L>;
  static constexpr bool kTightens = true;
  V price = {};

  void load(int l, int m, const Problem<Real>& problem, Real (&column)[M][N], Real (&target)[N]) {
    FromMiddle<Real, L, N, M>::load(l, m, problem, column, target);
    lane<Real>(price, l) = kFirst;
  }

  V cable(int, const V& q, V& give) const {
    const V root = square_root<Real, L>(V(Real(1) + q * q)), below = Real(1) + root;
    give = Real(1) / (root * below);
    return q / below;
  }

  void slack(const V (&y)[N], V (&s)[N], V (&yield)[N][N]) const {
    V square = V{};
    for (int k = 0; k < N; ++k) square += y[k] * y[k];
    const V rate = price * (Real(1) + price * square), bend = Real(2) * price * price;
    for (int k = 0; k < N; ++k) {
      s[k] = rate * y[k];
      for (int j = 0; j < k; ++j) yield[k][j] = bend * y[k] * y[j];
      yield[k][k] = rate + bend * y[k] * y[k];
    }
  }

  void tighten(const V& full) { price = full > V{} ? larger(V(kFall * price), V{} + kLast) : price; }
  bool tight(int l) const { return read<Real>(price, l) < 2 * kLast; }

 private:
  static constexpr Real kPrecision = Real(1e-7);  // final error at the very edge of the workspace
  static constexpr Real kFirst = Real(1e-8), kFall = Real(1e-2), kLast = kPrecision * kPrecision;  // of P
};

// Slack p-norm:
//   cable   |x - x0|^p - c1 ln(1 + x) - c2 ln(1 - x)
//   error   kappa (sqrt(s^2 + epsilon) + gamma s^2), for each component
template <class Real, int L, int N, int M>
struct SlackNorm : FromMiddle<Real, L, N, M> {
  using V = Lanes<Real, L>;
  static constexpr bool kTightens = false;
  SlackPrices prices;
  V preferred[M] = {};

  void load(int l, int m, const Problem<Real>& problem, Real (&column)[M][N], Real (&target)[N]) {
    FromMiddle<Real, L, N, M>::load(l, m, problem, column, target);
    for (int i = 0; i < m; ++i) {
      const Real half = this->half[l][i];
      lane<Real>(preferred[i], l) = half > 0 ? (problem.reference[i] - this->centre[l][i]) / half : Real(0);
    }
  }

  // The x whose price has slope q: the root of (price'(x) - q) (1 - x^2), by Newton steps inside a bracket.
  V cable(int i, const V& q, V& give) const {
    const V zero = V{}, one = zero + Real(1);
    const Real c1 = Real(prices.c1), c2 = Real(prices.c2);
    V low = -one, high = one, bend;
    V x = q + Real(2) * preferred[i];
    x = x / (Real(2) + magnitude(x));
    auto open = one > zero;
    for (int round = 0; round < kRounds && any(open); ++round) {
      const V room = one - x * x;
      const V rise = slope(V(x - preferred[i]), bend) - q;
      const V f = rise * room - c1 * (one - x) + c2 * (one + x);
      const V falls = bend * room - Real(2) * x * rise + (c1 + c2);
      low = f < zero ? x : low;
      high = f > zero ? x : high;
      const V move = f / falls, next = x - move;
      const V length = magnitude(move), last = larger(V(kLast * room), V(2 * kUlp * one));
      const auto good = ((next > low) & (next < high)) | (length <= last);
      x = open ? (good ? next : V(Real(0.5) * (low + high))) : x;
      open = open & (length > last);
    }
    slope(V(x - preferred[i]), bend);
    const V below = one + x, above = one - x;
    give = one / (bend + c1 / (below * below) + c2 / (above * above));
    return x;
  }

  // The s whose price has slope y, one component at a time: s / sqrt(s^2 + epsilon) + 2 gamma s = |y| / kappa. The
  // left side is concave for s > 0, so Newton steps from anywhere end below the root, and rise to it.
  void slack(const V (&y)[N], V (&s)[N], V (&yield)[N][N]) const {
    const V zero = V{}, one = zero + Real(1);
    const Real kappa = Real(prices.kappa), epsilon = Real(prices.epsilon), stiff = Real(2 * prices.gamma);
    const Real soft = std::sqrt(epsilon), steepest = 1 / soft + stiff;
    for (int k = 0; k < N; ++k) {
      const V target = magnitude(y[k]) / kappa;
      const V least = larger(V(target / steepest), V((target - one) / stiff));
      const V room = larger(V(one - target * target), zero + soft);
      V found = larger(least, V(soft * smaller(target, one) / square_root<Real, L>(room)));
      auto open = target > zero;
      for (int round = 0; round < kRounds && any(open); ++round) {
        const V inverse = one / square_root<Real, L>(V(found * found + epsilon));
        const V bend = epsilon * inverse * inverse * inverse + stiff;
        const V next = larger(V(found + (target - found * inverse - stiff * found) / bend), least);
        const V move = next - found;
        found = open ? next : found;
        open = open & (magnitude(move) > kLast * found + 4 * kUlp / bend);
      }
      const V inverse = one / square_root<Real, L>(V(found * found + epsilon));
      s[k] = y[k] < zero ? V(-found) : found;
      for (int j = 0; j < k; ++j) yield[k][j] = zero;
      yield[k][k] = one / (kappa * (epsilon * inverse * inverse * inverse + stiff));
    }
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr Real kLast = Real(1e6) * kUlp;  // after a step this short, the next one changes nothing
  static constexpr int kRounds = 60;

  // p |x|^(p - 1) sign(x), and how fast it rises. Powers are slow, and p is mostly a small whole number.
  V slope(const V& x, V& bend) const {
    const Real p = Real(prices.p);
    V power = V{} + Real(1);
    if (p <= 8 && p == std::floor(p)) {
      for (int k = 2; k < static_cast<int>(p); ++k) power *= magnitude(x);
    } else {
      power = gather<Real, L>([&](int l) { return std::pow(std::abs(read<Real>(x, l)), p - 2); });
    }
    bend = p * (p - 1) * power;
    return p * power * x;
  }
};

// SPIDAR's program: (t - t0)^2 / 2 for each cable within its limits, s^2 / 2 for the error, rows times the roots
// of price / mu.
template <class Real, int L, int N, int M>
struct BoxPrice {
  using V = Lanes<Real, L>;
  static constexpr bool kTightens = false;
  Real row_roots[N];
  V lower[M] = {}, upper[M] = {}, reference[M] = {};

  void load(int l, int m, const Problem<Real>& problem, Real (&column)[M][N], Real (&target)[N]) {
    for (int k = 0; k < N; ++k) {
      target[k] = row_roots[k] * problem.wrench[k];
      for (int i = 0; i < m; ++i) column[i][k] = row_roots[k] * problem.structure[k * m + i];
    }
    for (int i = 0; i < m; ++i) {
      lane<Real>(lower[i], l) = problem.lower[i];
      lane<Real>(upper[i], l) = problem.upper[i];
      lane<Real>(reference[i], l) = problem.reference[i];
    }
  }

  // At y = 0 every cable counts as free, so that the first step has the right length.
  V cable(int i, const V& q, V& give) const {
    const V zero = V{}, one = zero + Real(1);
    const V wanted = reference[i] + q;
    give = (((wanted > lower[i]) & (wanted < upper[i])) | (q == zero)) ? one : zero;
    return smaller(larger(wanted, lower[i]), upper[i]);
  }

  void slack(const V (&y)[N], V (&s)[N], V (&yield)[N][N]) const {
    for (int k = 0; k < N; ++k) {
      s[k] = y[k];
      for (int j = 0; j < k; ++j) yield[k][j] = V{};
      yield[k][k] = V{} + Real(1);
    }
  }

  Real tension(int, int, Real x) const { return x; }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
