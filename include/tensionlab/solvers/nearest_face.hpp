// The feasible wrench nearest to an infeasible one, in every lane at once.
//
//   minimise |w - W t|^2   subject to   a <= t <= b
//
// The set of feasible wrenches is bounded by flat faces. On the nearest one, all cables are at a limit except a
// few, whose columns are independent. A direction that nearly separates w tells which: cables that it is almost
// perpendicular to are free, the others at the limit that it points to. An active set method starts there: the
// free cables step to their least squares; the first that meets a limit is held there; where none does, the cable
// that reduces the error most is freed. The error falls with every step, so that no set comes twice.
//
// The result is accepted only where it is the unique answer: the error is perpendicular to the columns of the free
// cables, and clearly on the proper side of all others. Then it also separates w.
//
// Source: Stark and Parker (1995), "Bounded-variable least-squares: an algorithm and applications".
#pragma once

#include <limits>

#include "tensionlab/simd/lane_problem.hpp"
#include "tensionlab/solvers/free_cables.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class NearestFace {
  using V = Lanes<Real, L>;

 public:
  explicit NearestFace(int m) : problem_(m) {}

  // problem: one for each lane; direction: one that may separate its wrench.
  void solve(const Problem<Real> (&source)[L], const Real* const (&direction)[L]) {
    problem_.load(source);
    begin(direction);
    for (int round = 0; round < kStepLimit && any(open_ > V{}); ++round) {
      step();
      free_next(round == 0);
    }
    confirm();
  }

  // Whether lane l has an answer.
  bool found(int l) const { return read<Real>(found_, l) != 0; }

  // Answers of all lanes; proved is 1 where they are proved nearest, else 0.
  struct Proof {
    V tensions[M], rendered[N], error[N], residual;
    V proved;
  };

  // Verifies the answers as verification/certificates.cpp does without weights: the remaining error separates the
  // wrench from all feasible ones, and no tensions have a smaller error, within tolerance.
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
             (along_wrench - support > Real(N + problem_.m + 3) * kUlp * size) &
             (gap <= tolerance * square_root<Real, L>(larger(one, rendered)) * proof.residual);
    proof.proved = proved ? one : zero;
  }

  // The steps taken in lane l.
  int steps(int l) const { return static_cast<int>(read<Real>(steps_, l)); }

  // Stores the answer of lane l: tensions (m) and the error (n), which separates. Returns the steps taken.
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
  // Start: the cosine below which a cable counts as perpendicular, and its share for a cable that would reduce the
  // error.
  static constexpr Real kNear = Real(0.03), kUseful = Real(0.1);
  // End: the cosine above which a cable is clearly not perpendicular; the least error, and the rounding in it, as
  // shares of wrench and tensions.
  static constexpr Real kClear = kDouble ? Real(1e-9) : Real(1e-4), kError = kDouble ? Real(1e-7) : Real(1e-3);
  static constexpr Real kNoise = 64 * kUlp;
  static constexpr Real kNever = std::numeric_limits<Real>::max() / 4;

  // Puts all cables at the limits that the directions point to, except those that are likely to be free: nearly
  // perpendicular ones that would reduce the error.
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
    update_error();
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
      mark_free(cable, likely);
    }
    update_error();
    size_ = larger(problem_.desired, V(problem_.gain * problem_.strongest));
    open_ = one;
    found_ = steps_ = zero;
  }

  // Moves the free cables; one that meets a limit is held there.
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

  // Frees the cable that reduces the error most, in lanes whose free cables are at their least squares; in the
  // first round in all lanes. Without one, a lane ends.
  TENSIONLAB_NOINLINE void free_next(bool first_round) {
    const V zero = V{}, one = zero + Real(1);
    const auto flat = flat_ > zero;
    const auto wanted = first_round ? open_ > zero : flat;
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
    mark_free(cable, useful);
  }

  // Recomputes the error, which must be perpendicular to the free columns.
  void confirm() {
    update_error();
    found_ = free_.steepest(error_) <= kNoise * problem_.gain * size_ ? found_ : V{};
  }

  // Computes the error from the tensions.
  void update_error() {
    V error[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error[k] = problem_.wrench[k];
    for (int i = 0; i < problem_.m; ++i) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) error[k] -= problem_.structure[i][k] * tension_[i];
    }
    free_.subtract_wrench(error);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) error_[k] = error[k];
  }

  // The cable with the greatest merit.
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

  // Marks a cable as free.
  template <class Mask>
  void mark_free(const V& cable, const Mask& mask) {
    for (int i = 0; i < problem_.m; ++i) {
      const auto it = mask & (cable == V{} + Real(i));
      room_[i] = it ? V{} : room_[i];
      tension_[i] = it ? V{} : tension_[i];
      bar_[i] = it ? V{} - kNever : bar_[i];
    }
  }

  LaneProblems<Real, L, N, M> problem_;
  FreeCables<Real, L, N, M> free_;
  // Of a cable at a limit: its tension, and the side where it has room, 1 above or -1 below. Of a free cable these
  // are 0, and bar_ excludes it from a choice.
  V tension_[M], room_[M], bar_[M];
  V error_[N], size_;
  V open_, flat_, found_, dependent_, steps_;  // flags, and counts
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
