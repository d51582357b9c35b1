// How the direction of a cable over a swivelling pulley changes with its attachment: gradient and second
// derivative.
#pragma once

#include <algorithm>
#include <cmath>

#include "workspace/pulley.hpp"

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

// With the symbols of tensionlab/model/pulleys.py, e = -u along the cable towards the attachment, t across it in
// the plane of the pulley, f across that plane, a = 1 / s, c = 1 / rho and g = sin b / rho:
//
//   de = (t . dp) a t + (f . dp) g f      db = a t . dp      drho = sin b e . dp + cos b t . dp
//   ds = e . dp - r a t . dp              dt = -db e + cos b c (f . dp) f
//
// so that e changes by at most max(a, g) for each metre (Lipschitz). With x, y, z the parts of dp along t, f and
// e, and k = cos b c (a - g), the second derivative in the direction dp, twice, is
//
//   along e: -a² x² - g² y²     along t: -2 a² x z + r a³ x² + k y²     along f: 2 y (k x - g² z)
//
// at most max(a, g)², max(a² + r a³, k) and sqrt(k² + g⁴). These hold in the ball of moves of the attachment,
// where rho falls by at most `moved`, and so does the distance h of the rim's centre, with s² = h² - r²; b turns
// by at most moved / s. The ball must not reach the swivel axis, about which the pulley may turn at once, or the
// rim.
template <int D>
struct PulleyBend {
  bool within =
      false;           // whether the attachment is inside the pulley in all of the ball, so that there is no cable
  bool clear = false;  // ... or nowhere in it
  bool smooth = false;  // whether all that follows holds in the ball
  double u[D];          // towards the pulley, at the centre
  double gradient[D][D];
  double steepest, second;  // largest change of u, and of its gradient, in 1/m and 1/m²

  // The vector from the attachment to the anchor, and the radius and the unit axis of the pulley.
  PulleyBend(const double* vector, double radius, const double* axis, double moved) {
    double z = 0, square = 0, f[3] = {}, t[D];
    for (int k = 0; k < D; ++k) z -= axis[k] * vector[k];
    for (int k = 0; k < D; ++k) {
      u[k] = vector[k];
      t[k] = -vector[k] - z * axis[k];
      square += t[k] * t[k];
    }
    const double rho = std::sqrt(square), from_rim = std::hypot(rho - radius, z);
    const auto arc = route_over_pulley<D>(
        u, D, radius, axis, [](double x) { return std::sqrt(x); },
        [](bool test, double yes, double no) { return test ? yes : no; });
    const double nearest = from_rim - moved, least = nearest * nearest - radius * radius;
    const double closest = rho - moved;
    const double bend = 1 / arc.straight, swing = D == 3 ? arc.sine / rho : 0;
    for (int k = 0; k < D; ++k) t[k] = arc.cosine * t[k] / rho - arc.sine * axis[k];
    if constexpr (D == 3) {
      for (int k = 0; k < D; ++k) {
        const int i = (k + 1) % D, j = (k + 2) % D;
        f[k] = u[i] * t[j] - u[j] * t[i];
      }
    }
    for (int k = 0; k < D; ++k) {
      for (int i = 0; i < D; ++i) gradient[k][i] = bend * t[k] * t[i] + swing * f[k] * f[i];
    }
    constexpr double kRounding = 1 + 1e-9, kDigits = 256;
    const double a = kRounding / std::sqrt(least), c = kRounding / closest;
    const double sine = std::min(1.0, std::abs(arc.sine) + a * moved), g = D == 3 ? sine * c : 0;
    const double cosine = std::min(1.0, std::abs(arc.cosine) + a * moved);
    within = from_rim + moved < radius / kRounding;
    clear = nearest > radius * kRounding;
    // Near the rim, and near the part of the axis that cables do not come along, roots and quotients lose digits.
    smooth = nearest > 0 && least > nearest * nearest / 64 && closest > 0 && sine * c * from_rim < kDigits &&
             from_rim < 1e100;
    if (!smooth) return;
    // a - g changes by what a does, a² ds, and by what g does, cos b c db and g c drho.
    const double differ = std::abs(bend - swing) + moved * (a * a * std::hypot(1.0, radius * a) + c * (a + g));
    const double k = D == 3 ? cosine * c * std::min(a + g, differ) : 0;
    steepest = kRounding * std::max(a, g);
    second =
        kRounding * std::hypot(steepest * steepest, std::max(a * a * (1 + radius * a), k), std::hypot(k, g * g));
  }
};

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
