// The facets of a zonotope, the sum of line segments about the origin: in R dimensions every choice of R - 1
// segments spans a pair of them, unless it is linearly dependent (hyperplane shifting: Bouchard, Gosselin & Moore
// 2010; Gouttefarde & Krut 2010).
//
// The normal is the cross product of the R - 1 columns, built column by column: the wedge product of K columns has
// a component for each choice of K rows, their determinant, and another column expands each of them along its last
// column (Laplace). Choices that begin alike share their products; there are no divisions and no branches by lane.
#pragma once

#include <cstddef>
#include <utility>

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

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

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
