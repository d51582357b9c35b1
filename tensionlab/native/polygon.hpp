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

template <class Real>
struct PolygonTolerance {
  static constexpr Real kept = Real(1e-10);      // a limit missed by less, times the largest limit, is kept
  static constexpr Real parallel = Real(1e-12);  // a line at less than this angle is never met
  static constexpr Real thin = Real(1e-11);  // a polygon narrower than this, times the largest limit, is an edge
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
      size_ = larger(size_, larger(magnitude(low), magnitude(high)));
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

  bool contains(Point<Real> p) const {
    for (int i = 0; i < count_; ++i) {
      const Real t = origin_[i] + dot(normal(i), p);
      if (!(t >= lower_[i] && t <= upper_[i])) return false;
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

  // The crossing of the lower lines of the two cables that cross best, and the one whose line leads into the strip
  // of the other.
  Point<Real> corner(int* first) const {
    int i = 0, j = 0;
    for (int k = 1; k < count_; ++k) {
      if (length_[k] > length_[i]) i = k;
    }
    for (int k = 0; k < count_; ++k) {
      if (magnitude(cross(normal(i), normal(k))) > magnitude(cross(normal(i), normal(j)))) j = k;
    }
    const Real area = cross(normal(i), normal(j));
    const Real p = lower_[i] - origin_[i], q = lower_[j] - origin_[j];
    *first = area < 0 ? i : j;
    return (1 / area) * Point<Real>{p * normal_y_[j] - q * normal_y_[i], q * normal_x_[i] - p * normal_x_[j]};
  }

  // Along the line of a cable: its strip lies to the left. side: 1 on the lower line, -1 on the upper one.
  Point<Real> along(int cable, Real side) const {
    const Real scale = side / length_[cable];
    return {scale * normal_y_[cable], -scale * normal_x_[cable]};
  }

  // Where the walk is on its way, and the next line on it.
  struct Look {
    Real missed = 0;                              // cables outside their limits here ...
    Real worst = 0;                               // ... and by how much at most
    int next = -1;                                // the cable whose line is met first ...
    Real far = std::numeric_limits<Real>::max();  // ... how far away ...
    bool in = false;                              // ... and whether it is entered there
  };
  // Selections instead of branches, which the processor could only guess.
  Look look(Point<Real> here, Point<Real> way, int on) const {
    Look found;
    const Real slack = Is::kept * size_, never = found.far;
    Real far[M], behind[M];
    for (int i = 0; i < count_; ++i) {
      const Real t = origin_[i] + normal_x_[i] * here.x + normal_y_[i] * here.y;
      const Real rate = normal_x_[i] * way.x + normal_y_[i] * way.y, speed = magnitude(rate);
      const Real under = lower_[i] - t, over = t - upper_[i], miss = larger(under, over);
      const Real beyond = rate > 0 ? over : under;
      behind[i] = rate > 0 ? under : over;
      const Real gap = larger(behind[i] > slack ? behind[i] : -beyond, Real(0));
      far[i] = (speed > Is::parallel * length_[i]) & (beyond <= slack) ? gap / speed : never;
      found.worst = larger(found.worst, miss);
      found.missed += miss > slack ? Real(1) : Real(0);
    }
    far[on] = never;
    for (int i = 0; i < count_; ++i) {
      found.next = far[i] < found.far ? i : found.next;
      found.far = smaller(far[i], found.far);
    }
    found.in = found.next >= 0 && behind[found.next] > slack;
    return found;
  }

  Polygon walk() {
    int on;
    Point<Real> here = corner(&on), way = along(on, 1), first = way, best = here;
    Real least = std::numeric_limits<Real>::max();
    Real fewest = least;
    bool half = false;
    Polygon round;
    for (steps = 0; steps < (2 * count_ + 2) * (count_ + 1); ++steps) {
      const Look ahead = look(here, way, on);
      if (ahead.worst < least) {
        least = ahead.worst;
        best = here;
      }
      if (ahead.missed < fewest) {
        fewest = ahead.missed;
        round.count = 0;
        first = way;
        half = false;
      }
      round.add(here);
      const Real turned = cross(first, way);
      const bool beyond = turned < -Is::parallel || (dot(first, way) < 0 && turned <= Is::parallel);
      if (half && !beyond) break;
      half = half || beyond;
      if (ahead.next < 0) break;
      here = here + ahead.far * way;
      if (ahead.in) continue;
      on = ahead.next;
      way = along(on, dot(normal(on), way) < 0 ? Real(1) : Real(-1));
    }
    if (fewest > 0) {  // out of reach: where the limits are missed by least
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
  Real middle[M], origin[M], basis[2][M];
  for (int i = 0; i < loose.count; ++i) middle[i] = (lower[loose.index[i]] + upper[loose.index[i]]) / 2;
  plane.closest(middle, origin);
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
