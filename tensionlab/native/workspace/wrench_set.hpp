// The available wrench set of a pose, all W t with t inside the limits, as a zonotope about its centre; one pose
// in each lane.
//
// Its coordinates x = B w make the rows of W orthonormal, so that its facets are well-conditioned even for a
// platform that is small compared with its cables. A facet with the normal h there has the normal B'h in wrenches.
// In up to three dimensions a normal is the product of two columns at most, and B = 1 suffices.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "tensionlab/simd/batch.hpp"
#include "tensionlab/simd/lanes.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The facets of a zonotope, the sum of line segments about the origin: in R dimensions every choice of R - 1
// segments spans a pair of them, unless it is linearly dependent (hyperplane shifting: Bouchard, Gosselin & Moore
// 2010; Gouttefarde & Krut 2010).
//
// The normal is the cross product of the R - 1 columns, built column by column: the wedge product of K columns has
// a component for each choice of K rows, their determinant, and another column expands each of them along its last
// column (Laplace). Choices that begin alike share their products; there are no divisions and no branches by lane.

// Choices of rows are masks; those with the same number of rows are numbered in rising order.
constexpr int rows_in(int mask) { return mask == 0 ? 0 : (mask & 1) + rows_in(mask >> 1); }
constexpr int number_of(int mask) {
  int number = 0;
  for (int other = 0; other < mask; ++other) number += rows_in(other) == rows_in(mask);
  return number;
}
constexpr int mask_of(int rows, int number) {
  int mask = 0;
  while (rows_in(mask) != rows || number_of(mask) != number) ++mask;
  return mask;
}
constexpr int choices(int n, int k) { return k == 0 || k == n ? 1 : choices(n - 1, k - 1) + choices(n - 1, k); }

// One component of wedge ^ column: the part of its expansion along the column by the rows of kMask from kRow down.
template <int kMask, int kRow, class V>
inline V expansion(const V* wedge, const V* column) {
  constexpr int kBelow = kMask & ((1 << kRow) - 1);
  if constexpr ((kMask >> kRow & 1) == 0) {
    return expansion<kMask, kRow - 1>(wedge, column);
  } else {
    const V product = wedge[number_of(kMask & ~(1 << kRow))] * column[kRow];
    constexpr bool kNegative = rows_in(kMask >> kRow) % 2 == 0;
    if constexpr (kBelow == 0) {
      return kNegative ? -product : product;
    } else {
      const V rest = expansion<kMask, kRow - 1>(wedge, column);
      return kNegative ? rest - product : rest + product;
    }
  }
}

// product = wedge ^ column, where wedge is that of K columns of R rows.
template <int R, int K, class V, std::size_t... kNumbers>
inline void extend(const V* wedge, const V* column, V* product, std::index_sequence<kNumbers...>) {
  ((product[kNumbers] = expansion<mask_of(K + 1, static_cast<int>(kNumbers)), R - 1>(wedge, column)), ...);
}

template <class Real, int L, int R, int M>
struct Zonotope {
  using V = Lanes<Real, L>;

  V column[M][R];  // half of segment i is half[i] * column[i]
  V half[M];
  V square[M];  // of the column's length; 0 where the segment spans nothing, as one of length 0
  int count;

  // Calls visit(normal, height, spans) for every choice of R - 1 segments: the zonotope lies in |normal . x| <=
  // height and touches both planes; the normal has any length. Where `spans` is false the choice is dependent, and
  // its normal is zero up to rounding.
  template <class Visit>
  void facets(const Visit& visit) const {
    if (count < R) return;
    const V nothing_yet[1] = {V{} + 1};
    int chosen[R];
    choose<0>(nothing_yet, V{} + kDependent * kDependent, 0, chosen, visit);
  }

  static V dot(const V* a, const V* b) {
    V sum = a[0] * b[0];
    TENSIONLAB_UNROLL
    for (int k = 1; k < R; ++k) sum += a[k] * b[k];
    return sum;
  }

 private:
  // Columns are dependent if their product is at most this share of the product of their lengths.
  static constexpr Real kDependent = Real(1e-11);

