// The reachable wrench nearest to one that is out of reach, in every lane at once.
//
//   minimise |w - W t|^2   subject to   a <= t <= b
//
// What tensions can render is bounded by flat faces. On the one that is nearest, all cables pull with a limit but
// a few, whose columns are independent. A direction that separates w tells nearly which: the cables that it hardly
// moves are free, the others at the limit that it points to. From there an active set: the free cables step to
// their least squares; the first to meet a limit stays there; where all have room, the cable that would most
// reduce the error comes free. The error falls with every step, so that no set comes twice.
//
// Found is an answer only where it is the only one: the error r is at right angles to the columns of the free
// cables, and clearly on the proper side of all others. Then r also separates w.
//
// Source: Stark and Parker (1995), "Bounded-variable least-squares: an algorithm and applications".
#pragma once

#include <cmath>
#include <limits>

#include "factor.hpp"
#include "lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class NearestFace {
 public:
  // structure is n x m, row by row; direction: one that nearly separates the wrench.
  struct Problem {
    const Real *structure, *wrench, *lower, *upper, *direction;
  };

  // m cables; weight_roots: square roots of the n wrench weights.
  NearestFace(int m, const Real* weight_roots) : m_(m) {
    for (int k = 0; k < N; ++k) {
      weight_roots_[k] = weight_roots[k];
      lighter_[k] = 1 / weight_roots[k];
    }
  }

  // One problem for each lane.
  void solve(const Problem (&problems)[L]) {
    load(problems);
    for (int round = 0; round < kStepLimit && any(open_ > V{}); ++round) {
      step();
      look(round == 0);
    }
    confirm();
  }

  // Whether lane l has the answer.
  bool found(int l) const { return read<Real>(found_, l) != 0; }

  // The answer of lane l: tensions (m) and the separating direction (n), of unit length. Returns the steps taken.
  int store(int l, Real* tensions, Real* separation) const {
    for (int i = 0; i < m_; ++i) tensions[i] = read<Real>(tension_[i], l);
    for (int s = 0; s < N; ++s) {
      const int cable = static_cast<int>(read<Real>(cable_[s], l));
      if (cable >= 0) tensions[cable] = read<Real>(free_[s], l);
    }
    for (int k = 0; k < N; ++k) separation[k] = read<Real>(direction_[k], l);
    return static_cast<int>(read<Real>(steps_, l));
  }

 private:
  using V = Lanes<Real, L>;

  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr bool kDouble = kUlp < Real(1e-10);
  static constexpr int kStepLimit = 4 * N + 4;  // hardly one in a million takes more
  // Least pivot of independent columns, against their squared length; what an error is more than, against wrench
  // and tensions; and what is clearly not at right angles.
  static constexpr Real kPivot = kDouble ? Real(1e-8) : Real(1e-3), kError = kDouble ? Real(1e-10) : Real(1e-4),
                        kAngle = kDouble ? Real(1e-9) : Real(1e-4), kNoise = 64 * kUlp;
  // What is near to a right angle, as a cosine; and how much of it counts where a cable would be of use.
  static constexpr Real kNear = Real(0.03), kUseful = Real(0.1);
  static constexpr Real kNever = std::numeric_limits<Real>::max() / 4;

  void load(const Problem (&problems)[L]) {
    const V zero = V{}, one = zero + Real(1);
    const Real* row[L];
    V direction[N], largest = zero;
    size_ = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      V square = zero;
      for (int l = 0; l < L; ++l) row[l] = problems[l].structure + k * m_;
      transpose<Real, L>(row, m_, [&](int i, const V& entry) {
        const V weighed = entry * weight_roots_[k];
        column_[i][k] = weighed;
        square += weighed * weighed;
      });
      largest = larger(largest, square);
      wrench_[k] = gather<Real, L>([&](int l) { return problems[l].wrench[k]; }) * weight_roots_[k];
      direction[k] = gather<Real, L>([&](int l) { return problems[l].direction[k]; }) * lighter_[k];
      size_ = larger(size_, magnitude(wrench_[k]));
    }
    gain_ = square_root<Real, L>(largest);
    if (limits_changed(problems)) load_limits(problems);
    size_ = larger(size_, V(gain_ * strongest_));
    V along[M], most;
    for (int i = 0; i < m_; ++i) {
      along[i] = inner(column_[i], direction);
      const auto up = along[i] > zero;
      tension_[i] = up ? upper_[i] : lower_[i];
      room_[i] = up ? -one : one;
      bar_[i] = zero;
    }
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      cable_[s] = -one;
      spare_[s] = one;
      free_[s] = least_[s] = most_[s] = zero;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) own_[s][k] = zero;
    }
    measure();
    // A cable is likely to be free if the direction hardly moves it; more so if, free, it would reduce the error.
    const V square = kNear * kNear * inner(direction, direction);
    for (int i = 0; i < m_; ++i) {
      const auto useful = inner(column_[i], error_) * room_[i] > zero;
      const V angle = along[i] * along[i] * (useful ? zero + kUseful * kUseful : one);
      along[i] = angle < square * inner(column_[i], column_[i]) ? V(-angle) : zero - kNever;
    }
    for (int s = 0; s < N - 1 && s < m_; ++s) {
      const V cable = best([&](int i) { return along[i] + bar_[i]; }, most);
      const auto mask = most > zero - kNever;
      const Column it(*this, cable);
      const V middle = (it.lower + it.upper) / 2;
      cable_[s] = mask ? cable : cable_[s];
      spare_[s] = mask ? zero : one;
      free_[s] = mask ? middle : zero;
      least_[s] = mask ? it.lower : zero;
      most_[s] = mask ? it.upper : zero;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) {
        own_[s][k] = mask ? it.column[k] : zero;
        error_[k] += own_[s][k] * (it.tension - middle);
      }
      bar(cable, mask);
    }
    open_ = one;
    found_ = dependent_ = steps_ = zero;
  }

  bool limits_changed(const Problem (&problems)[L]) {
    bool changed = false;
    for (int l = 0; l < L; ++l) {
      changed = changed || problems[l].lower != lower_of_[l] || problems[l].upper != upper_of_[l];
      lower_of_[l] = problems[l].lower;
      upper_of_[l] = problems[l].upper;
    }
    return changed;
  }

  void load_limits(const Problem (&problems)[L]) {
    strongest_ = V{};
    for (int i = 0; i < m_; ++i) {
      lower_[i] = gather<Real, L>([&](int l) { return problems[l].lower[i]; });
      upper_[i] = gather<Real, L>([&](int l) { return problems[l].upper[i]; });
      strongest_ = larger(strongest_, larger(V(-lower_[i]), upper_[i]));
    }
  }

  // The cable with the most merit.
  template <class Merit>
  V best(const Merit& merit_of, V& most) const {
    V cable = V{};
    most = V{} - kNever;
    for (int i = 0; i < m_; ++i) {
      const V merit = merit_of(i);
      cable = merit > most ? V{} + Real(i) : cable;
      most = larger(most, merit);
    }
    return cable;
  }

  // Numbers of one cable in each lane.
  struct Column {
    V column[N], tension, lower, upper;

    Column(const NearestFace& face, const V& cable) {
      int index[L];
      for (int l = 0; l < L; ++l) index[l] = static_cast<int>(read<Real>(cable, l));
      const auto entry = [&](const V* numbers, int stride) {
        return gather<Real, L>([&](int l) { return read<Real>(numbers[index[l] * stride], l); });
      };
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) column[k] = entry(&face.column_[0][k], N);
      tension = entry(face.tension_, 1);
      lower = entry(face.lower_, 1);
      upper = entry(face.upper_, 1);
    }
  };

  // Make a cable free, in the lanes of the mask.
  template <class Mask>
  void admit(const V& cable, const Mask& mask) {
    const Column it(*this, cable);
    auto waiting = mask;
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const auto here = waiting & (spare_[s] > V{});
      waiting = waiting & !here;
      cable_[s] = here ? cable : cable_[s];
      spare_[s] = here ? V{} : spare_[s];
      free_[s] = here ? it.tension : free_[s];
      least_[s] = here ? it.lower : least_[s];
      most_[s] = here ? it.upper : most_[s];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) own_[s][k] = here ? it.column[k] : own_[s][k];
    }
    bar(cable, mask);
  }

  // A cable is free: no longer at a limit.
  template <class Mask>
  void bar(const V& cable, const Mask& mask) {
    for (int i = 0; i < m_; ++i) {
      const auto it = mask & (cable == V{} + Real(i));
      room_[i] = it ? V{} : room_[i];
      tension_[i] = it ? V{} : tension_[i];
      bar_[i] = it ? V{} - kNever : bar_[i];
    }
  }

  // The error, from the tensions.
  void measure() {
    V error[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error[k] = wrench_[k];
    for (int i = 0; i < m_; ++i) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= column_[i][k] * tension_[i];
    }
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= own_[s][k] * free_[s];
    }
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error_[k] = error[k];
  }

  // The free cables step to their least squares, or as far as the first limit.
  void step() {
    const V zero = V{}, one = zero + Real(1);
    const auto open = open_ > zero;
    V gram[N][N], along[N], least[N], change[N], product;
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      along[s] = inner(own_[s], error_);
      TENSIONLAB_UNROLL
      for (int r = 0; r <= s; ++r) gram[s][r] = inner(own_[s], own_[r]);
      gram[s][s] += spare_[s];
      least[s] = kPivot * (gram[s][s] + kPivot * gain_ * gain_);
    }
    const V raised = solve_with_pivots(gram, along, least, change, product);
    dependent_ = open ? raised : dependent_;
    V pace = open ? one : zero, stop = zero - one, cable = zero - one, limit = zero, room = zero;
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const auto up = change[s] > zero;
      const V end = up ? most_[s] : least_[s];
      const V ratio = (end - free_[s]) / change[s];  // of what does not move: none or not a number
      const auto nearer = (ratio >= zero) & (ratio < pace);
      pace = nearer ? ratio : pace;
      stop = nearer ? zero + Real(s) : stop;
      cable = nearer ? cable_[s] : cable;
      limit = nearer ? end : limit;
      room = nearer ? (up ? -one : one) : room;
    }
    V error[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error[k] = error_[k];
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const V moved = pace * change[s];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= own_[s][k] * moved;
      free_[s] = smaller(larger(V(free_[s] + moved), least_[s]), most_[s]);
    }
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error_[k] = error[k];
    steps_ += open_;
    const auto stopped = stop >= zero;
    flat_ = open & !stopped ? one : zero;
    if (!any(stopped)) return;
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) {
      const auto here = stop == zero + Real(s);
      free_[s] = here ? zero : free_[s];
      cable_[s] = here ? -one : cable_[s];
      spare_[s] = here ? one : spare_[s];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) own_[s][k] = here ? zero : own_[s][k];
    }
    for (int i = 0; i < m_; ++i) {
      const auto it = stopped & (cable == zero + Real(i));
      tension_[i] = it ? limit : tension_[i];
      room_[i] = it ? room : room_[i];
      bar_[i] = it ? zero : bar_[i];
    }
  }

  // Where the free cables have stepped all the way: is any other on the wrong side? early: ask everywhere.
  void look(bool early) {
    const V zero = V{}, one = zero + Real(1);
    const auto flat = flat_ > zero;
    const auto asked = early ? open_ > zero : flat;
    if (!any(asked)) return;
    V most, norm = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) norm = larger(norm, magnitude(error_[k]));
    const V cable = best([&](int i) { return room_[i] * inner(column_[i], error_) + bar_[i]; }, most);
    const V clear = kNoise * gain_ * size_ + kAngle * gain_ * norm;
    const auto wrong = asked & (most > clear);
    const auto end = flat & (most <= clear);
    const auto sure = (most < -clear) & (norm > kError * size_) & (dependent_ == zero);
    found_ = end & sure ? one : found_;
    open_ = end ? zero : open_;
    if (any(wrong)) admit(cable, wrong);
  }

  // The error as it is: at right angles to the free columns?
  void confirm() {
    measure();
    V steepest = V{}, square = inner(error_, error_);
    TENSIONLAB_UNROLL
    for (int s = 0; s < N; ++s) steepest = larger(steepest, magnitude(inner(own_[s], error_)));
    found_ = steepest <= kNoise * gain_ * size_ ? found_ : V{};
    const V inverse = (V{} + Real(1)) / square_root<Real, L>(square);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) direction_[k] = weight_roots_[k] * error_[k] * inverse;
  }

  static V inner(const V (&x)[N], const V (&y)[N]) {
    V sum = x[0] * y[0];
    TENSIONLAB_UNROLL
    for (int k = 1; k < N; ++k) sum += x[k] * y[k];
    return sum;
  }

  int m_;
  Real weight_roots_[N], lighter_[N];
  const Real *lower_of_[L] = {}, *upper_of_[L] = {};
  V column_[M][N], wrench_[N], lower_[M], upper_[M], strongest_, gain_, size_;
  // Of a cable at a limit; where it has room: 1 above, -1 below, 0 if it is free.
  V tension_[M], room_[M], bar_[M];
  // Free cables: which, or -1; whether there is none; column, tension and limits.
  V cable_[N], spare_[N], own_[N][N], free_[N], least_[N], most_[N];
  V error_[N], direction_[N];
  V open_, flat_, found_, dependent_, steps_;  // flags, and a count
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
