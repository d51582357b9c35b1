// How far apart straight cables and bodies are. A cable is a segment, a body a segment with a radius (a capsule).
#pragma once

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class V>
struct Point {
  V x, y, z;
};
template <class V>
inline Point<V> operator-(const Point<V>& a, const Point<V>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class V>
inline V dot(const Point<V>& a, const Point<V>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

// A quotient, or the end of 0..1 that is nearest to it; 0 where there is no length to divide by.
template <class V>
inline V nearest_within(const V& numerator, const V& denominator) {
  const V none{}, all = none + 1.0;
  return denominator > none ? smaller(all, larger(none, V(numerator / denominator))) : none;
}

// Squared distance from segment (start a, extent u) to segment (start c, extent v).
//
// It is the least value of a convex quadratic |r + s u - t v|² over the square 0 <= s, t <= 1. With t free, the
// best s is that of the two whole lines, or the end nearest to it. If the t that belongs to it lies within the
// square, this is the least value; if not, one of the sides t = 0 and t = 1 has it, where an end of one segment
// meets the other segment (Lumelsky 1985). All three are points of the square, so rounding can only overestimate,
// and nearly parallel segments need no case of their own.
template <class V>
V squared_distance(const Point<V>& r, const Point<V>& u, const Point<V>& v) {
  const V uu = dot(u, u), vv = dot(v, v), uv = dot(u, v), ur = dot(u, r), vr = dot(v, r);
  const auto at = [&](const V& s, const V& t) {
    const Point<V> gap{r.x + s * u.x - t * v.x, r.y + s * u.y - t * v.y, r.z + s * u.z - t * v.z};
    return dot(gap, gap);
  };
  const V zero{}, one = zero + 1.0;
  const V s = nearest_within(V(uv * vr - vv * ur), V(uu * vv - uv * uv));
  const V inside = at(s, nearest_within(V(vr + s * uv), vv));
  const V sides = smaller(at(nearest_within(V(-ur), uu), zero), at(nearest_within(V(uv - ur), uu), one));
  return smaller(inside, sides);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