  // `least` is the square of the length that a product of independent columns exceeds.
  template <int K, class Visit>
  void choose(const V* wedge, const V& least, int first, int* chosen, const Visit& visit) const {
    if constexpr (K == R - 1) {
      V normal[R];
      to_normal(wedge, normal);
      visit(normal, height(normal, chosen), dot(normal, normal) > least);
    } else {
      constexpr int kComponents = choices(R, K + 1);
      V product[kComponents];
      for (int i = first; i <= count - (R - 1 - K); ++i) {
        chosen[K] = i;
        extend<R, K>(wedge, column[i], product, std::make_index_sequence<kComponents>());
        choose<K + 1>(product, least * square[i], i + 1, chosen, visit);
      }
    }
  }

  // Half the extent of the zonotope along the normal; the chosen segments have none.
  V height(const V* normal, const int* chosen) const {
    V sum{};
    int next = 0;
    for (int k = 0; k < R; ++k) {
      const int end = k < R - 1 ? chosen[k] : count;
      for (int i = next; i < end; ++i) sum += magnitude(dot(normal, column[i])) * half[i];
      next = end + 1;
    }
    return sum;
  }

  static void to_normal(const V* wedge, V* normal) {
    TENSIONLAB_UNROLL
    for (int k = 0; k < R; ++k) normal[k] = (R - 1 - k) % 2 == 0 ? wedge[R - 1 - k] : V(-wedge[R - 1 - k]);
  }
};

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Pointers to contiguous numbers. structure is n x m, row by row.
struct Pose {
  const double *structure, *lower, *upper;
};

enum class Basis { identity, triangle, full };  // rows of a triangle end with its diagonal

// N wrench components, of which the tensions can change R independent combinations.
template <int L, int N, int R, int M, Basis kBasis>
struct WrenchSet {
  using V = Lanes<double, L>;
  static constexpr int kLanes = L, kComponents = N, kRank = R;
  static constexpr bool kMayBeFlat = false;

  V basis[R][N];  // B
  V centre[N];
  Zonotope<double, L, R, M> zonotope;

  // out = B w
  void transform(const V* w, V* out) const {
    TENSIONLAB_UNROLL
    for (int r = 0; r < R; ++r) {
      if constexpr (kBasis == Basis::identity) {
        out[r] = w[r];
      } else {
        out[r] = basis[r][0] * w[0];
        TENSIONLAB_UNROLL
        for (int k = 1; k < (kBasis == Basis::triangle ? r + 1 : N); ++k) out[r] += basis[r][k] * w[k];
      }
    }
  }

  // Component k of B'h, the normal in wrenches.
  V component(const V* normal, int k) const {
    if constexpr (kBasis == Basis::identity) {
      return normal[k];
    } else {
      V sum = basis[R - 1][k] * normal[R - 1];
      TENSIONLAB_UNROLL
      for (int r = kBasis == Basis::triangle ? k : 0; r < R - 1; ++r) sum += basis[r][k] * normal[r];
      return sum;
    }
  }

  // The sum of squares of the first `count` of them.
  V square(const V* normal, int count = N) const {
    V sum = component(normal, 0) * component(normal, 0);
    if constexpr (N > 1) {
      TENSIONLAB_UNROLL
      for (int k = 1; k < count; ++k) {
        const V each = component(normal, k);
        sum += each * each;
      }
    }
    return sum;
  }

  // Sets cable i, from its column of W and half the range of its tension. One without a range spans nothing.
  void set_segment(int i, const V* pull, const V& room) {
    V* const column = zonotope.column[i];
    transform(pull, column);
    for (int r = 0; r < R; ++r) column[r] = room > V{} ? column[r] : V{};
    zonotope.half[i] = room;
    zonotope.square[i] = dot(column, column);
  }

  // The least of `start` and of bound(normal, height) for all facets.
  template <class Bound>
  V least(V start, const Bound& bound) const {
    zonotope.facets([&](const V* normal, const V& height, const auto& spans) {
      start = smaller(start, spans ? bound(normal, height) : V{} + kInfinity);
    });
    return start;
  }

  static V dot(const V* a, const V* b) { return Zonotope<double, L, R, M>::dot(a, b); }
};

// Poses whose structure matrices are well-conditioned: B is 1, or the inverse of the Cholesky factor of W W'.
template <int L, int N, int M>
struct WrenchSets : WrenchSet<L, N, N, M, N <= 3 ? Basis::identity : Basis::triangle> {
  using V = Lanes<double, L>;

  static constexpr double size = 0;
  static constexpr bool flat() { return false; }
  static V off_range(const V*) { return V{}; }

