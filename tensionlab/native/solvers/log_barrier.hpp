// Prices of the analytic centre (solvers/dual_ascent.hpp): -ln(t - a) - ln(b - t) for each cable.
//
// With t = c + h x (solvers/middle.hpp) the slope of the price is 2 x / (1 - x^2), which is q at x = q / (1 +
// sqrt(1 + q^2)). The error costs (3/4) P^(-1/3) |s|^(4/3), so that s = P |y|^2 y: nothing while the tensions are
// clear of their limits. Where none inside the limits render the wrench, it keeps y finite, and the error nearly
// the least. There x(q) is all but a jump from -1 to 1, which Newton steps find hard; so P begins larger and falls
// as they succeed.
#pragma once

#include "solvers/middle.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
struct LogBarrier : Middle<Real, L, N, M> {
  using V = Lanes<Real, L>;
  static constexpr bool kTightens = true;
  V price = {};

  template <class Problem>
  void load(int l, int m, const Problem& problem, Real (&column)[M][N], Real (&target)[N]) {
    Middle<Real, L, N, M>::load(l, m, problem, column, target);
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
  // P at first, how it falls, and at last: the error at the very edge of the workspace is then kPrecision.
  static constexpr Real kPrecision = Real(1e-7), kLast = kPrecision * kPrecision;
  static constexpr Real kFirst = Real(1e-8), kFall = Real(1e-2);
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
