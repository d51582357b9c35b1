// Distances of a segment from a box and from another segment.
#pragma once

#include <algorithm>
#include <cmath>

namespace tensionlab {

// Box with a centre, axes as the columns of a matrix, row by row, and half of its edges.
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

// Lumelsky, "On fast computation of distance between line segments", 1985. The least value of a convex quadratic
// |r + s u - t v|^2 over the square 0 <= s, t <= 1. With t free, the best s is that of the two whole lines,
// clipped. If its t lies within the square, this is the least value; if not, one of the sides t = 0 and t = 1 has
// it, where an end of one segment meets the other segment. All three are points of the square, so rounding can
// only overestimate, and nearly parallel segments need no special case.
inline double segment_segment_distance(const double* begin, const double* end, const double* first,
                                       const double* last) {
  double r[3], u[3], v[3], uu = 0.0, vv = 0.0, uv = 0.0, ur = 0.0, vr = 0.0;
  for (int i = 0; i < 3; ++i) {
    r[i] = begin[i] - first[i], u[i] = end[i] - begin[i], v[i] = last[i] - first[i];
    uu += u[i] * u[i], vv += v[i] * v[i], uv += u[i] * v[i], ur += u[i] * r[i], vr += v[i] * r[i];
  }
  const auto share = [](double numerator, double denominator) {
    return denominator > 0.0 ? std::clamp(numerator / denominator, 0.0, 1.0) : 0.0;
  };
  const auto squared = [&](double s, double t) {
    double sum = 0.0;
    for (int i = 0; i < 3; ++i) {
      const double gap = r[i] + s * u[i] - t * v[i];
      sum += gap * gap;
    }
    return sum;
  };
  const double s = share(uv * vr - vv * ur, uu * vv - uv * uv);
  return std::sqrt(std::min(
      {squared(s, share(vr + s * uv, vv)), squared(share(-ur, uu), 0.0), squared(share(uv - ur, uu), 1.0)}));
}

}  // namespace tensionlab
