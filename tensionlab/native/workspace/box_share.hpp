// The share of a box that lies beyond planes, with bounds that hold despite rounding.
#pragma once

#include <algorithm>
#include <cmath>

#include "tensionlab/simd/lanes.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

struct Share {
  double low, high;
};

// The share of the box |y_i| <= half_i in which value + slope . y < 0.
//
// With z_i = |slope_i| half_i it is the probability that a sum of variables, uniform from 0 to 2 z_i, is below s =
// sum z_i - value: 1 / (D! prod 2 z_i) times the sum over all corners of the box, with alternating signs, of the
// excess of s over the corner's own sum, to the power of D (Lasserre 1983, for polytopes). An axis along which
// little changes would magnify rounding errors: it is left out, and s moved by all that it could add.
template <int D>
Share share_below(double value, const double* slope, const double* half) {
  constexpr double kLittle = 0x1p-10, kRounding = 1e-7;
  double length[D], most = 0, reach = 0;
  for (int i = 0; i < D; ++i) {
    length[i] = 2 * std::abs(slope[i]) * half[i];
    most = std::max(most, length[i]);
    reach += length[i] / 2;
  }
  if (!(value > -reach)) return {value <= -reach ? 1.0 : 0.0, 1};  // NaN may be anything
  if (value >= reach) return {0, 0};
  double kept[D], left_out = 0, unit = 1;
  int count = 0;
  for (int i = 0; i < D; ++i) {
    if (length[i] > kLittle * most) {
      kept[count++] = length[i];
      unit *= count * length[i];
    } else {
      left_out += length[i];
    }
  }
  const auto chance = [&](double sum) {
    double total = 0;
    for (int corner = 0; corner < 1 << count; ++corner) {
      double beyond = sum, sign = 1;
      for (int i = 0; i < count; ++i) {
        if ((corner >> i & 1) == 0) continue;
        beyond -= kept[i];
        sign = -sign;
      }
      if (beyond <= 0) continue;
      for (int i = 0; i < count; ++i) sign *= beyond;
      total += sign;
    }
    return std::min(1.0, std::max(0.0, total / unit));
  };
  const double sum = reach - value;
  return {std::max(0.0, chance(sum - left_out) - kRounding), std::min(1.0, chance(sum) + kRounding)};
}

// An upper bound of the share of a box that lies in the union of half-spaces value + slope . y < 0.
template <int D>
class CoveredShare {
 public:
  explicit CoveredShare(const double* half) : half_(half) {}

  // Adds a half-space. One that is nearly the same as another is covered by moving that one, if this costs less.
  void add(double value, const double* slope) {
    HalfSpace added{value, {}, share_below<D>(value, slope, half_).high};
    if (!(added.share < 1)) all_ = true;  // also where the value is infinite or not a number
    if (all_) return;
    std::copy(slope, slope + D, added.slope);
    double least = added.share;
    HalfSpace* best = nullptr;
    HalfSpace moved{};
    for (int i = 0; i < count_; ++i) {
      HalfSpace both = each_[i];
      cover(both, added);
      if (both.share - each_[i].share < least) {
        least = both.share - each_[i].share;
        best = &each_[i];
        moved = both;
      }
    }
    if (best != nullptr) {
      *best = moved;
    } else if (count_ < kMost) {
      each_[count_++] = added;
    } else {
      all_ = true;
    }
  }

  double share() const {
    double sum = all_ ? 1 : 0;
    for (int i = 0; i < count_; ++i) sum += each_[i].share;
    return std::min(1.0, sum);
  }

 private:
  struct HalfSpace {
    double value, slope[D], share;
  };
  static constexpr int kMost = 16;
  const double* half_;
  HalfSpace each_[kMost];
  int count_ = 0;
  bool all_ = false;

  // Lowers the value of one half-space until it contains the other within the box: until it is at most a multiple
  // of the other there.
  void cover(HalfSpace& one, const HalfSpace& other) const {
    double along = 0, square = 0, differs = 0;
    for (int i = 0; i < D; ++i) {
      along += one.slope[i] * other.slope[i] * half_[i] * half_[i];
      square += other.slope[i] * other.slope[i] * half_[i] * half_[i];
    }
    const double factor = square > 0 ? std::max(0.0, along / square) : 0;
    for (int i = 0; i < D; ++i) differs += std::abs(one.slope[i] - factor * other.slope[i]) * half_[i];
    one.value = std::min(one.value, factor * other.value - differs);
    one.share = share_below<D>(one.value, one.slope, half_).high;
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
