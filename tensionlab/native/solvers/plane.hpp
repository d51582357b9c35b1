// Points of a plane, and convex polygons of them.
#pragma once

#include <cmath>

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real>
struct Point {
  Real x, y;
};
template <class Real>
Point<Real> operator+(Point<Real> p, Point<Real> q) {
  return {p.x + q.x, p.y + q.y};
}
template <class Real>
Point<Real> operator-(Point<Real> p, Point<Real> q) {
  return {p.x - q.x, p.y - q.y};
}
template <class Real>
Point<Real> operator*(Real s, Point<Real> p) {
  return {s * p.x, s * p.y};
}
template <class Real>
Real dot(Point<Real> p, Point<Real> q) {
  return p.x * q.x + p.y * q.y;
}
// Twice the area of the triangle (0, p, q); positive where q is to the left of p.
template <class Real>
Real cross(Point<Real> p, Point<Real> q) {
  return p.x * q.y - p.y * q.x;
}

// Corners of a convex polygon, anticlockwise. They may repeat: an edge has two corners, a point has one.
template <class Real, int Most>
struct Corners {
  int count = 0;
  Point<Real> at[Most];

  void add(Point<Real> p) {
    if (count < Most) at[count++] = p;
  }

  Point<Real> farthest_from(Point<Real> p) const {
    int best = 0;
    for (int i = 1; i < count; ++i) {
      if (dot(at[i] - p, at[i] - p) > dot(at[best] - p, at[best] - p)) best = i;
    }
    return at[best];
  }

  // The centre of area; the middle of an edge, where the polygon is no wider than that. The triangles are summed
  // from the first corner, none less than zero, so that rounding cannot lead out of the polygon.
  Point<Real> centroid(Real width) const {
    Point<Real> sum{0, 0};
    Real area = 0;
    for (int i = 1; i + 1 < count; ++i) {
      const Point<Real> p = at[i] - at[0], q = at[i + 1] - at[0];
      const Real twice = larger(cross(p, q), Real(0));
      area += twice;
      sum = sum + twice * (p + q);
    }
    const Point<Real> one = farthest_from(at[0]), other = farthest_from(one);
    const Real length = std::sqrt(dot(other - one, other - one));
    if (!(area > width * length)) return Real(0.5) * (one + other);
    return at[0] + (1 / (3 * area)) * sum;
  }

  // The face on which slope . p is least, but for a slack: a corner, an edge, or the whole polygon.
  Corners lowest(Point<Real> slope, Real slack) const {
    Real least = dot(slope, at[0]);
    for (int i = 1; i < count; ++i) least = smaller(least, dot(slope, at[i]));
    Corners face;
    for (int i = 0; i < count; ++i) {
      if (dot(slope, at[i]) <= least + slack) face.add(at[i]);
    }
    return face;
  }

  // The point on the edges that is closest to p.
  Point<Real> closest(Point<Real> p) const {
    Point<Real> best = at[0];
    for (int i = 0; i < count; ++i) {
      const Point<Real> edge = at[i + 1 < count ? i + 1 : 0] - at[i];
      const Real length = dot(edge, edge);
      const Real share = length > 0 ? smaller(larger(dot(edge, p - at[i]) / length, Real(0)), Real(1)) : Real(0);
      const Point<Real> q = at[i] + share * edge;
      if (dot(q - p, q - p) < dot(best - p, best - p)) best = q;
    }
    return best;
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
