// The basis of solvers/linear_program.hpp: cables held at limits that close in on each other, and free columns.
#pragma once

#include <cmath>
#include <limits>

#include "tensionlab/simd/linear.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// lower + rise s <= t <= upper - fall s, where s is S or, beyond [open, shut], the nearer end.
template <class Real>
struct ClosingLimits {
  Real lower, upper, rise, fall, open, shut;

  Real least(Real S) const { return lower + rise * smaller(larger(S, open), shut); }
  Real most(Real S) const { return upper - fall * smaller(larger(S, open), shut); }
};

// Cables at the ends of closing limits, followed from large S downwards: between two kinks every limit is constant
// + rate S.
template <class Real, int M>
class HeldCables {
 public:
  struct End {
    Real constant, rate;
    Real at(Real S) const { return constant + rate * S; }
  };

  ClosingLimits<Real> limits[M] = {};
  Real held[M] = {}, held_rate[M] = {};  // the end at which a cable is held; zero if it is free
  bool at_upper[M] = {}, free[M] = {};   // change these through hold, flip and release

  // Holds all m cables at their upper or lower ends, for unbounded S.
  void begin(int m, const Real* pull) {
    m_ = m;
    kink_ = -kInfinite;
    for (int i = 0; i < m_; ++i) {
      free[i] = false;
      at_upper[i] = pull[i] > 0;
      follow(i, kInfinite);
      kink_ = larger(kink_, next_[i]);
    }
  }

  // The largest S at which a limit begins or ceases to move; -infinity if there is none.
  Real kink() const { return kink_; }

  void pass_kink() {
    const Real passed = kink_;
    kink_ = -kInfinite;
    for (int i = 0; i < m_; ++i) {
      if (next_[i] >= passed) follow(i, passed);
      kink_ = larger(kink_, next_[i]);
    }
  }

  const End& end(int i, bool upper) const { return upper ? upper_[i] : lower_[i]; }

  void hold(int i, bool upper) {
    free[i] = false;
    at_upper[i] = upper;
    held[i] = end(i, upper).constant;
    held_rate[i] = end(i, upper).rate;
  }

  void release(int i) {
    free[i] = true;
    held[i] = held_rate[i] = 0;
  }

 private:
  static constexpr Real kInfinite = std::numeric_limits<Real>::infinity();

  // The ends of cable i for S just below top.
  void follow(int i, Real top) {
    const ClosingLimits<Real>& c = limits[i];
    if (top <= c.shut && top > c.open) {
      lower_[i] = {c.lower, c.rise};
      upper_[i] = {c.upper, -c.fall};
      next_[i] = c.open;
    } else {
      lower_[i] = {c.least(top), 0};
      upper_[i] = {c.most(top), 0};
      next_[i] = top > c.shut ? c.shut : -kInfinite;
    }
    if (!free[i]) hold(i, at_upper[i]);
  }

  int m_ = 0;
  Real kink_ = 0, next_[M] = {};
  End lower_[M] = {}, upper_[M] = {};
};

// The columns of the free cables, at most N independent ones.
template <class Real, int N>
class FreeColumns {
 public:
  int count() const { return span_.count; }
  int cable(int place) const { return cable_[place]; }
  void clear() { span_.count = 0; }

  void add(int cable, const Real* column) {
    const int place = span_.count;
    if (!span_.add(column, Real(-1))) return;  // never; tells the compiler
    copy<N>(column, columns_[place]);
    cable_[place] = cable;
  }

  // Adds the columns behind again, so that no error accumulates.
  void drop(int place) {
    const int last = span_.count;
    span_.count = place;
    for (int j = place + 1; j < last; ++j) add(cable_[j], columns_[j]);
  }

  void take_out(Real* x, Real* share) const { span_.take_out(x, share); }

  // Converts the parts of a vector along the basis to coefficients of the columns, in place.
  void solve(Real* share) const {
    for (int j = span_.count - 1; j >= 0; --j) {
      for (int k = j + 1; k < span_.count; ++k) share[j] -= span_.triangle[j][k] * share[k];
      share[j] /= span_.triangle[j][j];
    }
  }

  // The length of a column without its part in the span of the others, and the component along it of a vector with
  // the parts share: row `place` of the inverse triangle has both.
  Real own(int place, const Real* share, Real* along) const {
    Real row[N] = {}, square = 0, sum = 0;
    for (int k = place; k < span_.count; ++k) {
      row[k] = k == place ? Real(1) : Real(0);
      for (int j = place; j < k; ++j) row[k] -= row[j] * span_.triangle[j][k];
      row[k] /= span_.triangle[k][k];
      square += row[k] * row[k];
      sum += row[k] * share[k];
    }
    const Real length = 1 / std::sqrt(square);
    *along = sum * length;
    return length;
  }

 private:
  OrthogonalColumns<Real, N> span_{};
  int cable_[N] = {};
  Real columns_[N][N] = {};  // a row for each
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
