// Distance of a segment from a box.
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

}  // namespace tensionlab
