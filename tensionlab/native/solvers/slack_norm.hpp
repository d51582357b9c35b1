// Prices of the slack p-norm (solvers/dual_ascent.hpp), with t = c + h x (solvers/middle.hpp):
//
//   cable   |x - x0|^p - c1 ln(1 + x) - c2 ln(1 - x)
//   error   kappa (sqrt(s^2 + epsilon) + gamma s^2), for each component
#pragma once

#include <cmath>
#include <limits>

#include "solvers/middle.hpp"

namespace tensionlab {

struct SlackPrices {
  double p, c1, c2, kappa, epsilon, gamma;
};

inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
struct SlackNorm : Middle<Real, L, N, M> {
  using V = Lanes<Real, L>;
  static constexpr bool kTightens = false;
  SlackPrices prices;
  V preferred[M] = {};

  template <class Problem>
  void load(int l, int m, const Problem& problem, Real (&column)[M][N], Real (&target)[N]) {
    Middle<Real, L, N, M>::load(l, m, problem, column, target);
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
  // left side is concave for s > 0, so that Newton steps from anywhere end below the root, and rise to it.
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
  static constexpr Real kLast = Real(1e6) * kUlp;  // after a step as short as this, the next one is nothing
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

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
