// The available wrench set of a pose, all W t with t inside the limits, as a zonotope about its centre; one pose
// in each lane.
//
// It is held in coordinates x = B w that make the rows of W orthonormal, so that its facets are well-conditioned
// however small the platform is beside its cables. A facet whose normal is h there has the normal B'h in wrenches.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "batch.hpp"
#include "lanes.hpp"
#include "linear.hpp"
#include "zonotope.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Pointers to contiguous numbers. structure is n x m, row by row.
struct Pose {
  const double *structure, *lower, *upper;
};

// N wrench components, of which the tensions can change R independent combinations. B ends each row with its
// diagonal where kTriangular.
template <int L, int N, int R, int M, bool kTriangular>
struct WrenchSet {
  using V = Lanes<double, L>;
  static constexpr int kLanes = L, kComponents = N, kRank = R;

  V basis[R][N];  // B
  V centre[N];
  Zonotope<double, L, R, M> zonotope;

  // out = B w
  void transform(const V* w, V* out) const {
    TENSIONLAB_UNROLL
    for (int r = 0; r < R; ++r) {
      out[r] = basis[r][0] * w[0];
      TENSIONLAB_UNROLL
      for (int k = 1; k < (kTriangular ? r + 1 : N); ++k) out[r] += basis[r][k] * w[k];
    }
  }

  // Component k of B'h, the normal in wrenches.
  V component(const V* normal, int k) const {
    V sum = basis[R - 1][k] * normal[R - 1];
    TENSIONLAB_UNROLL
    for (int r = kTriangular ? k : 0; r < R - 1; ++r) sum += basis[r][k] * normal[r];
    return sum;
  }

  // The sum of squares of the first `count` of them.
  V square(const V* normal, int count = N) const {
    V sum{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < count; ++k) {
      const V each = component(normal, k);
      sum += each * each;
    }
    return sum;
  }

  // Cable i, from its column of W and half its room to move. One without room spans nothing.
  void set_segment(int i, const V* pull, const V& room) {
    V* const column = zonotope.column[i];
    transform(pull, column);
    const V length = square_root<double, L>(dot(column, column));
    const V inverse = (room > V{}) & (length > V{}) ? 1 / length : V{};
    for (int r = 0; r < R; ++r) column[r] *= inverse;
    zonotope.half[i] = length * room;
  }

  // visit(normal, height, spans) for every pair of facets |normal . x| <= height; where `spans` is false it is
  // none.
  template <class Visit>
  void facets(const Visit& visit) const {
    // Unit columns whose cross product is no longer than the root of this count as dependent.
    constexpr double kDependent = 1e-22;
    zonotope.facets(
        [&](const V* normal, const V& height) { visit(normal, height, dot(normal, normal) > V{} + kDependent); });
  }

  // The least of `start` and of bound(normal, height) for all facets.
  template <class Bound>
  V least(V start, const Bound& bound) const {
    facets([&](const V* normal, const V& height, const auto& spans) {
      start = smaller(start, spans ? bound(normal, height) : V{} + kInfinity);
    });
    return start;
  }

  static V dot(const V* a, const V* b) { return Zonotope<double, L, R, M>::dot(a, b); }
};

// Poses whose structure matrices are well-conditioned: B from the Cholesky factor of W W'.
template <int L, int N, int M>
struct WrenchSets : WrenchSet<L, N, N, M, true> {
  using V = Lanes<double, L>;

  static constexpr double size = 0;
  static constexpr bool flat() { return false; }
  static V off_range(const V*) { return V{}; }

  // Returns for each lane whether its structure matrix is such a one.
  auto load(const Pose (&poses)[L], int m) {
    constexpr double kWell = 1e4;  // B is accurate to the square of this times the rounding error
    V matrix[N * M], room[M], middle[M], gram[N][N] = {};
    read(poses, m, matrix, room, middle);
    for (int k = 0; k < N; ++k) this->centre[k] = V{};
    for (int i = 0; i < m; ++i) {
      V pull[N];
      for (int k = 0; k < N; ++k) {
        this->centre[k] += matrix[k * m + i] * middle[i];
        pull[k] = room[i] > V{} ? matrix[k * m + i] : V{};
        for (int j = 0; j <= k; ++j) gram[k][j] += pull[k] * pull[j];
      }
    }
    V size = gram[0][0];
    for (int k = 1; k < N; ++k) size += gram[k][k];
    const V inverse = invert_root(gram);
    this->zonotope.count = m;
    for (int i = 0; i < m; ++i) {
      V pull[N];
      for (int k = 0; k < N; ++k) pull[k] = matrix[k * m + i];
      this->set_segment(i, pull, room[i]);
    }
    return size * inverse < V{} + kWell * kWell;
  }

