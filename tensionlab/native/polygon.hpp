// The polygon of the tensions that render one wrench inside their limits, where redundancy is at most two.
//
// Gouttefarde, Lamaury, Reichert, Bruckmann (2015): on the plane t = origin + x a + y b of all tensions that
// render the wrench, each cable leaves a strip between two parallel bound lines. From a corner where two strips
// cross, walk along a bound line with the strips on the left. At the first line that would be left, turn onto it;
// at a line that had been missed and is now entered, go on: from there it is kept too, and the round begins anew.
// A whole round with no line missing has been around the polygon. A whole round without a gain proves that there
// is none.
#pragma once

#include "equilibrium.hpp"
#include "plane.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

enum class Goal { centroid, least_sum, least_squares };

// Shares of the size of a problem: of the limits next to zero, of the point of the plane closest to them, and of
// how far from it one looks. A limit without meaning, 1e9 N for none, then makes no other one coarse.
template <class Real>
struct PolygonTolerance {
  static constexpr Real kept = Real(1e-10);     // a limit missed by less is kept
  static constexpr Real parallel = Real(1e-9);  // a line at less than this angle is never met
  static constexpr Real side_by_side = Real(1e-4);
  static constexpr Real thin = Real(1e-11);  // a polygon narrower than this is an edge
};

template <class Real, int M>
class Strips {
  using Is = PolygonTolerance<Real>;

 public:
  using Polygon = Corners<Real, 2 * M + 4>;
  int steps = 0;

  // The cables whose tension changes along the basis; the others have no lines.
  template <int N>
  Strips(const Equilibrium<Real, N, M>& plane, const Real* origin, const Real (*basis)[M], const Real* lower,
         const Real* upper)
      : dimension_(plane.redundancy()) {
    for (int i = 0; i < plane.cables.count; ++i) {
      const int cable = plane.cables.index[i];
      const Point<Real> normal{dimension_ > 0 ? basis[0][i] : Real(0), dimension_ > 1 ? basis[1][i] : Real(0)};
      const Real length = std::sqrt(dot(normal, normal)), low = lower[cable], high = upper[cable];
      size_ = larger(size_, larger(magnitude(origin[i]), smaller(magnitude(low), magnitude(high))));
      if (length <= Is::parallel) continue;
      normal_x_[count_] = normal.x;
      normal_y_[count_] = normal.y;
      length_[count_] = length;
      origin_[count_] = origin[i];
      lower_[count_] = low;
      upper_[count_++] = high;
    }
  }

  Point<Real> choose(Goal goal, Point<Real> reference) {
    if (goal == Goal::least_squares && contains(reference)) return reference;
    const Polygon polygon = dimension_ == 2 ? walk() : segment();
    if (goal == Goal::least_squares) return polygon.closest(reference);
    const Real width = Is::thin * size_;
    if (goal == Goal::centroid) return polygon.centroid(width);
    Point<Real> sum{0, 0};
    for (int i = 0; i < count_; ++i) sum = sum + normal(i);
    return polygon.lowest(sum, Is::kept * size_).centroid(width);
  }

 private:
  // Where the tension of a cable rises most.
  Point<Real> normal(int cable) const { return {normal_x_[cable], normal_y_[cable]}; }

  Real tension(int cable, Point<Real> p) const {
    return origin_[cable] + normal_x_[cable] * p.x + normal_y_[cable] * p.y;
  }

  bool contains(Point<Real> p) const {
    for (int i = 0; i < count_; ++i) {
      if (!(tension(i, p) >= lower_[i] && tension(i, p) <= upper_[i])) return false;
    }
    return true;
  }

