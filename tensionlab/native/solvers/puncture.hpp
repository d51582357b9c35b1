// The puncture method: from the tensions of least norm towards the middle of the limits, until none is too low.
#pragma once

#include "solvers/equilibrium.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// Mueller, Reichert, Bruckmann (2015): t = t_p + s (t_cf - t_p) with the least s in [0, 1] that keeps the limits,
// and s = 1 where none does. t_p is the solution of least norm, t_cf the one closest to the middle of the limits.
template <class Real, int N, int M>
void puncture_tensions(const LooseCables<Real, N, M>& loose, Real rank_tolerance, Real* tensions) {
  const Equilibrium<Real, N, M> plane(loose, rank_tolerance);
  Real least[M], central[M];
  for (int i = 0; i < loose.count; ++i) {
    least[i] = 0;
    central[i] = (loose.lower[i] + loose.upper[i]) / 2;
  }
  plane.project(least);
  plane.project(central);

  Real from = 0, to = 1;  // the s that keep all limits
  for (int i = 0; i < loose.count; ++i) {
    const Real low = loose.lower[i], high = loose.upper[i], way = central[i] - least[i];
    if (least[i] < low) from = way > 0 ? larger(from, (low - least[i]) / way) : Real(2);
    if (least[i] > high) from = way < 0 ? larger(from, (high - least[i]) / way) : Real(2);
    if (way > 0 && least[i] <= high) to = smaller(to, (high - least[i]) / way);
    if (way < 0 && least[i] >= low) to = smaller(to, (low - least[i]) / way);
  }
  const Real s = from <= to ? from : Real(1);
  for (int i = 0; i < loose.count; ++i) tensions[i] = least[i] + s * (central[i] - least[i]);
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
