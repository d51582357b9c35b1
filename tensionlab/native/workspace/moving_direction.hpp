// Directions of wrenches that move with the pose of a cell, and the pull of the cables along them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tensionlab/simd/linear.hpp"
#include "workspace/cell_columns.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// v + mu, with mu linear in the pose: then (v + mu) . w is also quadratic in the pose.
template <int N, int D>
class MovingDirection {
 public:
  using Columns = CellColumns<N, D>;
  static constexpr int M = Columns::M;

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
    for (int i = 0; i < columns_.moves; ++i) {
      for (int k = 0; k < N; ++k) {
        mu[i][k] = 0;
        for (int a = 0; a < count; ++a) mu[i][k] -= pull.slope[i][own[a]] * basis[a][k];
      }
    }
    for (int j = 0; j < columns_.m; ++j) add_linear(j);
    longest = columns_.reach([&](int i) { return length_of(mu[i]); });
    double room = 0, moves = 0, doubt = 0;
    for (int j = 0; j < columns_.m; ++j) {
      if (!(counted >> j & 1)) continue;
      moves += columns_.reach([&](int i) { return added_.slope[i][j]; });
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
    const auto curve = [&](int pair) { return pull.curve[pair][j]; };
    return columns_.reach([&](int i) { return pull.slope[i][j]; }) +
           std::max(columns_.bow(curve, 1), columns_.bow(curve, -1));
  }

  double length() const { return length_of(v); }
  double torque() const { return Columns::torque_of(v); }

 private:
  // More than the change of the norm by rays' errors of 2^-22, and by hyperplanes that are not quite the columns'.
  static constexpr double kDoubt = 0x1p-20;

  const Columns& columns_;
  typename Columns::Pull added_;  // by the motion

  static double length_of(const double* a) { return std::sqrt(dot<N>(a, a)); }

  void stop() {
    for (auto& row : mu) std::fill(row, row + N, 0.0);
    longest = 0;
  }

  // Sets what mu adds to the pull of a column. mu . (w - its value in the middle), where it is linear in the pose,
  // is a curve, twice where both components are the same.
  void add_linear(int j) {
    double left[N] = {};
    for (int pair = 0; pair < columns_.pairs(); ++pair) added_.curve[pair][j] = 0;
    for (int i = 0; i < columns_.moves; ++i) {
      const typename Columns::Lever at(columns_, mu[i], j);
      added_.slope[i][j] = at.along;
      for (int k = 0; k < columns_.moves; ++k) {
        const int row = std::max(i, k), column = std::min(i, k);
        added_.curve[row * (row + 1) / 2 + column][j] += i == k ? 2 * at.slope[k] : at.slope[k];
      }
      left[i] = at.size * columns_.bent[j] +
                Columns::torque_of(mu[i]) * columns_.swing[j] * (columns_.change[j] + columns_.angle / 2);
    }
    added_.error[j] = columns_.reach([&](int i) { return left[i]; });
  }

  void join() {
    for (int j = 0; j < columns_.m; ++j) {
      pull.error[j] += added_.error[j];
      for (int i = 0; i < columns_.moves; ++i) pull.slope[i][j] += added_.slope[i][j];
      for (int pair = 0; pair < columns_.pairs(); ++pair) pull.curve[pair][j] += added_.curve[pair][j];
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
