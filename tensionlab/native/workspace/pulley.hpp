// Cable over a swivelling pulley: its direction and length, by the formulas and conventions of
// tensionlab/model/pulleys.py. A radius of 0 is a fixed anchor.
#pragma once

namespace tensionlab {

template <class V>
struct PulleyArc {
  V straight, sine, cosine;  // of the angle of the arc
};

// Turns u, from the attachment to the anchor, into the unit vector along the cable. For numbers and lanes, with
// root(x) of x >= 0 and choose(test, yes, no). The straight part is 0 where the attachment is inside the pulley.
template <int D, class V, class Root, class Choose>
PulleyArc<V> route_over_pulley(V (&u)[D], int d, double radius, const double* axis, Root root, Choose choose) {
  V z = V{}, square = V{};
  for (int k = 0; k < d; ++k) z -= axis[k] * u[k];
  for (int k = 0; k < d; ++k) {
    u[k] = -u[k] - z * axis[k];
    square += u[k] * u[k];
  }
  const V one = V{} + 1.0;
  const V across = root(square), past = across - radius;
  const V least = across * (across - 2.0 * radius) + z * z;
  const V straight = root(choose(least > V{}, least, V{}));
  const V whole = straight * straight + radius * radius;
  const V inverse = one / choose(whole > V{}, whole, one);
  const V sine = (straight * past + radius * z) * inverse, cosine = (straight * z - radius * past) * inverse;
  const V outward = sine / choose(across > V{}, across, one);
  for (int k = 0; k < d; ++k) u[k] = -outward * u[k] - cosine * axis[k];
  return {straight, sine, cosine};
}

}  // namespace tensionlab
