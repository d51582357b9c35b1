// The free columns of a simplex basis, and an orthogonal basis of their span.
#pragma once

#include <cmath>

#include "simd/short_vectors.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// At most N columns of N numbers, none of which depends on the others: columns = basis * triangle.
template <class Real, int N>
class FreeColumns {
 public:
  int count() const { return count_; }
  int cable(int place) const { return cable_[place]; }
  void clear() { count_ = 0; }

  void add(int cable, const Real* column) {
    if (count_ >= N) return;  // there are no more; the compiler cannot know
    Real *last = basis_[count_], part[N] = {};
    copy<N>(column, last);
    take_out(last, part);
    take_out(last, part);
    for (int j = 0; j < count_; ++j) triangle_[j][count_] = part[j];
    triangle_[count_][count_] = normalise<N>(last);
    copy<N>(column, columns_[count_]);
    cable_[count_++] = cable;
  }

  // The columns behind are taken anew, so that no error builds up.
  void drop(int place) {
    const int last = count_;
    count_ = place;
    for (int j = place + 1; j < last; ++j) add(cable_[j], columns_[j]);
  }

  // Take out of x its part in the span, and add the part along each vector of the basis to share. Once leaves some
  // of it through rounding where x is nearly inside the span; twice does not.
  void take_out(Real* x, Real* share) const {
    for (int j = 0; j < count_; ++j) {
      const Real part = dot<N>(basis_[j], x);
      share[j] += part;
      for (int k = 0; k < N; ++k) x[k] -= part * basis_[j][k];
    }
  }

  // How much of each column makes up a vector in the span, whose parts along the basis are share; in place.
  void solve(Real* share) const {
    for (int j = count_ - 1; j >= 0; --j) {
      for (int k = j + 1; k < count_; ++k) share[j] -= triangle_[j][k] * share[k];
      share[j] /= triangle_[j][j];
    }
  }

  // A column less its part in the span of the others: its length, and what a vector with the parts share has along
  // it. Row `place` of the inverse triangle has both.
  Real own(int place, const Real* share, Real* along) const {
    Real row[N] = {}, square = 0, sum = 0;
    for (int k = place; k < count_; ++k) {
      row[k] = k == place ? Real(1) : Real(0);
      for (int j = place; j < k; ++j) row[k] -= row[j] * triangle_[j][k];
      row[k] /= triangle_[k][k];
      square += row[k] * row[k];
      sum += row[k] * share[k];
    }
    const Real length = 1 / std::sqrt(square);
    *along = sum * length;
    return length;
  }

 private:
  int count_ = 0, cable_[N] = {};
  Real columns_[N][N] = {}, basis_[N][N] = {}, triangle_[N][N] = {};  // columns_ and basis_: a row for each
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
