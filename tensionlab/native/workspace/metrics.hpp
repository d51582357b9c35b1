// Measures of an available wrench set by its facets: one number for the pose in each lane.
#pragma once

#include <algorithm>
#include <cstddef>

#include "workspace/kernels.hpp"
#include "workspace/wrench_set.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The next wrenches of each pose, from number `first` on, relative to the centre of its set.
template <class Set>
struct RelativeWrenches {
  using V = typename Set::V;
  static constexpr int kMost = 32;

  V wrench[kMost][Set::kComponents];
  V offset[kMost][Set::kRank];  // the same in the coordinates of the set
  int count;

  RelativeWrenches(const Set& set, const Wrenches& wrenches, const std::size_t (&row)[Set::kLanes], int n,
                   int first)
      : count(std::min(wrenches.count - first, kMost)) {
    checkpoint();
    for (int j = 0; j < count; ++j) {
      const std::ptrdiff_t start = static_cast<std::ptrdiff_t>(first + j) * n;
      for (int k = 0; k < Set::kComponents; ++k) {
        wrench[j][k] = V{};
        if (k < n) {
          wrench[j][k] = gather<double, Set::kLanes>([&](int l) { return wrenches.rows[row[l]][start + k]; });
          wrench[j][k] -= set.centre[k];
        }
      }
      set.transform(wrench[j], offset[j]);
    }
  }
};

// The least signed distance from a wrench to a facet; off the range of W a wrench is outside.
struct CapacityMargin {
  const Wrenches& wrenches;
  int n;

  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&row)[Set::kLanes]) const {
    V least = V{} + kInfinity, off_range{};
    for (int first = 0; first < wrenches.count; first += RelativeWrenches<Set>::kMost) {
      const RelativeWrenches<Set> seen(set, wrenches, row, n, first);
      least = set.least(least, [&](const V* normal, const V& height) {
        V furthest{};
        for (int j = 0; j < seen.count; ++j) {
          furthest = larger(furthest, magnitude(Set::dot(normal, seen.offset[j])));
        }
        const V room = height - furthest;
        return V(room * magnitude(room) / set.square(normal));  // the distance squared, with its sign
      });
      for (int j = 0; j < seen.count; ++j) off_range = larger(off_range, set.off_range(seen.wrench[j]));
    }
    const V distance = square_root<double, Set::kLanes>(magnitude(least));
    const V margin = least < V{} ? V(-distance) : distance;
    return set.flat() ? smaller(margin, V(V{} - off_range)) : margin;
  }
};

// The plane of tensions without a wrench, for the tension factor of R + 2 cables; `set` holds W with orthonormal
// rows, up to rounding. With a basis of that plane as the columns of Z, what three cables pull along the normal
// that all others are across is, up to a common factor, the 2 x 2 minors of their rows of Z: both are orthogonal
// to the same tensions (Gale duality; Ziegler, "Lectures on polytopes", 1995). So all facets cost a product for
// each pair of cables and a few sums for each three.
template <class Set>
struct NullPlane {
  using V = typename Set::V;
  static constexpr int R = Set::kRank, kCables = R + 2;

  V basis[2][kCables];

  explicit NullPlane(const Set& set) {
    const auto& column = set.zonotope.column;
    V rest[kCables];  // squared part of each cable's own tension in the plane, off the basis so far
    for (int i = 0; i < kCables; ++i) rest[i] = V{} + 1 - set.zonotope.square[i];
    for (V* const vector : {basis[0], basis[1]}) {
      V most = rest[0], which{}, sum[R];
      for (int r = 0; r < R; ++r) sum[r] = column[0][r];
      for (int i = 1; i < kCables; ++i) {
        const auto more = rest[i] > most;
        most = more ? rest[i] : most;
        which = more ? V{} + i : which;
        for (int r = 0; r < R; ++r) sum[r] = more ? column[i][r] : sum[r];
      }
      // Its projection, twice, as the rows are not quite orthonormal.
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
      for (int i = 0; i < kCables; ++i) rest[i] -= vector[i] * vector[i] / square;
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

// The largest ratio of least to largest tension without a wrench. It is 1 / tau if tensions between 1 and tau have
// none: the pulls along a normal and against it then differ by a factor of at most tau.
struct TensionFactor {
  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&)[Set::kLanes]) const {
    if constexpr (Set::kLanes > 1 && Set::kRank > 3) {
      if (has(Route::null_plane) && set.zonotope.count == Set::kRank + 2)
        return NullPlane<Set>(set).tension_factor();
    }
    V sum[Set::kRank];
    set.transform(set.centre, sum);
    const V factor = set.least(V{} + 1, [&](const V* normal, const V& both) {
      const V difference = magnitude(Set::dot(normal, sum));
      return V((both - difference) / (both + difference));
    });
    return set.flat() ? V{} : larger(factor, V{});
  }
};

// The largest force that is feasible in all directions of the first `dimension` components, with the others zero.
struct IsotropicForce {
  int dimension;

  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&)[Set::kLanes]) const {
    constexpr double kRounding = 1e-12;
    V centre[Set::kRank];
    set.transform(set.centre, centre);
    const V least = set.least(V{} + kInfinity, [&](const V* normal, const V& height) {
      const V away = magnitude(Set::dot(normal, centre)), room = height - away,
              square = set.square(normal, dimension);
      // A facet parallel to all forces bounds none of them, if zero is inside it.
      const V bound = room < -kRounding * (height + away) ? V{} - 1 : V{} + kInfinity;
      return square > kRounding * kRounding * set.square(normal) ? V(room * magnitude(room) / square) : bound;
    });
    const V force = square_root<double, Set::kLanes>(larger(least, V{}));
    return set.flat() ? (inside(set) ? force : V{}) : force;
  }

 private:
  // Whether the range of W, about the centre of a flat set, contains zero and all forces.
  template <class Set, class V = typename Set::V>
  bool inside(const Set& set) const {
    bool all = !any(set.off_range(set.centre) > V{});
    for (int k = 0; k < dimension; ++k) {
      V force[Set::kComponents] = {};
      force[k] = V{} + (set.size + 1);
      all = all && !any(set.off_range(force) > V{});
    }
    return all;
  }
};

// The fraction of the wrenches that are outside by at most the tolerance.
struct FeasibleDirectionFraction {
  const Wrenches& wrenches;
  int n;
  double tolerance;

  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&row)[Set::kLanes]) const {
    V reached{};
    for (int first = 0; first < wrenches.count; first += RelativeWrenches<Set>::kMost) {
      const RelativeWrenches<Set> seen(set, wrenches, row, n, first);
      V outside[RelativeWrenches<Set>::kMost];
      for (int j = 0; j < seen.count; ++j) outside[j] = set.off_range(seen.wrench[j]);
      set.zonotope.facets([&](const V* normal, const V& height, const auto& spans) {
        const V length = square_root<double, Set::kLanes>(set.square(normal));
        const V inverse = spans ? 1 / length : V{};
        for (int j = 0; j < seen.count; ++j) {
          const V beyond = magnitude(Set::dot(normal, seen.offset[j])) - height;
          outside[j] = larger(outside[j], V(beyond * inverse));
        }
      });
      for (int j = 0; j < seen.count; ++j) reached += outside[j] > V{} + tolerance ? V{} : V{} + 1;
    }
    return reached / wrenches.count;
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
