// The available wrench set of one pose, whatever the rank of its structure matrix: with fewer dimensions than
// there are wrench components it is flat.
#pragma once

#include <algorithm>
#include <cmath>

#include "simd/linear.hpp"
#include "workspace/wrench_set.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// One pose with any structure matrix, of rank R or, where R is 1, of rank 0. B comes from singular values.
template <int R, int M>
struct SingleWrenchSet : WrenchSet<1, kMaxComponents, R, M, Basis::full> {
  static constexpr int N = kMaxComponents;
  static constexpr bool kMayBeFlat = true;
  int components, rank;
  double range[R][N];  // orthonormal
  double size;         // how far the set may reach from zero

  template <class Whitener>
  SingleWrenchSet(const Pose& pose, int n, int m, const Whitener& whitening)
      : components(n), rank(whitening.rank) {
    for (int r = 0; r < R; ++r) {
      double square = 0;
      for (int k = 0; k < N; ++k) {
        this->basis[r][k] = r < rank && k < n ? whitening.rows[r][k] : 0.0;
        square += this->basis[r][k] * this->basis[r][k];
      }
      for (int k = 0; k < N; ++k) range[r][k] = square > 0 ? this->basis[r][k] / std::sqrt(square) : 0.0;
    }
    std::fill(this->centre, this->centre + N, 0.0);
    size = 0;
    this->zonotope.count = rank > 0 ? m : 0;
    for (int i = 0; i < m; ++i) {
      const double room = (pose.upper[i] - pose.lower[i]) / 2, middle = pose.lower[i] + room;
      double pull[N] = {}, square = 0;
      for (int k = 0; k < n; ++k) {
        pull[k] = pose.structure[k * m + i];
        this->centre[k] += pull[k] * middle;
        square += pull[k] * pull[k];
      }
      size += std::sqrt(square) * (std::abs(middle) + room);
      this->set_segment(i, pull, room);
    }
  }

  bool flat() const { return rank < components; }

  // wrench -= what of it the tensions can change
  void take_off(double* wrench) const {
    for (int pass = 0; pass < 2; ++pass) {
      for (int r = 0; r < rank; ++r) {
        double share = 0;
        for (int k = 0; k < N; ++k) share += range[r][k] * wrench[k];
        for (int k = 0; k < N; ++k) wrench[k] -= share * range[r][k];
      }
    }
  }

  // The rest of a wrench, seen from the centre: all of it is 0 where it is no more than rounding. Returns its
  // length.
  double off_range(const double* wrench, double* off) const {
    std::copy(wrench, wrench + N, off);
    take_off(off);
    double square = 0, length = 0;
    for (int k = 0; k < N; ++k) {
      square += off[k] * off[k];
      length += wrench[k] * wrench[k];
    }
    if (std::sqrt(square) > 1e-12 * (size + std::sqrt(length))) return std::sqrt(square);
    std::fill(off, off + N, 0.0);
    return 0;
  }
  double off_range(const double* wrench) const {
    double off[N];
    return off_range(wrench, off);
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