  // Redundancy one: an interval. Redundancy none: a point. Where the interval is empty, the two cables that want
  // it so miss their limits by the same.
  Polygon segment() const {
    const Real most = std::numeric_limits<Real>::max();
    Real low = -most, high = most, low_length = 0, high_length = 0;
    for (int i = 0; i < count_; ++i) {
      const Real p = (lower_[i] - origin_[i]) / normal_x_[i], q = (upper_[i] - origin_[i]) / normal_x_[i];
      if (smaller(p, q) > low) {
        low = smaller(p, q);
        low_length = length_[i];
      }
      if (larger(p, q) < high) {
        high = larger(p, q);
        high_length = length_[i];
      }
    }
    if (count_ == 0) low = high = 0;
    if (low > high) low = high = low + (high - low) * (high_length / (low_length + high_length));
    Polygon ends;
    ends.add({low, 0});
    ends.add({high, 0});
    return ends;
  }

  // Where one cable has tension p and another q, from a point near it.
  Point<Real> crossing(int i, Real p, int j, Real q, Point<Real> near) const {
    p -= tension(i, near);
    q -= tension(j, near);
    const Real area = cross(normal(i), normal(j));
    return near +
           (1 / area) * Point<Real>{p * normal_y_[j] - q * normal_y_[i], q * normal_x_[i] - p * normal_x_[j]};
  }

  bool crosses(int i, int j) const {
    return magnitude(cross(normal(i), normal(j))) > Is::side_by_side * length_[i] * length_[j];
  }

  // Along the line of a cable: its strip lies to the left. side: 1 on the lower line, -1 on the upper one.
  Point<Real> along(int cable, Real side) const {
    const Real scale = side / length_[cable];
    return {scale * normal_y_[cable], -scale * normal_x_[cable]};
  }

  // The walk: along which line, from where, which way, and the limits that are kept from here on.
  struct Walker {
    int on;
    Real line;  // the tension of that cable
    Point<Real> here, way;
    bool low[M] = {}, high[M] = {};
  };

  // At the crossing of the two cables that cross best, on the lines of their limits next to zero, and along the
  // one that leads into the strip of the other.
  Walker start() const {
    int i = 0, j = 0;
    for (int k = 1; k < count_; ++k) {
      if (length_[k] > length_[i]) i = k;
    }
    for (int k = 0; k < count_; ++k) {
      if (magnitude(cross(normal(i), normal(k))) > magnitude(cross(normal(i), normal(j)))) j = k;
    }
    const Real side_i = magnitude(lower_[i]) <= magnitude(upper_[i]) ? Real(1) : Real(-1);
    const Real side_j = magnitude(lower_[j]) <= magnitude(upper_[j]) ? Real(1) : Real(-1);
    const Real p = side_i > 0 ? lower_[i] : upper_[i], q = side_j > 0 ? lower_[j] : upper_[j];
    const Point<Real> here = crossing(i, p, j, q, {0, 0}), way = along(i, side_i);
    Walker walker{i, p, here, way};
    if (!(side_j * dot(normal(j), way) > 0)) walker = {j, q, here, along(j, side_j)};
    walker.low[i] = walker.high[i] = walker.low[j] = walker.high[j] = true;
    return walker;
  }

  // What the walker sees.
  struct Look {
    int kept = 0;                                 // limits kept here, or before
    Real worst = 0;                               // by how much a limit is missed here at most
    int next = -1;                                // the cable whose line is met first ...
    Real far = std::numeric_limits<Real>::max();  // ... how far away ...
    bool in = false;                              // ... and whether it is entered there
  };
  // Selections instead of branches, which the processor could only guess.
  Look look(Walker& walker) const {
    Look found;
    const Real slack = Is::kept * (size_ + magnitude(walker.here.x) + magnitude(walker.here.y)), never = found.far;
    Real far[M];
    for (int i = 0; i < count_; ++i) {
      const Real t = tension(i, walker.here), rate = dot(normal(i), walker.way), speed = magnitude(rate);
      const Real under = lower_[i] - t, over = t - upper_[i];
      walker.low[i] |= under <= slack;
      walker.high[i] |= over <= slack;
      found.kept += walker.low[i] + walker.high[i];
      found.worst = larger(found.worst, larger(under, over));
      const bool inside = rate > 0 ? walker.low[i] : walker.high[i],
                 turns = rate > 0 ? walker.high[i] : walker.low[i];
      const Real gap = larger(rate > 0 ? (inside ? -over : under) : (inside ? -under : over), Real(0));
      far[i] = (speed > Is::parallel * length_[i]) & (turns | !inside) ? gap / speed : never;
    }
    far[walker.on] = never;
    for (int i = 0; i < count_; ++i) {
      found.next = far[i] < found.far ? i : found.next;
      found.far = smaller(far[i], found.far);
    }
    if (found.next >= 0) {
      const bool rises = dot(normal(found.next), walker.way) > 0;
      found.in = !(rises ? walker.low[found.next] : walker.high[found.next]);
    }
    return found;
  }

