// The closest pair of straight cables and bodies, with one pose in each lane. A cable is a segment, a body a
// segment with a radius (a capsule).
#include <algorithm>
#include <limits>

#include "tensionlab/simd/lanes.hpp"
#include "workspace/kernels.hpp"

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

// A quotient clipped to 0..1; 0 if the denominator is 0.
template <class V>
inline V nearest_within(const V& numerator, const V& denominator) {
  const V none{}, all = none + 1.0;
  return denominator > none ? smaller(all, larger(none, V(numerator / denominator))) : none;
}

// Squared distance from segment (start a, extent u) to segment (start c, extent v).
//
// It is the least value of a convex quadratic |r + s u - t v|² over the square 0 <= s, t <= 1. With t free, the
// best s is that of the two whole lines, clipped. If its t lies within the square, this is the least value; if
// not, one of the sides t = 0 and t = 1 has it, where an end of one segment meets the other segment (Lumelsky
// 1985). All three are points of the square, so rounding can only overestimate, and nearly parallel segments need
// no special case.
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

void clearance(const Segments& all, std::size_t begin, std::size_t end, double* distance, std::int64_t* closest) {
  constexpr int L = TENSIONLAB_LANES;
  using V = Lanes<double, L>;
  for (std::size_t row = begin; row < end; row += L) {
    const double* poses[L];
    for (int l = 0; l < L; ++l) {  // past the end, the last pose again
      poses[l] = all.ends[std::min(row + static_cast<std::size_t>(l), end - 1)];
    }
    V number[kMaxSegments * 6];
    transpose<double, L>(poses, 6 * all.segments, [&](int i, const V& v) { number[i] = v; });
    const auto point = [&](int i) { return Point<V>{number[3 * i], number[3 * i + 1], number[3 * i + 2]}; };

    V least = V{} + std::numeric_limits<double>::infinity(), which = V{} - 1.0;
    for (int p = 0; p < all.pairs; ++p) {
      const int i = static_cast<int>(all.pair[2 * p]), j = static_cast<int>(all.pair[2 * p + 1]);
      const Point<V> a = point(2 * i), c = point(2 * j);
      const V squared = squared_distance<V>(a - c, point(2 * i + 1) - a, point(2 * j + 1) - c);
      const V apart = square_root<double, L>(squared) - (all.radius[i] + all.radius[j]);
      which = apart < least ? V{} + static_cast<double>(p) : which;
      least = smaller(apart, least);
    }
    for (int l = 0; l < L && row + static_cast<std::size_t>(l) < end; ++l) {
      distance[row + static_cast<std::size_t>(l)] = read<double>(least, l);
      closest[row + static_cast<std::size_t>(l)] = static_cast<std::int64_t>(read<double>(which, l));
    }
  }
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
