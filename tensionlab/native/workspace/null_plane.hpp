// The tension factor where there are two more cables than wrench components, from the plane of tensions without a
// wrench instead of the facets.
//
// With a basis of that plane as the columns of Z, what three cables pull along the normal that all others are
// across is, but for a common factor, the 2 x 2 minors of their rows of Z: both are orthogonal to the same
// tensions (Gale duality; see Ziegler, "Lectures on polytopes", 1995). So all facets cost a product for each pair
// of cables and a few sums for each three.
#pragma once

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// `set` holds W with orthonormal rows but for rounding, and R + 2 cables.
template <class Set>
struct NullPlane {
  using V = typename Set::V;
  static constexpr int R = Set::kRank, kCables = R + 2;

  V basis[2][kCables];

  explicit NullPlane(const Set& set) {
    const auto& column = set.zonotope.column;
    V left[kCables];  // how much of each cable's own tension is in the plane, off the basis so far; squared
    for (int i = 0; i < kCables; ++i) left[i] = V{} + 1 - set.zonotope.square[i];
    for (V* const vector : {basis[0], basis[1]}) {
      V most = left[0], which{}, sum[R];
      for (int r = 0; r < R; ++r) sum[r] = column[0][r];
      for (int i = 1; i < kCables; ++i) {
        const auto more = left[i] > most;
        most = more ? left[i] : most;
        which = more ? V{} + i : which;
        for (int r = 0; r < R; ++r) sum[r] = more ? column[i][r] : sum[r];
      }
      // Its projection; the second pass takes away what the first leaves, as the rows are not quite orthonormal.
      for (int i = 0; i < kCables; ++i) vector[i] = (which == V{} + i ? V{} + 1 : V{}) - Set::dot(column[i], sum);
      for (int r = 0; r < R; ++r) {
        sum[r] = column[0][r] * vector[0];
        for (int i = 1; i < kCables; ++i) sum[r] += column[i][r] * vector[i];
      }
      V square{};
      for (int i = 0; i < kCables; ++i) {
        vector[i] -= Set::dot(column[i], sum);
        square += vector[i] * vector[i];
      }
      for (int i = 0; i < kCables; ++i) left[i] -= vector[i] * vector[i] / square;
    }
  }

  V tension_factor() const {
    constexpr double kDependent = 1e-11;
    V minor[kCables][kCables], least = V{} + 1;
    for (int i = 0; i < kCables; ++i) {
      for (int j = i + 1; j < kCables; ++j) {
        minor[i][j] = basis[0][i] * basis[1][j] - basis[0][j] * basis[1][i];
      }
    }
    for (int i = 0; i < kCables; ++i) {
      for (int j = i + 1; j < kCables; ++j) {
        for (int k = j + 1; k < kCables; ++k) {
          const V both = magnitude(minor[i][j]) + magnitude(minor[i][k]) + magnitude(minor[j][k]);
          const V difference = magnitude(V(minor[i][j] - minor[i][k] + minor[j][k]));
          const V factor = (both - difference) / (both + difference);
          least = both > V{} + kDependent ? smaller(least, factor) : least;
        }
      }
    }
    return larger(least, V{});
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