  Polygon walk() {
    Walker walker = start();
    Point<Real> first = walker.way, best = walker.here;
    Real least = std::numeric_limits<Real>::max();
    int kept = 0;
    bool half = false;
    Polygon round;
    for (steps = 0; steps < (2 * count_ + 1) * (2 * count_ + 2); ++steps) {
      const Look ahead = look(walker);
      if (ahead.worst < least) {
        least = ahead.worst;
        best = walker.here;
      }
      if (ahead.kept > kept) {
        kept = ahead.kept;
        round.count = 0;
        first = walker.way;
        half = false;
      }
      round.add(walker.here);
      const Real turned = cross(first, walker.way);
      const bool beyond = turned < -Is::parallel || (dot(first, walker.way) < 0 && turned <= Is::parallel);
      if (half && !beyond) break;
      half = half || beyond;
      if (ahead.next < 0) break;

      const bool rises = dot(normal(ahead.next), walker.way) > 0;
      const Real line = rises == ahead.in ? lower_[ahead.next] : upper_[ahead.next];
      walker.here = walker.here + ahead.far * walker.way;
      // A second step removes the rounding of a long first one, where the lines do not run side by side.
      if (crosses(walker.on, ahead.next)) {
        walker.here = crossing(walker.on, walker.line, ahead.next, line, walker.here);
      }
      if (ahead.in) continue;
      walker.on = ahead.next;
      walker.line = line;
      walker.way = along(ahead.next, rises ? Real(-1) : Real(1));
    }
    if (kept < 2 * count_) {  // out of reach: where the limits are missed by least
      round.count = 0;
      round.add(best);
    }
    return round;
  }

  int dimension_, count_ = 0;
  Real size_ = 0;
  Real normal_x_[M] = {}, normal_y_[M] = {}, length_[M], origin_[M], lower_[M], upper_[M];
};

// Tensions for one problem, inside their limits. Returns the redundancy; more than two is left unanswered.
template <class Real, int N, int M>
int polygon_tensions(const LooseCables<Real, N, M>& loose, const Real* lower, const Real* upper,
                     const Real* reference, Goal goal, Real rank_tolerance, Real* tensions, int* steps) {
  const Equilibrium<Real, N, M> plane(loose, rank_tolerance);
  const int redundancy = plane.redundancy();
  if (redundancy > 2) return redundancy;
  Real near[M], origin[M], basis[2][M];
  for (int i = 0; i < loose.count; ++i) {
    const Real low = lower[loose.index[i]], high = upper[loose.index[i]];
    near[i] = magnitude(low) <= magnitude(high) ? low : high;
  }
  plane.closest(near, origin);
  plane.null_space(basis);
  Point<Real> wanted{0, 0};
  for (int i = 0; i < loose.count; ++i) {
    const Real off = reference[loose.index[i]] - origin[i];
    if (redundancy > 0) wanted.x += basis[0][i] * off;
    if (redundancy > 1) wanted.y += basis[1][i] * off;
  }

  Strips<Real, M> strips(plane, origin, basis, lower, upper);
  const Point<Real> chosen = strips.choose(goal, wanted);
  *steps = strips.steps;
  for (int i = 0; i < loose.count; ++i) {
    const int cable = loose.index[i];
    Real t = origin[i];
    if (redundancy > 0) t += chosen.x * basis[0][i];
    if (redundancy > 1) t += chosen.y * basis[1][i];
    tensions[cable] = smaller(larger(t, lower[cable]), upper[cable]);
  }
  return redundancy;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
