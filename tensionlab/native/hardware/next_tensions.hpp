// What modules are to be sent next: within limits, and no faster from the last set-points than they may change.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace tensionlab {

struct NextTensions {
  std::ptrdiff_t refused = -1;  // a free module whose tension is outside its limits, NaN included; -1: none
  bool slew_limited = false;
};

// Tensions of the free modules go from `before` to those chosen, all by the same share of their way, so that the
// wrench goes straight from the old to the new one; the others stay. `commanded` is NaN where a module is not
// free.
inline NextTensions next_tensions(std::size_t m, const double* before, const double* chosen, const bool* free,
                                  const double* lower, const double* upper, double max_change, double* after,
                                  double* commanded) {
  NextTensions next;
  double largest = 0.0;
  for (std::size_t i = 0; i < m; ++i) {
    if (!free[i]) continue;
    if (!(lower[i] <= chosen[i] && chosen[i] <= upper[i])) {
      next.refused = static_cast<std::ptrdiff_t>(i);
      return next;
    }
    largest = std::max(largest, std::abs(chosen[i] - before[i]));
  }
  next.slew_limited = !(largest <= max_change);
  const double share = next.slew_limited ? max_change / largest : 1.0;
  for (std::size_t i = 0; i < m; ++i) {
    const double wanted = free[i] ? chosen[i] : before[i];
    after[i] = next.slew_limited ? before[i] + (wanted - before[i]) * share : wanted;
    commanded[i] = free[i] ? after[i] : std::numeric_limits<double>::quiet_NaN();
  }
  return next;
}

}  // namespace tensionlab
