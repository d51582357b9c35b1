// Distances of a segment from a box and from another segment.
#pragma once

#include <algorithm>
#include <cmath>

namespace tensionlab {

// Box with a centre, axes as the columns of a matrix, row by row, and half of its edges. Without one edge it is a
// rectangle, with one alone a segment, without any a point.
struct Box {
  const double *centre, *axes, *half;
};

// The square of the distance is convex along the segment, and its slope is linear between the places where the
// segment crosses the planes of the faces. Zero only where the segment touches or enters the box.
inline double segment_box_distance(const double* begin, const double* end, const Box& box) {
  double start[3], along[3];
  for (int i = 0; i < 3; ++i) {
    start[i] = along[i] = 0.0;
    for (int j = 0; j < 3; ++j) {
      start[i] += box.axes[3 * j + i] * (begin[j] - box.centre[j]);
      along[i] += box.axes[3 * j + i] * (end[j] - begin[j]);
    }
  }
  const auto excess = [&](int i, double share) {  // from the nearest point of the box along an axis
    const double at = start[i] + share * along[i];
    return at - std::clamp(at, -box.half[i], box.half[i]);
  };
  const auto slope = [&](double share) {
    return excess(0, share) * along[0] + excess(1, share) * along[1] + excess(2, share) * along[2];
  };
  double low = 0.0, high = 1.0, falls = slope(low), rises = slope(high);
  if (falls >= 0.0 || rises <= 0.0) {
    low = falls >= 0.0 ? 0.0 : 1.0;
  } else {
    for (int i = 0; i < 6; ++i) {
      const double crossing = ((i < 3 ? -box.half[i % 3] : box.half[i % 3]) - start[i % 3]) / along[i % 3];
      if (!(crossing > low && crossing < high)) continue;
      const double there = slope(crossing);
      (there < 0.0 ? low : high) = crossing;
      (there < 0.0 ? falls : rises) = there;
    }
    low += (high - low) * falls / (falls - rises);
  }
  return std::hypot(excess(0, low), excess(1, low), excess(2, low));
}

// The other segment as a box with one edge.
inline double segment_segment_distance(const double* begin, const double* end, const double* first,
                                       const double* last) {
  double centre[3], along[3], axes[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  for (int i = 0; i < 3; ++i) {
    centre[i] = 0.5 * (first[i] + last[i]);
    along[i] = last[i] - first[i];
  }
  const double length = std::hypot(along[0], along[1], along[2]);
  if (length > 0.0) {  // Duff et al., "Building an orthonormal basis, revisited", 2017
    const double x = along[0] / length, y = along[1] / length, z = along[2] / length;
    const double sign = std::copysign(1.0, z), a = -1.0 / (sign + z), b = x * y * a;
    const double columns[9] = {x, 1.0 + sign * x * x * a, b, y, sign * b, sign + y * y * a, z, -sign * x, -y};
    std::copy_n(columns, 9, axes);
  }
  const double half[3] = {0.5 * length, 0.0, 0.0};
  return segment_box_distance(begin, end, {centre, axes, half});
}

}  // namespace tensionlab
