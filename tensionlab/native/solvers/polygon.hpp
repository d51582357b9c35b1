// The polygon of the tensions that render one wrench inside their limits, where redundancy is at most two.
//
// Gouttefarde, Lamaury, Reichert, Bruckmann (2015): on the plane t = origin + x a + y b of all tensions that
// render the wrench, each limit of each cable is a line that keeps one side. From a crossing of two lines, walk
// along one of them with the kept side on the left. At the first line whose kept side would be left, turn onto it.
// At a line that was violated so far and whose kept side is entered there, go straight on: from here it is kept
// too, and the round starts again. A whole round with all lines kept has been around the polygon. A whole round
// without a gain proves that there is none.
#pragma once

#include <cmath>
#include <limits>

#include "solvers/pseudoinverse.hpp"

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

enum class Goal { centroid, least_sum, least_squares };

// Lengths are shares of the size of a problem: of the limits next to zero, of the point of the plane closest to
// them, and of the distance from it. So a dummy limit, such as 1e9 N, makes no other one coarse.
template <class Real>
struct PolygonTolerance {
  static constexpr Real kept = Real(1e-10);         // a limit violated by less is kept
  static constexpr Real parallel = Real(1e-9);      // lines at a smaller angle never meet
  static constexpr Real side_by_side = Real(1e-4);  // lines at a smaller angle meet at a point that rounding moves
  static constexpr Real thin = Real(1e-11);         // a polygon narrower than this is an edge
};

// One line for each limit; the distance to the limit is rest + normal . p, in N.
template <class Real, int M>
class Polygon {
  using Is = PolygonTolerance<Real>;
  static constexpr int kMost = 2 * M;  // lines

 public:
  int steps = 0;

  // Cables whose tension does not change along the basis have no lines.
  template <int N>
  Polygon(const Equilibrium<Real, N, M>& plane, const Real* origin, const Real (*basis)[M])
      : dimension_(plane.redundancy) {
    for (int i = 0; i < plane.cables.count; ++i) {
      const Real low = plane.cables.lower[i], high = plane.cables.upper[i];
      size_ = larger(size_, larger(magnitude(origin[i]), smaller(magnitude(low), magnitude(high))));
      const Point<Real> rise{dimension_ > 0 ? basis[0][i] : Real(0), dimension_ > 1 ? basis[1][i] : Real(0)};
      const Real length = std::sqrt(dot(rise, rise));
      if (length <= Is::parallel) continue;
      sum_ = sum_ + rise;
      add(origin[i] - low, rise, length);
      add(high - origin[i], Real(-1) * rise, length);
    }
  }

  // reference: the point of the plane that is closest to the reference.
  Point<Real> choose(Goal goal, Point<Real> reference) {
    if (goal == Goal::least_squares && contains(reference)) return reference;
    const Round polygon = dimension_ == 2 ? walk() : segment();
    if (goal == Goal::least_squares) return polygon.closest(reference);
    const Real width = Is::thin * size_;
    if (goal == Goal::centroid) return polygon.centroid(width);
    return polygon.lowest(sum_, Is::kept * size_).centroid(width);
  }

 private:
  using Round = Corners<Real, kMost + 4>;

  void add(Real rest, Point<Real> normal, Real length) {
    x_[lines_] = normal.x;
    y_[lines_] = normal.y;
    length_[lines_] = length;
    rest_[lines_++] = rest;
  }
  Point<Real> normal(int line) const { return {x_[line], y_[line]}; }
  Real room(int line, Point<Real> p) const { return rest_[line] + x_[line] * p.x + y_[line] * p.y; }

  // Along a line, with its kept side to the left.
  Point<Real> along(int line) const { return 1 / length_[line] * Point<Real>{y_[line], -x_[line]}; }

  // Where two lines cross, from a point near it.
  Point<Real> crossing(int i, int j, Point<Real> near) const {
    const Real p = room(i, near), q = room(j, near), area = cross(normal(i), normal(j));
    return near + (1 / area) * Point<Real>{q * y_[i] - p * y_[j], p * x_[j] - q * x_[i]};
  }

  bool contains(Point<Real> p) const {
    for (int i = 0; i < lines_; ++i) {
      if (!(room(i, p) >= 0)) return false;
    }
    return true;
  }

  // Redundancy one: an interval; zero: a point. Where the interval is empty, perhaps by rounding alone, the two
  // limits that make it so are violated equally.
  Round segment() const {
    const Real most = std::numeric_limits<Real>::max();
    Real low = -most, high = most, low_length = 0, high_length = 0;
    for (int i = 0; i < lines_; ++i) {
      const Real end = -rest_[i] / x_[i];
      if (x_[i] > 0 && end > low) {
        low = end;
        low_length = length_[i];
      }
      if (x_[i] < 0 && end < high) {
        high = end;
        high_length = length_[i];
      }
    }
    if (lines_ == 0) low = high = 0;
    if (low > high) low = high = low + (high - low) * (high_length / (low_length + high_length));
    Round ends;
    ends.add({low, 0});
    ends.add({high, 0});
    return ends;
  }

  struct Walker {
    int on;  // a line
    Point<Real> here, way;
    Real side[kMost];  // of each line: 1 where it is kept from here on, -1 where it is violated so far
  };

