// What the facets of an available wrench set say about it: measures, one number for the pose in each lane.
#pragma once

#include <algorithm>
#include <cstddef>

#include "simd/checkpoint.hpp"
#include "workspace/null_plane.hpp"
#include "workspace/workspace_batch.hpp"
#include "workspace/wrench_set.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The next wrenches of each pose, from number `first` on, seen from the centre of its set.
template <class Set>
struct Seen {
  using V = typename Set::V;
  static constexpr int kMost = 32;

  V wrench[kMost][Set::kComponents];
  V offset[kMost][Set::kRank];  // the same in the coordinates of the set
  int count;

  Seen(const Set& set, const Wrenches& wrenches, const std::size_t (&row)[Set::kLanes], int n, int first)
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

// The least signed distance from one of the wrenches to a facet; off the range of W the set ends at once.
struct CapacityMargin {
  const Wrenches& wrenches;
  int n;

  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&row)[Set::kLanes]) const {
    V least = V{} + kInfinity, off_range{};
    for (int first = 0; first < wrenches.count; first += Seen<Set>::kMost) {
      const Seen<Set> seen(set, wrenches, row, n, first);
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

// The largest ratio of least to largest tension without a wrench. Tensions between 1 and tau have one if zero is
// inside all facets: what pulls along a normal and what pulls against it differ by a factor of at most tau.
struct TensionFactor {
  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&)[Set::kLanes]) const {
    if constexpr (Set::kLanes > 1 && Set::kRank > 3) {
      if (set.zonotope.count == Set::kRank + 2) return NullPlane<Set>(set).tension_factor();
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

// The largest force that can be rendered in all directions of the first `dimension` components, the others zero.
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
      // A facet along all forces bounds none of them, if zero is inside it.
      const V bound = room < -kRounding * (height + away) ? V{} - 1 : V{} + kInfinity;
      return square > kRounding * kRounding * set.square(normal) ? V(room * magnitude(room) / square) : bound;
    });
    const V force = square_root<double, Set::kLanes>(larger(least, V{}));
    return set.flat() ? (inside(set) ? force : V{}) : force;
  }

 private:
  // Whether the range of W, about the centre of a flat set, holds zero and all forces.
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

// The share of the wrenches that are no further outside than the tolerance.
struct ReachableShare {
  const Wrenches& wrenches;
  int n;
  double tolerance;

  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&row)[Set::kLanes]) const {
    V reached{};
    for (int first = 0; first < wrenches.count; first += Seen<Set>::kMost) {
      const Seen<Set> seen(set, wrenches, row, n, first);
      V outside[Seen<Set>::kMost];
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
