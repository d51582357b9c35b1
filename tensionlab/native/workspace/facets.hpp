// The facets themselves: the one that sets the capacity margin, and all of them as half-spaces.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>

#include "solvers/pseudoinverse.hpp"
#include "workspace/metrics.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// The capacity margin, with the outward unit normal of the facet that sets it, and the index of the wrench nearest
// to that facet, or furthest beyond. The normal is zero where a wrench lies in a flat set.
struct ActiveFacet {
  const Wrenches& wrenches;
  int n;
  double* normals;
  std::int64_t* numbers;

  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&row)[Set::kLanes]) const {
    constexpr int L = Set::kLanes;
    V least = V{} + kInfinity, active[Set::kRank] = {}, number{};
    V furthest_off{}, off[Set::kComponents] = {};
    int number_off = 0;
    for (int first = 0; first < wrenches.count; first += RelativeWrenches<Set>::kMost) {
      const RelativeWrenches<Set> seen(set, wrenches, row, n, first);
      set.zonotope.facets([&](const V* normal, const V& height, const auto& spans) {
        V along = Set::dot(normal, seen.offset[0]), nearest = V{} + first;
        for (int j = 1; j < seen.count; ++j) {
          const V other = Set::dot(normal, seen.offset[j]);
          const auto nearer = magnitude(other) > magnitude(along);
          along = nearer ? other : along;
          nearest = nearer ? V{} + (first + j) : nearest;
        }
        const V room = height - magnitude(along), distance = room * magnitude(room) / set.square(normal);
        const auto closer = spans & (distance < least);
        least = closer ? distance : least;
        number = closer ? nearest : number;
        for (int r = 0; r < Set::kRank; ++r) {
          active[r] = closer ? (along < V{} ? V(-normal[r]) : normal[r]) : active[r];
        }
      });
      if constexpr (Set::kMayBeFlat) {
        for (int j = 0; j < seen.count && set.flat(); ++j) {
          double left[Set::kComponents];
          if (set.off_range(seen.wrench[j], left) <= furthest_off) continue;
          furthest_off = set.off_range(seen.wrench[j], off);
          number_off = first + j;
        }
      }
    }
    const V length = square_root<double, L>(set.square(active));
    for (int l = 0; l < L; ++l) numbers[row[l]] = static_cast<std::int64_t>(read<double>(number, l));
    for (int k = 0; k < n; ++k) {
      const V component = set.component(active, k) / length;
      for (int l = 0; l < L; ++l) normals[row[l] * static_cast<std::size_t>(n) + k] = read<double>(component, l);
    }
    const V distance = square_root<double, L>(magnitude(least)), margin = least < V{} ? V(-distance) : distance;
    if constexpr (Set::kMayBeFlat) {
      if (set.flat() && -furthest_off <= margin) {
        numbers[row[0]] = number_off;
        for (int k = 0; k < n; ++k) {
          normals[row[0] * static_cast<std::size_t>(n) + k] = furthest_off > 0 ? off[k] / furthest_off : 0.0;
        }
        return -furthest_off;
      }
    }
    return margin;
  }
};

// The tensions in that facet whose wrench is nearest to that wrench: cables that pull outwards are at their upper
// limits, those that pull inwards at their lower ones, and those that lie in the facet render the rest.
template <int N>
void tensions_in_facet(const Pose& pose, int m, const double* normal, const double* wrench, double rank_tolerance,
                       double* tensions) {
  constexpr double kAlong = 1e-9;  // largest share of a column along the normal of a cable that lies in the facet
  double in_facet[N * kMaxCables];
  for (int i = 0; i < m; ++i) {
    double along = 0, square = 0;
    for (int k = 0; k < N; ++k) {
      along += normal[k] * pose.structure[k * m + i];
      square += pose.structure[k * m + i] * pose.structure[k * m + i];
    }
    const bool lies = along * along <= kAlong * kAlong * square && pose.lower[i] < pose.upper[i];
    for (int k = 0; k < N; ++k) in_facet[k * m + i] = lies ? pose.structure[k * m + i] : 0;
    tensions[i] = lies ? 0 : along > 0 ? pose.upper[i] : pose.lower[i];
  }
  Pseudoinverse<double, N, kMaxCables>(in_facet, m, rank_tolerance).project(pose.structure, wrench, tensions);
}

