// Exact line search: the maximum of a dual (solvers/dual_step.hpp) along a path, in every lane at once.
//
// The slope is piecewise linear and falls, so that its root lies between two breakpoints, where a cable reaches or
// leaves a limit. Newton steps inside a bracket find that piece; where they leave the bracket, the next breakpoint
// is taken.
#pragma once

#include "simd/lane_problem.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L, int N, int M>
class LineSearch {
 public:
  using V = Lanes<Real, L>;

  // wanted: tensions without limits at step 1 along the path. pull and curvature: at step s the slope is
  // pull - curvature (s - 1) less the sum of tension times W_i'path.
  LineSearch(const LaneProblems<Real, L, N, M>& problem, const V (&wanted)[M], const V (&path)[N], const V& pull,
             const V& curvature)
      : problem_(problem), wanted_(wanted), pull_(pull), curvature_(curvature) {
    bend_at_one_ = curvature;
    for (int i = 0; i < problem.m; ++i) {
      along_[i] = problem.along(i, path);
      const auto free = (wanted[i] > problem.lower[i]) & (wanted[i] < problem.upper[i]);
      bend_at_one_ += free ? V(along_[i] * along_[i]) : V{};
    }
  }

  // The step where the slope is zero or negligible, in the open lanes; 1 in the others. first: the slope at step
  // 0, which is positive.
  template <class Mask>
  V root(const V& first, const V& slope_at_one, const V& negligible, const Mask& open_lanes) const {
    const V zero = V{}, one = zero + Real(1);
    V step = one, slope = slope_at_one, bend = bend_at_one_;
    V low = zero, low_slope = first, high = zero + kFar, high_slope = zero - one;
    auto open = open_lanes;
    for (int round = 0; round < kRounds && any(open); ++round) {
      const auto left = slope > zero;
      low = left ? step : low;
      low_slope = left ? slope : low_slope;
      high = left ? high : step;
      high_slope = left ? high_slope : slope;
      V next = step + slope / bend;
      const auto outside = (next <= low) | (next >= high);
      if (any(open & outside)) next = outside ? next_breakpoint(low, low_slope, high, high_slope) : next;
      const auto inside = (next > low) & (next < high);
      step = open ? (inside ? next : low) : step;
      open = open & inside;
      slope = pull_ - curvature_ * (step - one);
      bend = curvature_;
      for (int i = 0; i < problem_.m; ++i) {
        const V wanted = wanted_[i] + (step - one) * along_[i];
        const V tension = smaller(larger(wanted, problem_.lower[i]), problem_.upper[i]);
        slope -= along_[i] * tension;
        const auto free = (wanted > problem_.lower[i]) & (wanted < problem_.upper[i]);
        bend += free ? V(along_[i] * along_[i]) : zero;
      }
      open = open & (magnitude(slope) > negligible);
    }
    return step;
  }

 private:
  static constexpr int kRounds = 2 * M + 8;
  static constexpr Real kFar = Real(1e9);  // beyond all breakpoints

  // The first breakpoint inside the bracket; without one the slope is linear there, and its root is known.
  V next_breakpoint(const V& low, const V& low_slope, const V& high, const V& high_slope) const {
    const V zero = V{}, one = zero + Real(1);
    V first = high;
    for (int i = 0; i < problem_.m; ++i) {
      const V pace = one / (along_[i] == zero ? zero + Real(1e-30) : along_[i]);
      const V at_lower = one + (problem_.lower[i] - wanted_[i]) * pace;
      const V at_upper = one + (problem_.upper[i] - wanted_[i]) * pace;
      first = ((at_lower > low) & (at_lower < first)) ? at_lower : first;
      first = ((at_upper > low) & (at_upper < first)) ? at_upper : first;
    }
    const V root = (low * high_slope - high * low_slope) / (high_slope - low_slope);
    return first < high ? first : root;
  }

  const LaneProblems<Real, L, N, M>& problem_;
  const V (&wanted_)[M];
  V along_[M], pull_, curvature_, bend_at_one_;
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
