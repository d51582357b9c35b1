// The reachable wrench nearest to one that is out of reach, in every lane at once.
//
//   minimise |w - W t|^2   subject to   a <= t <= b
//
// What tensions can render is bounded by flat faces. On the one that is nearest, all cables pull with a limit but
// a few, whose columns are independent. A direction that separates w tells nearly which: cables that it hardly
// moves are free, the others at the limit that it points to. From there an active set: the free cables step to
// their least squares; the first to meet a limit stays there; where all have room, the cable that would most
// reduce the error comes free. The error falls with every step, so that no set comes twice.
//
// What it finds is an answer only where there is no other: the error is at right angles to the columns of the free
// cables, and clearly on the proper side of all others. Then it also separates w.
//
// Source: Stark and Parker (1995), "Bounded-variable least-squares: an algorithm and applications".
#pragma once

#include <limits>

#include "simd/lane_problem.hpp"
#include "solvers/free_cables.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class NearestFace {
  using V = Lanes<Real, L>;

 public:
  explicit NearestFace(int m) : problem_(m) {}

  // One problem for each lane, and a direction that separates its wrench.
  void solve(const Source<Real> (&source)[L], const Real* const (&direction)[L]) {
    problem_.load(source);
    begin(direction);
    for (int round = 0; round < kStepLimit && any(open_ > V{}); ++round) {
      step();
      look(round == 0);
    }
    confirm();
  }

  // Whether lane l has the answer.
  bool found(int l) const { return read<Real>(found_, l) != 0; }

  // The answers of all lanes, and in which of them they are proved nearest.
  struct Proof {
    V tensions[M], rendered[N], error[N], residual;
    V proved;  // 1 or 0
  };

  // Verifies the answers as verification/certificates.hpp does for errors that count as they are: the error that
  // is left separates the wrench from all that can be rendered, and no tensions leave less of it, within
  // tolerance.
  TENSIONLAB_NOINLINE void prove(Real tolerance, Proof& proof) const {
    const V zero = V{}, one = zero + Real(1);
    for (int i = 0; i < problem_.m; ++i) proof.tensions[i] = tension_[i];
    free_.put_in(proof.tensions, problem_.m);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) proof.rendered[k] = zero;
    auto proved = found_ > zero;
    for (int i = 0; i < problem_.m; ++i) {
      const V& tension = proof.tensions[i];
      proved = proved & (tension >= problem_.lower[i]) & (tension <= problem_.upper[i]);
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) proof.rendered[k] += problem_.structure[i][k] * tension;
    }
    V along_wrench = zero, size = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      proof.error[k] = problem_.wrench[k] - proof.rendered[k];
      const V part = proof.error[k] * problem_.wrench[k];
      along_wrench += part;
      size += magnitude(part);
    }
    V support = zero, gap = zero;
    for (int i = 0; i < problem_.m; ++i) {
      V along = zero, parts = zero;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) {
        const V part = problem_.structure[i][k] * proof.error[k];
        along += part;
        parts += magnitude(part);
      }
      const V end = along > zero ? problem_.upper[i] : problem_.lower[i];
      support += along * end;
      gap += along * (end - proof.tensions[i]);
      size += parts * larger(magnitude(problem_.lower[i]), magnitude(problem_.upper[i]));
    }
    const V error = inner(proof.error, proof.error), desired = inner(problem_.wrench, problem_.wrench);
    const V rendered = inner(proof.rendered, proof.rendered);
    proof.residual = square_root<Real, L>(error);
    proved = proved & (error > tolerance * tolerance * larger(one, desired)) &  // or it is exact
             (along_wrench - support > (N + problem_.m + 3) * kUlp * size) &
             (gap <= tolerance * square_root<Real, L>(larger(one, rendered)) * proof.residual);
    proof.proved = proved ? one : zero;
  }

  // The steps taken in lane l.
  int steps(int l) const { return static_cast<int>(read<Real>(steps_, l)); }

  // The answer of lane l: tensions (m) and the error, which separates (n). Returns the steps taken.
  int store(int l, Real* tensions, Real* error) const {
    for (int i = 0; i < problem_.m; ++i) tensions[i] = read<Real>(tension_[i], l);
    free_.store(l, tensions);
    for (int k = 0; k < N; ++k) error[k] = read<Real>(error_[k], l);
    return steps(l);
  }

 private:
  static constexpr Real kUlp = std::numeric_limits<Real>::epsilon();
  static constexpr bool kDouble = kUlp < Real(1e-10);
  static constexpr int kStepLimit = 4 * N + 4;
  // At first: what is near to a right angle, as a cosine; and what share of it counts where a cable would be of
  // use.
  static constexpr Real kNear = Real(0.03), kUseful = Real(0.1);
  // At last: what is clearly no right angle; what an error is more than, and its rounding, against wrench and
  // tensions.
  static constexpr Real kClear = kDouble ? Real(1e-9) : Real(1e-4), kError = kDouble ? Real(1e-7) : Real(1e-3);
  static constexpr Real kNoise = 64 * kUlp;
  static constexpr Real kNever = std::numeric_limits<Real>::max() / 4;

  // All cables at the limits that the directions point to, but for those that are likely to be free: it hardly
  // moves them, and free they would reduce the error.
  TENSIONLAB_NOINLINE void begin(const Real* const (&direction)[L]) {
    const V zero = V{}, one = zero + Real(1);
    V d[N], along[M], middle[M], most;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) d[k] = gather<Real, L>([&](int l) { return direction[l][k]; });
    for (int i = 0; i < problem_.m; ++i) {
      along[i] = problem_.along(i, d);
      const auto up = along[i] > zero;
      tension_[i] = up ? problem_.upper[i] : problem_.lower[i];
      middle[i] = (problem_.lower[i] + problem_.upper[i]) / 2;
      room_[i] = up ? -one : one;
      bar_[i] = zero;
    }
    free_.clear();
    measure();
    const V square = kNear * kNear * inner(d, d);
    for (int i = 0; i < problem_.m; ++i) {
      const auto useful = problem_.along(i, error_) * room_[i] > zero;
      const V angle = along[i] * along[i] * (useful ? zero + kUseful * kUseful : one);
      along[i] = angle < square * inner(problem_.structure[i], problem_.structure[i]) ? V(-angle) : zero - kNever;
    }
    for (int s = 0; s < N - 1 && s < problem_.m; ++s) {
      const V cable = best([&](int i) { return along[i] + bar_[i]; }, most);
      const auto likely = most > zero - kNever;
      free_.admit_at(s, problem_, middle, cable, likely);
      bar(cable, likely);
    }
    measure();
    size_ = larger(problem_.desired, V(problem_.gain * problem_.strongest));
    open_ = one;
    found_ = steps_ = zero;
  }

  // The free cables step. One that meets a limit stays there.
  void step() {
    const V zero = V{}, one = zero + Real(1);
    const auto open = open_ > zero;
    V dependent;
    const auto stop = free_.step(error_, problem_.gain, open, dependent);
    dependent_ = open ? dependent : dependent_;
    steps_ += open_;
    const auto stopped = stop.cable >= zero;
    flat_ = (open & !stopped) ? one : zero;
    if (!any(stopped)) return;
    for (int i = 0; i < problem_.m; ++i) {
      const auto it = stopped & (stop.cable == zero + Real(i));
      tension_[i] = it ? stop.limit : tension_[i];
      room_[i] = it ? stop.room : room_[i];
      bar_[i] = it ? zero : bar_[i];
    }
  }

  // Where the free cables have stepped all the way: would another reduce the error? early: ask everywhere.
  TENSIONLAB_NOINLINE void look(bool early) {
    const V zero = V{}, one = zero + Real(1);
    const auto flat = flat_ > zero;
    const auto wanted = early ? open_ > zero : flat;
    if (!any(wanted)) return;
    V most, norm = zero;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) norm = larger(norm, magnitude(error_[k]));
    const V cable = best([&](int i) { return room_[i] * problem_.along(i, error_) + bar_[i]; }, most);
    const V clear = problem_.gain * (kNoise * size_ + kClear * norm);
    const auto useful = wanted & (most > clear);
    const auto end = flat & (most <= clear);
    const auto sure = (most < -clear) & (norm > kError * size_) & (dependent_ == zero);
    found_ = end & sure ? one : found_;
    open_ = end ? zero : open_;
    if (!any(useful)) return;
    free_.admit(problem_, tension_, cable, useful);
    bar(cable, useful);
  }

  // The error as it is: at right angles to the free columns?
  void confirm() {
    measure();
    found_ = free_.steepest(error_) <= kNoise * problem_.gain * size_ ? found_ : V{};
  }

  // The error, from the tensions.
  void measure() {
    V error[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error[k] = problem_.wrench[k];
    for (int i = 0; i < problem_.m; ++i) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= problem_.structure[i][k] * tension_[i];
    }
    free_.render(error);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error_[k] = error[k];
  }

  // The cable with the most merit.
  template <class Merit>
  V best(const Merit& merit_of, V& most) const {
    V cable = V{};
    most = V{} - kNever;
    for (int i = 0; i < problem_.m; ++i) {
      const V merit = merit_of(i);
      cable = merit > most ? V{} + Real(i) : cable;
      most = larger(most, merit);
    }
    return cable;
  }

  // The cable is free, and at no limit.
  template <class Mask>
  void bar(const V& cable, const Mask& mask) {
    for (int i = 0; i < problem_.m; ++i) {
      const auto it = mask & (cable == V{} + Real(i));
      room_[i] = it ? V{} : room_[i];
      tension_[i] = it ? V{} : tension_[i];
      bar_[i] = it ? V{} - kNever : bar_[i];
    }
  }

  SideBySide<Real, L, N, M> problem_;
  FreeCables<Real, L, N, M> free_;
  // Of a cable at a limit; where it has room: 1 above, -1 below. If it is free these are 0, and the bar is not.
  V tension_[M], room_[M], bar_[M];
  V error_[N], size_;
  V open_, flat_, found_, dependent_, steps_;  // flags, and counts
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