 private:
  static void read(const Pose (&poses)[L], int m, V* matrix, V* room, V* middle) {
    const double *structure[L], *lower[L], *upper[L];
    for (int l = 0; l < L; ++l) {
      structure[l] = poses[l].structure;
      lower[l] = poses[l].lower;
      upper[l] = poses[l].upper;
    }
    transpose<double, L>(structure, N * m, [&](int i, const V& v) { matrix[i] = v; });
    transpose<double, L>(lower, m, [&](int i, const V& v) { middle[i] = v; });
    transpose<double, L>(upper, m, [&](int i, const V& v) { room[i] = (v - middle[i]) / 2; });
    for (int i = 0; i < m; ++i) middle[i] += room[i];
  }

  // B = the inverse of the Cholesky factor of the Gram matrix; returns the sum of the squares of its entries.
  V invert_root(const V (&gram)[N][N]) {
    V root[N][N], sum{};
    for (int k = 0; k < N; ++k) {
      for (int j = 0; j <= k; ++j) {
        V left = gram[k][j];
        for (int s = 0; s < j; ++s) left -= root[k][s] * root[j][s];
        root[k][j] = j < k ? V(left * this->basis[j][j]) : square_root<double, L>(left);
      }
      this->basis[k][k] = 1 / root[k][k];
      for (int j = 0; j < k; ++j) {
        V below{};
        for (int s = j; s < k; ++s) below -= root[k][s] * this->basis[s][j];
        this->basis[k][j] = below * this->basis[k][k];
      }
      for (int j = k + 1; j < N; ++j) this->basis[k][j] = V{};
      for (int j = 0; j <= k; ++j) sum += this->basis[k][j] * this->basis[k][j];
    }
    return sum;
  }
};

// One pose with any structure matrix, of rank R or, where R is 1, of rank 0. B comes from singular values.
template <int R, int M>
struct SingleWrenchSet : WrenchSet<1, kMaxComponents, R, M, false> {
  static constexpr int N = kMaxComponents;
  int components, rank;
  double range[R][N];  // orthonormal
  double size;         // how far the set may reach from zero

  template <class Whitener>
  SingleWrenchSet(const Pose& pose, int n, int m, const Whitener& whitening)
      : components(n), rank(whitening.rank) {
    for (int r = 0; r < R; ++r) {
      double square = 0;
      for (int k = 0; k < N; ++k) {
        this->basis[r][k] = r < rank && k < n ? whitening.rows[r][k] : 0.0;
        square += this->basis[r][k] * this->basis[r][k];
      }
      for (int k = 0; k < N; ++k) range[r][k] = square > 0 ? this->basis[r][k] / std::sqrt(square) : 0.0;
    }
    std::fill(this->centre, this->centre + N, 0.0);
    size = 0;
    this->zonotope.count = rank > 0 ? m : 0;
    for (int i = 0; i < m; ++i) {
      const double room = (pose.upper[i] - pose.lower[i]) / 2, middle = pose.lower[i] + room;
      double pull[N] = {}, square = 0;
      for (int k = 0; k < n; ++k) {
        pull[k] = pose.structure[k * m + i];
        this->centre[k] += pull[k] * middle;
        square += pull[k] * pull[k];
      }
      size += std::sqrt(square) * (std::abs(middle) + room);
      this->set_segment(i, pull, room);
    }
  }

  bool flat() const { return rank < components; }

  // wrench -= what of it the tensions can change
  void take_off(double* wrench) const {
    for (int pass = 0; pass < 2; ++pass) {
      for (int r = 0; r < rank; ++r) {
        double share = 0;
        for (int k = 0; k < N; ++k) share += range[r][k] * wrench[k];
        for (int k = 0; k < N; ++k) wrench[k] -= share * range[r][k];
      }
    }
  }

  // The rest of a wrench, seen from the centre: all of it is 0 where it is no more than rounding. Returns its
  // length.
  double off_range(const double* wrench, double* off) const {
    std::copy(wrench, wrench + N, off);
    take_off(off);
    double square = 0, length = 0;
    for (int k = 0; k < N; ++k) {
      square += off[k] * off[k];
      length += wrench[k] * wrench[k];
    }
    if (std::sqrt(square) > 1e-12 * (size + std::sqrt(length))) return std::sqrt(square);
    std::fill(off, off + N, 0.0);
    return 0;
  }
  double off_range(const double* wrench) const {
    double off[N];
    return off_range(wrench, off);
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
