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

  void cables(int m, const V (&q)[M], V (&x)[M], V (&give)[M]) const {
    for (int i = 0; i < m; ++i) {
      const V root = square_root<Real, L>(V(Real(1) + q[i] * q[i])), below = Real(1) + root;
      give[i] = Real(1) / (root * below);
      x[i] = q[i] / below;
    }
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

  // The x whose prices have slopes q: roots of (price'(x) - q) (1 - x^2), by Newton steps inside brackets, of all
  // cables at once, as none waits for another.
  void cables(int m, const V (&q)[M], V (&x)[M], V (&give)[M]) const {
    const V zero = V{}, one = zero + Real(1);
    const Real c1 = Real(prices.c1), c2 = Real(prices.c2);
    V low[M], high[M], bend;
    for (int i = 0; i < m; ++i) {
      x[i] = first_guess(V(preferred[i] + Real(0.5) * q[i]));
      low[i] = -one, high[i] = one;
    }
    auto open = one > zero;  // lanes with a cable that still moves: no answer may depend on the lane beside it
    for (int round = 0; round < kRounds && any(open); ++round) {
      auto moves = one < zero;
      for (int i = 0; i < m; ++i) {
        const V at = x[i], room = one - at * at;
        const V rise = slope(V(at - preferred[i]), bend) - q[i];
        const V f = rise * room - c1 * (one - at) + c2 * (one + at);
        const V falls = bend * room - Real(2) * at * rise + (c1 + c2);
        low[i] = f < zero ? at : low[i];
        high[i] = f > zero ? at : high[i];
        const V move = f / falls, next = at - move;
        const V length = magnitude(move), last = larger(V(kLast * room), V(2 * kUlp * one));
        const auto good = ((next > low[i]) & (next < high[i])) | (length <= last);
        x[i] = open ? (good ? next : V(Real(0.5) * (low[i] + high[i]))) : at;
        moves = moves | (length > last);
      }
      open = open & moves;
    }
    for (int i = 0; i < m; ++i) {
      slope(V(x[i] - preferred[i]), bend);
      const V below = one + x[i], above = one - x[i], room = below * above, square = room * room;
      give[i] = square / (bend * square + c1 * above * above + c2 * below * below);
    }
  }

  // The s whose prices have slopes y: s / sqrt(s^2 + epsilon) + 2 gamma s = |y| / kappa. The left side is concave
  // for s > 0, so Newton steps from anywhere end below the root, and rise to it.
  void slack(const V (&y)[N], V (&s)[N], V (&yield)[N][N]) const {
    const V zero = V{}, one = zero + Real(1);
    const Real share = 1 / Real(prices.kappa), epsilon = Real(prices.epsilon), stiff = Real(2 * prices.gamma);
    const Real soft = std::sqrt(epsilon), flattest = 1 / (1 / soft + stiff), last_slope = 1 / stiff;
    V target[N], least[N], bend[N] = {};
    for (int k = 0; k < N; ++k) {
      target[k] = share * magnitude(y[k]);
      least[k] = larger(V(flattest * target[k]), V(last_slope * (target[k] - one)));
      const V room = larger(V(one - target[k] * target[k]), zero + soft);
      s[k] = larger(least[k], V(soft * smaller(target[k], one) / square_root<Real, L>(room)));
    }
    auto open = one > zero;
    for (int round = 0; round < kRounds && any(open); ++round) {
      auto moves = one < zero;
      for (int k = 0; k < N; ++k) {
        const V inverse = one / square_root<Real, L>(V(s[k] * s[k] + epsilon));
        const V here = epsilon * inverse * inverse * inverse + stiff;
        bend[k] = open ? here : bend[k];
        const V next = larger(V(s[k] + (target[k] - s[k] * inverse - stiff * s[k]) / bend[k]), least[k]);
        moves = moves | (magnitude(next - s[k]) * bend[k] > kLast * next * bend[k] + 4 * kUlp);
        s[k] = open ? next : s[k];
      }
      open = open & moves;
    }
    for (int k = 0; k < N; ++k) {
      s[k] = y[k] < zero ? V(-s[k]) : s[k];
      for (int j = 0; j < k; ++j) yield[k][j] = zero;
      yield[k][k] = share / bend[k];
    }
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr Real kLast = Real(1) / (1 << 24);  // after a step this short, the next one is rounding
  static constexpr int kRounds = 60;

  // The root for p = 2 with the price of the nearer limit alone, and about that of the other, from x without
  // prices.
  V first_guess(const V& free) const {
    const V zero = V{}, one = zero + Real(1), size = magnitude(free);
    const auto up = free > zero;
    const V near = up ? zero + Real(prices.c2) : zero + Real(prices.c1);
    const V far = Real(prices.c1 + prices.c2) - near;
    const V gap = one - size - far * (Real(0.5) - Real(0.25) * smaller(size, one));
    const V x = one - Real(0.5) * (gap + square_root<Real, L>(V(gap * gap + Real(2) * near)));
    return up ? x : V(-x);
  }

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
  void cables(int m, const V (&q)[M], V (&x)[M], V (&give)[M]) const {
    const V zero = V{}, one = zero + Real(1);
    for (int i = 0; i < m; ++i) {
      const V wanted = reference[i] + q[i];
      give[i] = (((wanted > lower[i]) & (wanted < upper[i])) | (q[i] == zero)) ? one : zero;
      x[i] = smaller(larger(wanted, lower[i]), upper[i]);
    }
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
