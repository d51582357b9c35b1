// Directions of wrenches that move with the pose of a cell, and the pull of the cables along them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "simd/linear.hpp"
#include "workspace/cell_columns.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// v + mu, with mu linear in the pose: then (v + mu) . w is also affine in the pose and quadratic in the position.
template <int N, int D>
class MovingDirection {
 public:
  using Columns = CellColumns<N, D>;
  static constexpr int M = kMaxCables;

  // far: it moves by as much as v is long in the norm sum of |v . w|.
  enum class Motion { none, near, far };

  double v[N];
  typename Columns::Pull pull;
  double mu[N][N];  // for each component of the pose
  double longest;   // largest |mu|

  MovingDirection(const Columns& columns, const double* direction) : columns_(columns) {
    std::copy(direction, direction + N, v);
    columns_.pull(v, pull);
    stop();
  }

  // Another direction with the same motion.
  MovingDirection(const MovingDirection& other, const double* direction) : MovingDirection(other) {
    std::copy(direction, direction + N, v);
    columns_.pull(v, pull);
    if (longest > 0) join();
  }

  // Makes it stay across the cables that it is across, to first order. It does not move where it would have to
  // move by more than its length, or far and may_move_far is false. Cables without a bit in `counted` do not count
  // for the norm.
  Motion follow(std::uint32_t spanning, std::uint32_t counted, bool may_move_far) {
    double basis[N][N];
    int own[N], count;
    if (!dual_to(spanning, own, count, basis)) return Motion::none;
    clear();
    double room = 0, moves = 0, doubt = 0;
    for (int i = 0; i < columns_.moves; ++i) {
      for (int a = 0; a < count; ++a) {
        for (int k = 0; k < N; ++k) mu[i][k] -= pull.slope[i][own[a]] * basis[a][k];
      }
      longest += columns_.edge(i) * length_of(mu[i], 0);
      for (int j = 0; j < columns_.m; ++j) {
        const double moved = add(i, j);
        if (counted >> j & 1) moves += moved;
      }
    }
    for (int j = 0; j < columns_.m; ++j) {
      if (!(counted >> j & 1)) continue;
      room += spanning >> j & 1 ? 0 : std::abs(pull.value[j]);
      doubt += kDoubt * columns_.largest[j];
    }
    const bool far = !(moves + doubt < 0.9 * room);
    if (!(longest < 1) || (far && !may_move_far)) {
      stop();
      return Motion::none;
    }
    join();
    return far ? Motion::far : Motion::near;
  }

  // Makes it across columns themselves, instead of moved ones.
  void straighten(std::uint32_t spanning) {
    double basis[N][N];
    int own[N], count;
    if (!dual_to(spanning, own, count, basis)) return;
    for (int a = 0; a < count; ++a) {
      for (int k = 0; k < N; ++k) v[k] -= pull.value[own[a]] * basis[a][k];
    }
    columns_.pull(v, pull);
  }

  // Finds v, tilted against the cables that it is across so that they pull the other way in all of the cell.
  bool lean(std::uint32_t spanning, double* leaning) const {
    constexpr double kEnough = 1.1;  // since the effect of tilting varies over the cell, too
    double basis[N][N];
    int own[N], count;
    if (!dual_to(spanning, own, count, basis)) return false;
    std::copy(v, v + N, leaning);
    for (int a = 0; a < count; ++a) {
      const double needed = kEnough * (std::abs(pull.value[own[a]]) + reach(own[a]) + pull.error[own[a]]);
      for (int k = 0; k < N; ++k) leaning[k] -= needed * basis[a][k];
    }
    return true;
  }

  // The largest change of the pull of a cable, up to the error.
  double reach(int j) const {
    const double low = columns_.dip([&](int i) { return pull.curve[i][j]; });
    const double high = columns_.dip([&](int i) { return -pull.curve[i][j]; });
    return columns_.reach([&](int i) { return pull.slope[i][j]; }) - std::min(low, high);
  }

  double length() const { return length_of(v, 0); }
  double torque() const { return length_of(v, D); }

 private:
  // More than the change of the norm by rays' errors of 2^-22, and by hyperplanes that are not quite the columns'.
  static constexpr double kDoubt = 0x1p-20;

  const Columns& columns_;
  typename Columns::Pull added_;  // by the motion

  static double length_of(const double* a, int first) {
    double sum = 0;
    for (int k = first; k < N; ++k) sum += a[k] * a[k];
    return std::sqrt(sum);
  }

  void stop() {
    for (auto& row : mu) std::fill(row, row + N, 0.0);
    longest = 0;
  }

  void clear() {
    for (int j = 0; j < columns_.m; ++j) {
      added_.error[j] = 0;
      for (int i = 0; i < N; ++i) added_.slope[i][j] = 0;
      for (int i = 0; i < Columns::kCurves; ++i) added_.curve[i][j] = 0;
    }
  }

  // Adds component i of the motion to the pull of cable j; returns its largest value to first order.
  double add(int i, int j) {
    double a[D], along = 0, square = 0;
    columns_.lever(mu[i], j, a);
    for (int k = 0; k < D; ++k) {
      along += a[k] * columns_.u[k][j];
      square += a[k] * a[k];
    }
    added_.slope[i][j] = along;
    // mu . (w - its value in the middle): its part that is linear in the position is a curve, twice where both
    // components are the same.
    for (int k = 0; k < D && i < D; ++k) {
      const double both = -(a[k] - along * columns_.u[k][j]) * columns_.inverse[j];
      const int row = std::max(i, k), column = std::min(i, k);
      added_.curve[row * (row + 1) / 2 + column][j] += i == k ? 2 * both : both;
    }
    const double left = i < D ? columns_.bent[j] : columns_.change[j];
    added_.error[j] += columns_.edge(i) * (std::sqrt(square) * left + length_of(mu[i], D) * columns_.swing[j]);
    return columns_.edge(i) * std::abs(along);
  }

  void join() {
    for (int j = 0; j < columns_.m; ++j) {
      pull.error[j] += added_.error[j];
      for (int i = 0; i < N; ++i) pull.slope[i][j] += added_.slope[i][j];
      for (int i = 0; i < Columns::kCurves; ++i) pull.curve[i][j] += added_.curve[i][j];
    }
  }

  // Finds the columns of a mask, and vectors dual to them; returns false where they are nearly dependent.
  bool dual_to(std::uint32_t chosen, int (&own)[N], int& count, double (&basis)[N][N]) const {
    double column[N][N];
    count = 0;
    for (int j = 0; j < columns_.m; ++j) {
      if (!(chosen >> j & 1)) continue;
      for (int k = 0; k < N; ++k) column[count][k] = columns_.column[k][j];
      own[count++] = j;
    }
    return dual_basis<N>(column, count, 1e-5, basis);
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
