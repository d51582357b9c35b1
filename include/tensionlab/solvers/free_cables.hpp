// The cables of a bounded least squares problem that are at no limit, in every lane at once
// (tensionlab/solvers/nearest_face.hpp).
#pragma once

#include <limits>

#include "tensionlab/simd/lane_problem.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// Up to N in a lane, each in a place.
template <class Real, int L, int N, int M>
class FreeCables {
 public:
  using V = Lanes<Real, L>;
  using Problem = LaneProblems<Real, L, N, M>;

  // A cable that reached a limit, or -1; the limit, and the side where it has room: 1 above it, -1 below.
  struct Stop {
    V cable, limit, room;
  };

  void clear() {
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      cable_[s] = V{} - Real(1);
      empty_[s] = V{} + Real(1);
      tension_[s] = lower_[s] = upper_[s] = V{};
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) column_[s][k] = V{};
    }
  }

  // Frees a cable in the lanes of the mask, in an empty place of each. tensions: of all cables.
  template <class Mask>
  void admit(const Problem& problem, const V* tensions, const V& cable, const Mask& mask) {
    const Entry entry(problem, tensions, cable);
    auto waiting = mask;
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const auto here = waiting & (empty_[s] > V{});
      waiting = waiting & !here;
      put(s, entry, here);
    }
  }

  // The same in a place that is empty in all lanes.
  template <class Mask>
  void admit_at(int place, const Problem& problem, const V* tensions, const V& cable, const Mask& mask) {
    put(place, Entry(problem, tensions, cable), mask);
  }

  // Moves the free cables to the least squares of the error, or to the first limit, in the open lanes, and updates
  // the error. dependent: the number of columns that depend on others.
  template <class Mask>
  TENSIONLAB_NOINLINE Stop step(V (&error)[N], const V& gain, const Mask& open, V& dependent) {
    const V zero = V{}, one = zero + Real(1);
    V gram[N][N], along[N], least[N], change[N];
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      along[s] = inner(column_[s], error);
      TENSIONLAB_UNROLL
      for (int r = 0; r <= s; ++r) gram[s][r] = inner(column_[s], column_[r]);
      gram[s][s] += empty_[s];
      least[s] = kPivot * (gram[s][s] + kPivot * gain * gain);
    }
    const Factor<V, N> factor(gram, least);
    factor.solve(along, change);
    dependent = factor.raised;
    V pace = open ? one : zero, place = zero - one;
    Stop stop{place, zero, zero};
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const auto up = change[s] > zero;
      const V limit = up ? upper_[s] : lower_[s];
      const V ratio = (limit - tension_[s]) / change[s];  // not positive or NaN for a cable that does not move
      const auto nearer = (ratio >= zero) & (ratio < pace);
      pace = nearer ? ratio : pace;
      place = nearer ? zero + Real(s) : place;
      stop.cable = nearer ? cable_[s] : stop.cable;
      stop.limit = nearer ? limit : stop.limit;
      stop.room = nearer ? (up ? -one : one) : stop.room;
    }
    V left[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) left[k] = error[k];
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const V moved = pace * change[s];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) left[k] -= column_[s][k] * moved;
      tension_[s] = smaller(larger(V(tension_[s] + moved), lower_[s]), upper_[s]);
    }
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error[k] = left[k];
    if (any(place >= zero)) drop(place);
    return stop;
  }

  // Subtracts the wrench of the free cables from the error.
  void subtract_wrench(V (&error)[N]) const {
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= column_[s][k] * tension_[s];
    }
  }

  // The largest product of a column with the error: zero at least squares.
  V steepest(const V (&error)[N]) const {
    V most = V{};
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) most = larger(most, magnitude(inner(column_[s], error)));
    return most;
  }

  // Writes the tensions of the free cables into those of all cables (m).
  void put_in(V* tensions, int m) const {
    for (int i = 0; i < m; ++i) {
      TENSIONLAB_UNROLL
      for (int s = 0; s < N; ++s) tensions[i] = cable_[s] == V{} + Real(i) ? tension_[s] : tensions[i];
    }
  }

  // The same for lane l.
  void store(int l, Real* tensions) const {
    for (int s = 0; s < N; ++s) {
      const int cable = static_cast<int>(read<Real>(cable_[s], l));
      if (cable >= 0) tensions[cable] = read<Real>(tension_[s], l);
    }
  }

 private:
  // Least pivot of columns that are independent, against their squared length.
  static constexpr Real kPivot = std::numeric_limits<Real>::epsilon() < Real(1e-10) ? Real(1e-8) : Real(1e-3);

  // The numbers of one cable in each lane.
  struct Entry {
    V cable, column[N], tension, lower, upper;

    Entry(const Problem& problem, const V* tensions, const V& which) : cable(which) {
      int index[L];
      for (int l = 0; l < L; ++l) index[l] = static_cast<int>(read<Real>(which, l));
      const auto pick = [&](const V* numbers, int stride) {
        return gather<Real, L>([&](int l) { return read<Real>(numbers[index[l] * stride], l); });
      };
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) column[k] = pick(&problem.structure[0][k], N);
      tension = pick(tensions, 1);
      lower = pick(problem.lower, 1);
      upper = pick(problem.upper, 1);
    }
  };

  template <class Mask>
  void put(int s, const Entry& entry, const Mask& here) {
    cable_[s] = here ? entry.cable : cable_[s];
    empty_[s] = here ? V{} : empty_[s];
    tension_[s] = here ? entry.tension : tension_[s];
    lower_[s] = here ? entry.lower : lower_[s];
    upper_[s] = here ? entry.upper : upper_[s];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) column_[s][k] = here ? entry.column[k] : column_[s][k];
  }

  // Empties a place; -1: none.
  void drop(const V& place) {
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const auto here = place == V{} + Real(s);
      cable_[s] = here ? V{} - Real(1) : cable_[s];
      empty_[s] = here ? V{} + Real(1) : empty_[s];
      tension_[s] = here ? V{} : tension_[s];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) column_[s][k] = here ? V{} : column_[s][k];
    }
  }

  // Of each place: the cable, or -1; 1 if it is empty; the cable's column, tension and limits.
  V cable_[N], empty_[N], column_[N][N], tension_[N], lower_[N], upper_[N];
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
