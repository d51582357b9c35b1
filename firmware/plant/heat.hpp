// How warm the winding, the motor's housing and the driver really are.
#pragma once

#include <cmath>

#include "parameters.hpp"

namespace tensionlab {
namespace plant {

class Heat {
 public:
  explicit Heat(const PlantParameters& parameters)
      : winding(parameters.ambient), housing(parameters.ambient), driver(parameters.ambient), p_(parameters) {}

  // Resistance of a phase, which grows with the copper's temperature, ohm.
  double resistance() const { return p_.resistance * (1.0 + 0.00393 * (winding - 20.0)); }

  // By the squared amplitude of the current, A², while the bridge switches or not.
  void advance(double square, bool switching, double seconds) {
    const double inward = (winding - housing) / p_.winding_to_housing;
    const double outward = (housing - p_.ambient) / p_.housing_to_ambient;
    // A switch's resistance grows by two thirds up to 125 °C.
    const double hot = p_.driver_resistance * (1.0 + 0.0067 * (driver - 25.0));
    const double lost = 1.5 * hot * square + (switching ? p_.driver_idle_power : 0.0);
    winding += seconds * (1.5 * resistance() * square - inward) / p_.winding_capacity;
    housing += seconds * (inward - outward) / p_.housing_capacity;
    driver += seconds * (lost - (driver - p_.ambient) / p_.driver_to_ambient) / p_.driver_capacity;
  }

  // Of a thermistor of 10 kOhm at 25 °C and a beta of 3950 K on the housing, ohm.
  double thermistor() const { return 1e4 * std::exp(3950.0 * (1.0 / (housing + 273.15) - 1.0 / 298.15)); }

  double winding, housing, driver;  // °C

 private:
  PlantParameters p_;
};

}  // namespace plant
}  // namespace tensionlab
