// The exact solver's first attempt: a few Newton steps for many problems side by side, and no line search.
//
//   minimise |t - t0|^2 / 2   subject to   W t = w,  a <= t <= b
//
// Any multiplier y fixes tensions t = clip(t0 + W'y, a, b), and where these render w they are the optimum,
// however y was found. So steps may be bold, and only their end is checked. The first step ignores the limits; the
// others keep the pivots above a floor that falls, because too few cables may be free at first. Problems that have
// not converged by then, such as infeasible ones, are left to the Newton steps of solvers/newton.hpp.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "solvers/kernels.hpp"
#include "solvers/null_space.hpp"
#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <int L, int N, int M>
class Sweep {
 public:
  Sweep(const Batch& batch, const SweepSettings& settings, const SweepAnswer& answer, SweepRemainder& remainder)
      : batch_(batch),
        m_(batch.m),
        settings_(settings),
        answer_(answer),
        remainder_(remainder),
        shared_(batch.lower.stride == 0 && batch.upper.stride == 0 && batch.reference.stride == 0),
        guessed_(has(Route::guess) && (batch.m == N + 1 || batch.m == N + 2)) {
    if (shared_) limits_[0].load(batch, rows_at(0, 1));
  }

  // Answers those of rows [begin, end) that it can; the others go to the remainder.
  void solve(std::size_t begin, std::size_t end) {
    while (begin < end) {
      int groups = 0;
      for (; begin < end && groups < kGroups; begin += L) load(groups++, begin, end);
      int open[kGroups], left = 0;
      for (int g = 0; g < groups; ++g) {
        if (!guessed_ || !check_convergence(g, false)) open[left++] = g;
      }
      for (int s = 0; s < kSteps; ++s) {
        for (int j = 0; j < left; ++j) step(open[j], s);
      }
      for (int j = 0; j < left; ++j) {
        if (guessed_) finish_guess(group_[open[j]]);
        check_convergence(open[j], true);
      }
    }
  }

 private:
  using V = Lanes<double, L>;

  static constexpr int kGroups = 4;  // solved in turn: the processor works on one while it waits for another
  static constexpr std::size_t kAhead =
      16;  // groups between the one that is loaded and the one that is prefetched
  // Least pivots of each step with limits, as a share of the diagonal of W W'; and of the step without.
  static constexpr int kSteps = 4;
  static constexpr double kFloors[kSteps] = {0.5, 0.2, 0.02, 1e-10}, kTight = 1e-10;
  static constexpr std::int64_t kEvaluations = 6;
  // Error of a rendered wrench, as a share of structure times tensions.
  static constexpr double kUnit = std::numeric_limits<double>::epsilon(), kConverged = 4 * kUnit;

  struct LaneRows {
    std::size_t row[L];
  };

  struct Limits {
    V lower[M], upper[M], reference[M], furthest;  // largest square of a reference

    void load(const Batch& batch, const LaneRows& rows) {
      furthest = V{};
      for (int i = 0; i < batch.m; ++i) {
        lower[i] = gather<double, L>([&](int l) { return batch.lower[rows.row[l]][i]; });
        upper[i] = gather<double, L>([&](int l) { return batch.upper[rows.row[l]][i]; });
        reference[i] = gather<double, L>([&](int l) { return batch.reference[rows.row[l]][i]; });
        furthest = larger(furthest, V(reference[i] * reference[i]));
      }
    }
  };

  // L problems. structure: row by row; diagonal: of W W', or 1; gain: its largest entry; size: sum of all
  // magnitudes; other: the dual without limits while that of a guess is in use, and the other way round; before:
  // the dual before each step; separating: where the limits are in conflict (1 or 0); guess_right: 1 or 0.
  struct Group {
    V structure[N * M], wrench[N], dual[N], other[N], before[kSteps][N], guess_right, diagonal[N], gain, size;
    V conflict, separating[N];
    std::size_t first;
    int count;
  };

  // W_F W_F' of the free cables F, and the wrench that is missing.
  struct NormalEquations {
    V matrix[N][N], residual[N];

