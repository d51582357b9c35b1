// Cables whose limits close in on each other as a number S grows; each is held at one of its limits, or free.
#pragma once

#include <limits>

#include "simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// lower + rise s <= t <= upper - fall s, where s is S or, beyond [open, shut], the nearer end.
template <class Real>
struct ClosingLimits {
  Real lower, upper, rise, fall, open, shut;

  Real least(Real S) const { return lower + rise * smaller(larger(S, open), shut); }
  Real most(Real S) const { return upper - fall * smaller(larger(S, open), shut); }
};

// Followed from large S downwards: between two kinks every limit is constant + rate S.
template <class Real, int M>
class HeldCables {
 public:
  struct End {
    Real constant, rate;
    Real at(Real S) const { return constant + rate * S; }
  };

  ClosingLimits<Real> limits[M] = {};
  Real held[M] = {}, held_rate[M] = {};  // the end at which a cable is held; nought if it is free
  bool at_upper[M] = {}, free[M] = {};   // change these through hold, flip and release

  // All m cables held at their upper ends, or lower ones, for S without bound.
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

  // The largest S at which any limit begins or ceases to move; -infinity if none does any more.
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

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