  // Returns for each lane whether its structure matrix is well-conditioned.
  auto load(const Pose (&poses)[L], int m) {
    V matrix[N * M], room[M], middle[M], gram[N][N];
    read(poses, m, matrix, room, middle);
    for (int k = 0; k < N; ++k) {
      this->centre[k] = V{};
      for (int j = 0; j <= k; ++j) gram[k][j] = V{};
    }
    for (int i = 0; i < m; ++i) {
      V pull[N];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) {
        this->centre[k] += matrix[k * m + i] * middle[i];
        pull[k] = room[i] > V{} ? matrix[k * m + i] : V{};
        TENSIONLAB_UNROLL
        for (int j = 0; j <= k; ++j) gram[k][j] += pull[k] * pull[j];
      }
    }
    const auto well = change_basis(gram);
    this->zonotope.count = m;
    for (int i = 0; i < m; ++i) {
      V pull[N];
      for (int k = 0; k < N; ++k) pull[k] = matrix[k * m + i];
      this->set_segment(i, pull, room[i]);
    }
    return well;
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
    read_row(lower, m, middle);
    read_row(upper, m, room);
    for (int i = 0; i < m; ++i) {
      room[i] = (room[i] - middle[i]) / 2;
      middle[i] += room[i];
    }
  }

  // Loads numbers of all poses; poses that share limits have one row.
  static void read_row(const double* const (&row)[L], int m, V* out) {
    if (row[0] == row[L - 1]) {
      for (int i = 0; i < m; ++i) out[i] = V{} + row[0][i];
    } else {
      transpose<double, L>(row, m, [&](int i, const V& v) { out[i] = v; });
    }
  }

  // Sets B from the Gram matrix W W'; returns where that is certainly well-conditioned, and far from overflow.
  auto change_basis(const V (&gram)[N][N]) {
    constexpr double kWell = 1e4;  // the condition of W; B is accurate to its square times the rounding error
    constexpr double kLarge =
        1e60;  // of the trace: beyond, products of columns overflow; below 1 / kLarge they vanish
    V trace = gram[0][0];
    for (int k = 1; k < N; ++k) trace += gram[k][k];
    const auto ordinary = (trace < V{} + kLarge) & (trace > V{} + 1 / kLarge);
    if constexpr (N <= 3) {
      return ordinary & (least_share(gram, trace) * (kWell * kWell) > V{} + 1);
    } else {
      return ordinary & (trace * invert_root(gram) < V{} + kWell * kWell);
    }
  }

  // A lower bound of the least eigenvalue over the largest one. All others are at most the trace together, so
  // their product is largest where they are equal: det <= least * (trace / (N - 1))^(N - 1).
  static V least_share(const V (&g)[N][N], const V& trace) {
    if constexpr (N == 1) {
      return V{} + 1;
    } else if constexpr (N == 2) {
      return (g[0][0] * g[1][1] - g[1][0] * g[1][0]) / (trace * trace);
    } else {
      const V det = g[0][0] * (g[1][1] * g[2][2] - g[2][1] * g[2][1]) -
                    g[1][0] * (g[1][0] * g[2][2] - g[2][1] * g[2][0]) +
                    g[2][0] * (g[1][0] * g[2][1] - g[1][1] * g[2][0]);
      return 4 * det / (trace * trace * trace);
    }
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

// The set of one pose with any structure matrix, of rank R or, if R is 1, also of rank 0. It is flat if it has
// fewer dimensions than wrench components.
template <int R, int M>
struct SingleWrenchSet : WrenchSet<1, kMaxComponents, R, M, Basis::full> {
  static constexpr int N = kMaxComponents;
  static constexpr bool kMayBeFlat = true;
  int components, rank;
  double range[R][N];  // orthonormal
  double size;         // an upper bound of the distance of the set from zero

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

  // Subtracts from a wrench its part in the range of W.
  void subtract_range(double* wrench) const {
    for (int pass = 0; pass < 2; ++pass) {
      for (int r = 0; r < rank; ++r) {
        double share = 0;
        for (int k = 0; k < N; ++k) share += range[r][k] * wrench[k];
        for (int k = 0; k < N; ++k) wrench[k] -= share * range[r][k];
      }
    }
  }

  // The part of a wrench, relative to the centre, off the range; zeros where it is mere rounding. Returns its
  // length.
  double off_range(const double* wrench, double* off) const {
    std::copy(wrench, wrench + N, off);
    subtract_range(off);
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