    explicit NormalEquations(const V (&wrench)[N]) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) {
        residual[k] = wrench[k];
        TENSIONLAB_UNROLL
        for (int j = 0; j <= k; ++j) matrix[k][j] = V{};
      }
    }

    // Adds a cable; part: its column, or zeros if it is not free.
    template <class Part>
    TENSIONLAB_INLINE void add(const V (&column)[N], const V& tension, const Part& part) {
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) {
        residual[k] -= column[k] * tension;
        const V own = part(column[k]);
        TENSIONLAB_UNROLL
        for (int j = 0; j <= k; ++j) matrix[k][j] += own * column[j];
      }
    }

    // Solves for the change of the dual; pivots are at least this share of the diagonal of W W'.
    TENSIONLAB_INLINE void solve(double share, const V (&diagonal)[N], V (&change)[N]) {
      V least[N];
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) least[k] = share * diagonal[k];
      Factor<V, N>(matrix, least).solve(residual, change);
    }
  };

  TENSIONLAB_INLINE void load_column(const Group& group, int i, V (&column)[N]) const {
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) column[k] = group.structure[k * m_ + i];
  }

  // Loads column i of W; returns the tension that the dual wants of the cable.
  TENSIONLAB_INLINE V load_wanted(const Group& group, const Limits& limit, int i, V (&column)[N]) const {
    load_column(group, i, column);
    V wanted = limit.reference[i];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) wanted += column[k] * group.dual[k];
    return wanted;
  }

  // L rows from `first` on; past the end the last one is repeated.
  static LaneRows rows_at(std::size_t first, std::size_t end) {
    LaneRows rows;
    for (std::size_t l = 0; l < L; ++l) rows.row[l] = std::min(first + l, end - 1);
    return rows;
  }

  const Limits& limits(int g) const { return limits_[shared_ ? 0 : g]; }

  // Loads the problems of a group, and takes the step without limits.
  void load(int g, std::size_t first, std::size_t end) {
    Group& group = group_[g];
    group.first = first;
    group.count = static_cast<int>(std::min<std::size_t>(L, end - first));
    const LaneRows rows = rows_at(first, end);
    if (!shared_) limits_[g].load(batch_, rows);
    const std::size_t later = first + kAhead * L;
    for (std::size_t row = later; later + L <= batch_.size && row < later + L; ++row) {
      prefetch(batch_.structure[row], static_cast<std::size_t>(N * m_));
      prefetch(batch_.wrench[row], N);
    }
    V size = V{};
    const double* row[L];
    for (int l = 0; l < L; ++l) row[l] = batch_.structure[rows.row[l]];
    transpose<double, L>(row, N * m_, [&](int j, const V& entry) {
      group.structure[j] = entry;
      size += magnitude(entry);
    });
    for (int l = 0; l < L; ++l) row[l] = batch_.wrench[rows.row[l]];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      group.wrench[k] = gather<double, L>([&](int l) { return row[l][k]; });
      size += magnitude(group.wrench[k]);
    }
    group.size = size;
    NormalEquations sums(group.wrench);
    for (int i = 0; i < m_; ++i) {
      V column[N];
      load_column(group, i, column);
      sums.add(column, limits(g).reference[i], [](const V& entry) { return entry; });
    }
    group.gain = V{};
    V least[N];
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      const V square = sums.matrix[k][k];
      group.gain = larger(group.gain, square);
      group.diagonal[k] = square > V{} ? square : V{} + 1;
      least[k] = kTight * group.diagonal[k];
    }
    const Factor<V, N> factor(sums.matrix, least);
    factor.solve(sums.residual, group.dual);
    if (guessed_ && m_ == N + 1) guess<1>(g, factor);
    if (guessed_ && m_ == N + 2) guess<2>(g, factor);
  }

  // Takes the step for the cables at their limits that the null space suggests.
  template <int K>
  void guess(int g, const Factor<V, N>& gram) {
    Group& group = group_[g];
    const Limits& limit = limits(g);
    V unlimited[M], column[N];
    for (int i = 0; i < m_; ++i) unlimited[i] = load_wanted(group, limit, i, column);
    const NullSpace<L, N, M, K> null_space(group.structure, gram, unlimited, limit.lower, limit.upper);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) group.other[k] = group.dual[k];
    NormalEquations sums(group.wrench);
    for (int i = 0; i < m_; ++i) {
      const V side = null_space.at(i);
      const auto free = side == V{};
      const V tension = free ? limit.reference[i] : side > V{} + 1 ? limit.upper[i] : limit.lower[i];
      load_column(group, i, column);
      sums.add(column, tension, [&](const V& entry) { return free ? entry : V{}; });
    }
    sums.solve(kTight, group.diagonal, group.dual);
    group.conflict = V{};
    if (has(Route::separation_in_sweep) && any(null_space.conflict())) {
      group.conflict = null_space.conflict() ? V{} + 1 : V{};
      null_space.separate(group.structure, gram, group.separating);
    }
  }

  // Takes a Newton step from the tensions inside the limits.
  void step(int g, int s) {
    Group& group = group_[g];
    const Limits& limit = limits(g);
    NormalEquations sums(group.wrench);
    for (int i = 0; i < m_; ++i) {
      V column[N];
      const V wanted = load_wanted(group, limit, i, column);
      const V tension = smaller(larger(wanted, limit.lower[i]), limit.upper[i]);
      const auto free = tension == wanted;
      sums.add(column, tension, [&](const V& entry) { return free ? entry : V{}; });
    }
    V path[N];
    sums.solve(kFloors[s], group.diagonal, path);
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      group.before[s][k] = group.dual[k];
      group.dual[k] += path[k];
    }
  }

  // Goes back to the guess where that was right, so that an answer does not depend on the other lanes.
  static void finish_guess(Group& group) {
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) group.dual[k] = group.guess_right > V{} ? group.other[k] : group.dual[k];
  }

  // Writes the answers that are proved exact: their wrench is recomputed from the tensions as they are written.
  // If this is not the last attempt and some are neither proved nor in conflict, writes none, lets those that are
  // not proved begin again from the dual without limits, and returns false.
  bool check_convergence(int g, bool last) {
    Group& group = group_[g];
    const Limits& limit = limits(g);
    V tensions[M], rendered[N], change = limit.furthest;
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) rendered[k] = V{};
    for (int i = 0; i < m_; ++i) {
      V column[N];
      const V wanted = load_wanted(group, limit, i, column);
      tensions[i] = smaller(larger(wanted, limit.lower[i]), limit.upper[i]);
      const V off = tensions[i] - limit.reference[i];
      change += off * off;
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) rendered[k] += column[k] * tensions[i];
    }
    V largest = V{}, error = V{}, weighted = V{}, desired = V{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      const V missing = group.wrench[k] - rendered[k], square = missing * missing;
      largest = larger(largest, square);
      error += square;
      weighted += batch_.weights[k] * square;
      desired += group.wrench[k] * group.wrench[k];
    }
    // The error, and the rounding error in it by Cauchy's inequality: half of the tolerance each at most.
    const V rounding = kUnit * kUnit * N * m_ * m_ * m_ / 2 * group.gain * change;
    const V half = settings_.tolerance * settings_.tolerance / 4 * larger(V(V{} + 1), desired);
    auto proved = (largest <= kConverged * kConverged * group.gain * change) & (error <= half) &
                  (rounding <= half) & (group.size < V{} + settings_.largest);
    const auto separated = guessed_ ? group.conflict > V{} : V{} > V{};
    if (last && guessed_) proved = proved & (!separated | (group.guess_right > V{}));
    if (!last && any(!(proved | separated))) {
      group.guess_right = proved ? V{} + 1 : V{};
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) std::swap(group.dual[k], group.other[k]);
      return false;
    }
    const V residual = square_root<double, L>(weighted);
    double unused[M > N ? M : N], *to_tensions[L], *to_rendered[L];
    int taken = 0;
    for (int l = 0; l < L; ++l) {
      const std::size_t row = group.first + static_cast<std::size_t>(l);
      const bool take = l < group.count && holds(proved, l);
      taken += take;
      to_tensions[l] = take ? answer_.tensions + row * static_cast<std::size_t>(m_) : unused;
      to_rendered[l] = take ? answer_.rendered + row * N : unused;
    }
    store_rows<double, L>(tensions, m_, to_tensions);
    store_rows<double, L>(rendered, N, to_rendered);
    if (taken == L) {
      store(residual, answer_.residual + group.first);
      store_exact(group.first, L);
      return true;
    }
    remainder_.invalid = remainder_.invalid || any(!(group.size < V{} + settings_.largest));
    V direction[N] = {};
    if (has(Route::separation_in_sweep) && last) find_direction(group, limit, direction);
    for (int k = 0; k < N; ++k) direction[k] = separated ? group.separating[k] : direction[k];
    for (int l = 0; l < group.count; ++l) {
      const std::size_t row = group.first + static_cast<std::size_t>(l);
      if (holds(proved, l)) {
        answer_.residual[row] = read<double>(residual, l);
        store_exact(row, 1);
      } else {
        for (int k = 0; k < N; ++k) answer_.separation[row * N + k] = read<double>(direction[k], l);
        answer_.iterations[row] = kEvaluations;
        remainder_.rows[remainder_.count++] = row;
      }
    }
    return true;
  }

  // Finds the direction in which the nearest face is looked for: a multiplier of the last steps that separates the
  // wrench from all feasible ones. Where there is no answer, multipliers soon point away from the feasible set,
  // and then overshoot; an earlier one is good enough to start with.
  void find_direction(const Group& group, const Limits& limit, V (&direction)[N]) const {
    const auto last = separation_margin(group, limit, group.dual) > V{};
    const auto one_before = separation_margin(group, limit, group.before[kSteps - 1]) > V{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      direction[k] = one_before ? group.before[kSteps - 1][k] : group.before[kSteps - 2][k];
      direction[k] = last ? group.dual[k] : direction[k];
    }
  }

  // d'w - h(d), less its rounding error: where positive, d separates w from all feasible wrenches.
  V separation_margin(const Group& group, const Limits& limit, const V (&d)[N]) const {
    V sum = V{}, size = V{};
    TENSIONLAB_UNROLL
    for (int k = 0; k < N; ++k) {
      sum += d[k] * group.wrench[k];
      size += magnitude(V(d[k] * group.wrench[k]));
    }
    for (int i = 0; i < m_; ++i) {
      V pull = V{}, parts = V{};
      TENSIONLAB_UNROLL
      for (int k = 0; k < N; ++k) {
        const V part = group.structure[k * m_ + i] * d[k];
        pull += part;
        parts += magnitude(part);
      }
      sum -= larger(V(pull * limit.lower[i]), V(pull * limit.upper[i]));
      size += parts * larger(magnitude(limit.lower[i]), magnitude(limit.upper[i]));
    }
    return sum - (N + m_ + 3) * std::numeric_limits<double>::epsilon() * size;
  }

  void store_exact(std::size_t first, std::size_t count) const {
    std::fill_n(answer_.separation + first * N, count * N, 0.0);
    std::fill_n(answer_.scale + first, count, 1.0);
    std::fill_n(answer_.status + first, count, std::int8_t{0});
    std::fill_n(answer_.iterations + first, count, kEvaluations);
  }

  const Batch& batch_;
  int m_;
  SweepSettings settings_;
  SweepAnswer answer_;
  SweepRemainder& remainder_;
  bool shared_;   // all rows have the same limits and references
  bool guessed_;  // the null space is small
  Limits limits_[kGroups];
  Group group_[kGroups];
};

void sweep(const Batch& batch, const SweepSettings& settings, std::size_t begin, std::size_t end,
           const SweepAnswer& answer, SweepRemainder& remainder) {
  with_size(batch.n, [&](auto n) {
    Sweep<TENSIONLAB_LANES, n, kMaxCables>(batch, settings, answer, remainder).solve(begin, end);
  });
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
