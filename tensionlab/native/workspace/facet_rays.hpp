// The normals v of a zonotope's facets, for the proof that a wrench set lies inside it.
//
// The hyperplanes v . w_j = 0 cut the space of directions into cones, and every cone is spanned by rays that lie
// on n - 1 of them. A function that is concave and homogeneous in v on every cone, and not negative on the rays,
// is not negative anywhere. For this no ray may be missing, and no two columns may be so nearly dependent that
// rounding decides where a ray is. So the columns are moved a little, each in another direction; any set of
// hyperplanes gives a valid proof, and this one is hardly less tight.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "tensionlab/simd/batch.hpp"
#include "tensionlab/simd/lanes.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int N>
struct FacetRay {
  double v[N];             // of length 1
  double error;            // largest distance from the exact ray
  std::uint32_t spanning;  // the N - 1 columns it is across
  std::uint32_t across;    // these, and those whose side is in doubt by rounding
  std::uint32_t positive;  // the columns on whose side it is
};

template <int N>
class FacetRays {
 public:
  // `column`: N x M; only columns with a bit in `loose` count.
  void find(const double (&column)[N][kMaxCables], int m, std::uint32_t loose) {
    rays_.clear();
    count_ = 0;
    double most = 0;
    for (int j = 0; j < m; ++j) {
      if (!(loose >> j & 1)) continue;
      double square = 0;
      for (int k = 0; k < N; ++k) square += column[k][j] * column[k][j];
      most = std::max(most, std::sqrt(square));
    }
    for (int j = 0; j < m; ++j) {
      if (!(loose >> j & 1)) continue;
      const int number = count_++;
      own_[number] = j;
      for (int k = 0; k < N; ++k) column_[number][k] = column[k][j] + kMoved * most * scatter(j * N + k);
    }
    largest_ = most * (1 + kMoved * N);
    if (count_ < N) return;
    double basis[N][N] = {};
    for (int k = 0; k < N; ++k) basis[k][k] = 1;
    choose<0>(basis, 1, 0, 0, 0);
  }

  const std::vector<FacetRay<N>>& all() const { return rays_; }

 private:
  static constexpr double kMoved = 0x1p-30, kUnit = std::numeric_limits<double>::epsilon();

  std::vector<FacetRay<N>> rays_;
  double column_[kMaxCables][N];
  int own_[kMaxCables];
  int count_;
  double largest_;

  // Pseudo-random numbers from -1/2 to 1/2: multiples of the golden ratio, by squares.
  static double scatter(int number) {
    const double turn = 0.6180339887498949 * (number + 1) * (number + 1);
    return turn - std::floor(turn) - 0.5;
  }

  // basis: N - K orthonormal vectors across the K columns chosen so far; volume: the product of their distances
  // from those before. Householder reflections keep the basis orthonormal for any columns.
  template <int K>
  void choose(const double (&basis)[N][N], double volume, std::uint32_t chosen, double squares, int first) {
    if constexpr (K == N - 1) {
      add(basis[0], volume, chosen, squares);
    } else {
      constexpr int kRest = N - K;
      if (N > 3 && K == 2) checkpoint();
      for (int i = first; i <= count_ - (N - 1 - K); ++i) {
        double share[kRest], smaller[N][N];
        for (int b = 0; b < kRest; ++b) share[b] = dot<N>(basis[b], column_[i]);
        const double length = std::sqrt(dot<kRest>(share, share)), size = dot<N>(column_[i], column_[i]);
        // The reflection that maps the shares to the last one alone; the other vectors are then across the column.
        share[kRest - 1] += share[kRest - 1] < 0 ? -length : length;
        double norm = dot<kRest>(share, share), sum[N];
        for (int k = 0; k < N; ++k) {
          sum[k] = 0;
          for (int b = 0; b < kRest; ++b) sum[k] += share[b] * basis[b][k];
        }
        for (int b = 0; b < kRest - 1; ++b) {
          const double twice = norm > 0 ? 2 * share[b] / norm : 0;
          for (int k = 0; k < N; ++k) smaller[b][k] = basis[b][k] - twice * sum[k];
        }
        choose<K + 1>(smaller, volume * length, chosen | 1u << i, squares + size, i + 1);
      }
    }
  }

  // The distance of v from the ray is at most the part of v along the chosen columns, over the least of their
  // singular values. volume, the product of all, bounds the least from below with the mean of the others' squares.
  // Where that bound is poor, the size of the dual vectors gives a better one.
  void add(const double (&direction)[N], double volume, std::uint32_t chosen, double squares) {
    FacetRay<N> ray{};
    const double length = std::sqrt(dot<N>(direction, direction));
    for (int k = 0; k < N; ++k) ray.v[k] = direction[k] / length;
    double along[kMaxCables], off = 0;
    for (int i = 0; i < count_; ++i) {
      along[i] = dot<N>(ray.v, column_[i]);
      if (chosen >> i & 1) off += along[i] * along[i];
    }
    off = std::sqrt(off) + N * N * kUnit * largest_;
    const double others = N > 2 ? std::pow(squares / (N - 2), (N - 2) / 2.0) : 1.0;
    ray.error = 1.5 * off * others / volume;
    if (!(ray.error < 1e-9)) ray.error = std::min(ray.error, 3 * off * dual_size(chosen));
    if (!(ray.error < 0.5)) ray.error = std::numeric_limits<double>::infinity();
    const double doubt = (ray.error + N * kUnit) * largest_;
    for (int i = 0; i < count_; ++i) {
      const std::uint32_t bit = 1u << own_[i];
      if (chosen >> i & 1) ray.spanning |= bit;
      if (chosen >> i & 1 || std::abs(along[i]) <= doubt) {
        ray.across |= bit;
      } else if (along[i] > 0) {
        ray.positive |= bit;
      }
    }
    rays_.push_back(ray);
  }

  // The root of the sum of squares of the vectors dual to some columns: at least 1 over their least singular
  // value.
  double dual_size(std::uint32_t chosen) const {
    double column[N][N], basis[N][N], sum = 0;
    int count = 0;
    for (int i = 0; i < count_; ++i) {
      if (chosen >> i & 1) std::copy(column_[i], column_[i] + N, column[count++]);
    }
    if (!dual_basis<N>(column, count, 1e-13, basis)) return std::numeric_limits<double>::infinity();
    for (int a = 0; a < count; ++a) sum += dot<N>(basis[a], basis[a]);
    return std::sqrt(sum);
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