// Unit normals and offsets of half-spaces whose intersection is the set, followed by copies of the last up to
// `capacity`. The value is their number; those beyond the capacity are left out.
struct HalfSpaces {
  int n;
  std::size_t capacity;
  double *normals, *offsets;

  template <class Set, class V = typename Set::V>
  V operator()(const Set& set, const std::size_t (&row)[Set::kLanes]) const {
    constexpr int L = Set::kLanes;
    std::size_t used[L] = {};
    set.zonotope.facets([&](const V* normal, const V& height, const auto& spans) {
      const V length = square_root<double, L>(set.square(normal));
      V unit[Set::kComponents], middle{};
      for (int k = 0; k < n; ++k) {
        unit[k] = set.component(normal, k) / length;
        middle += unit[k] * set.centre[k];
      }
      const V reach = height / length;
      for (int l = 0; l < L; ++l) {
        if (read<double>(spans ? V{} + 1 : V{}, l) == 0) continue;
        double each[kMaxComponents];
        for (int k = 0; k < n; ++k) each[k] = read<double>(unit[k], l);
        add(row[l], used[l], each, read<double>(middle, l), read<double>(reach, l));
      }
    });
    if constexpr (Set::kMayBeFlat) add_plane(set, row[0], used[0]);
    for (int l = 0; l < L; ++l) {
      for (std::size_t i = used[l]; i < capacity && used[l] > 0; ++i) copy(row[l], used[l] - 1, i);
    }
    return gather<double, L>([&](int l) { return static_cast<double>(used[l]); });
  }

 private:
  // normal . (w - centre) between -reach and reach.
  void add(std::size_t row, std::size_t& used, const double* normal, double middle, double reach) const {
    for (const double sign : {1.0, -1.0}) {
      if (used < capacity) {
        double* const to = normals + (row * capacity + used) * static_cast<std::size_t>(n);
        for (int k = 0; k < n; ++k) to[k] = sign * normal[k];
        offsets[row * capacity + used] = sign * middle + reach;
      }
      ++used;
    }
  }

  void copy(std::size_t row, std::size_t from, std::size_t to) const {
    const double* const normal = normals + (row * capacity + from) * static_cast<std::size_t>(n);
    std::copy(normal, normal + n, normals + (row * capacity + to) * static_cast<std::size_t>(n));
    offsets[row * capacity + to] = offsets[row * capacity + from];
  }

  // The plane of a flat set, from both sides, by an orthonormal basis of the complement of the range.
  template <class Set>
  void add_plane(const Set& set, std::size_t row, std::size_t& used) const {
    double left[kMaxComponents][kMaxComponents] = {};
    for (int k = 0; k < n; ++k) {
      left[k][k] = 1;
      set.subtract_range(left[k]);
    }
    for (int found = set.rank; found < n; ++found) {
      const auto square = [](const double* v) { return std::inner_product(v, v + kMaxComponents, v, 0.0); };
      const double* const longest = *std::max_element(
          left, left + n, [&](const double* a, const double* b) { return square(a) < square(b); });
      double unit[kMaxComponents];
      for (int k = 0; k < kMaxComponents; ++k) unit[k] = longest[k] / std::sqrt(square(longest));
      add(row, used, unit, std::inner_product(unit, unit + kMaxComponents, set.centre, 0.0), 0);
      for (int i = 0; i < n; ++i) {
        const double share = std::inner_product(unit, unit + kMaxComponents, left[i], 0.0);
        for (int k = 0; k < kMaxComponents; ++k) left[i][k] -= share * unit[k];
      }
    }
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