  // Starts at the crossing of the two cables that cross best, on the lines of their lower limits, along the one
  // that enters the kept side of the other. Both limits of both are kept there, so the walk cannot go to infinity.
  Walker start() const {
    int i = 0, j = 0;
    for (int k = 2; k < lines_; k += 2) {
      if (length_[k] > length_[i]) i = k;
    }
    for (int k = 0; k < lines_; k += 2) {
      if (magnitude(cross(normal(i), normal(k))) > magnitude(cross(normal(i), normal(j)))) j = k;
    }
    Walker walker;
    walker.on = dot(normal(j), along(i)) > 0 ? i : j;
    walker.here = crossing(i, j, {0, 0});
    walker.way = along(walker.on);
    for (int k = 0; k < lines_; ++k) walker.side[k] = -1;
    return walker;
  }

  struct Look {
    Real kept = 0;                                // lines kept here or before
    Real worst = 0;                               // largest violation of a limit here
    int next = -1;                                // the line that is met first ...
    Real far = std::numeric_limits<Real>::max();  // ... and how far away
  };
  Look look(Walker& walker) const {
    Look found;
    const Real slack = Is::kept * (size_ + magnitude(walker.here.x) + magnitude(walker.here.y)), never = found.far;
    Real rest[kMost], far[kMost];
    for (int i = 0; i < lines_; ++i) {
      rest[i] = room(i, walker.here);
      const Real side = rest[i] >= -slack ? Real(1) : walker.side[i];
      // A kept line is met from inside; a violated one from outside.
      const Real speed = -side * (x_[i] * walker.way.x + y_[i] * walker.way.y), gap = side * rest[i];
      far[i] = speed > Is::parallel * length_[i] ? (gap > 0 ? gap : Real(0)) / speed : never;
      walker.side[i] = side;
    }
    for (int i = 0; i < lines_; ++i) {
      found.kept += walker.side[i];
      found.worst = larger(found.worst, -rest[i]);
      found.next = far[i] < found.far ? i : found.next;
      found.far = smaller(far[i], found.far);
    }
    return found;
  }

  Round walk() {
    Walker walker = start();
    Point<Real> first = walker.way, best = walker.here;
    Real least = std::numeric_limits<Real>::max(), kept = -least;
    bool half = false;
    Round round;
    for (steps = 0; steps < (lines_ + 1) * (lines_ + 2); ++steps) {
      const Look ahead = look(walker);
      if (ahead.worst < least) {
        least = ahead.worst;
        best = walker.here;
      }
      if (ahead.kept > kept) {
        kept = ahead.kept;
        first = walker.way;
        half = false;
        round.count = 0;
      }
      round.add(walker.here);
      const Real turned = cross(first, walker.way);
      const bool back = turned < -Is::parallel || (dot(first, walker.way) < 0 && turned <= Is::parallel);
      if (ahead.next < 0 || (half && !back)) break;
      half = half || back;

      walker.here = walker.here + ahead.far * walker.way;
      const Real angle = cross(normal(walker.on), normal(ahead.next)) / (length_[walker.on] * length_[ahead.next]);
      // A second step removes the rounding of a long first one.
      if (magnitude(angle) > Is::side_by_side) walker.here = crossing(walker.on, ahead.next, walker.here);
      if (walker.side[ahead.next] < 0) {
        walker.side[ahead.next] = 1;  // entered
      } else {
        walker.on = ahead.next;
        walker.way = along(walker.on);
      }
    }
    if (kept < Real(lines_)) {  // infeasible: where the limits are violated least
      round.count = 0;
      round.add(best);
    }
    return round;
  }

  int dimension_, lines_ = 0;
  Real size_ = 0;
  Point<Real> sum_{0, 0};  // where the sum of tensions rises
  Real x_[kMost] = {}, y_[kMost] = {}, length_[kMost], rest_[kMost];
};

// Finds tensions for one problem. Returns the redundancy; above two there are none.
template <class Real, int N, int M>
int polygon_tensions(const LooseCables<Real, N, M>& loose, const Real* reference, Goal goal, Real rank_tolerance,
                     Real* tensions, int* steps) {
  const Equilibrium<Real, N, M> plane(loose, rank_tolerance);
  if (plane.redundancy > 2) return plane.redundancy;
  Real origin[M], basis[2][M];
  for (int i = 0; i < loose.count; ++i) {
    origin[i] = magnitude(loose.lower[i]) <= magnitude(loose.upper[i]) ? loose.lower[i] : loose.upper[i];
  }
  plane.project(origin);
  plane.null_space(basis);
  Real coordinates[2] = {0, 0};  // of the point of the plane that is closest to the reference
  for (int d = 0; d < plane.redundancy; ++d) {
    for (int i = 0; i < loose.count; ++i) coordinates[d] += basis[d][i] * (reference[loose.index[i]] - origin[i]);
  }

  Polygon<Real, M> polygon(plane, origin, basis);
  const Point<Real> chosen = polygon.choose(goal, {coordinates[0], coordinates[1]});
  *steps = polygon.steps;
  for (int i = 0; i < loose.count; ++i) {
    tensions[i] = origin[i];
    if (plane.redundancy > 0) tensions[i] += chosen.x * basis[0][i];
    if (plane.redundancy > 1) tensions[i] += chosen.y * basis[1][i];
  }
  return plane.redundancy;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
