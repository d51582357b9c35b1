// The current control that turns the motor: the law of the library that firmware/esp32 uses, with the gains of
// board.hpp.
#pragma once

#include <cmath>

#include "../esp32/board.hpp"
#include "bridge.hpp"

namespace tensionlab {
namespace plant {

// Field-oriented control of the currents along the rotor (d) and across it (q, which makes torque): the algorithm
// of SimpleFOC's foc_current. Source: Skuric et al., "SimpleFOC", Journal of Open Source Software, 2022.
class CurrentControl {
 public:
  void reset() { *this = CurrentControl(); }

  // A turn of its loop: the current that is asked for along q, in A, the current in the phases, and the electrical
  // angle as the encoder says. Gives the duties for the nominal supply.
  Duties advance(double target, const Vector& current, double angle, double seconds) {
    const Vector measured = current.turned(-angle);
    const double share = seconds / (static_cast<double>(firmware::board::kCurrentFilter) + seconds);
    d_.current += share * (measured.alpha - d_.current);
    q_.current += share * (measured.beta - q_.current);
    d_.advance(0.0, seconds);
    q_.advance(target, seconds);
    return Duties::of(Vector{d_.voltage, q_.voltage}.turned(angle),
                      static_cast<double>(firmware::board::kNominalSupply));
  }

  double current_q() const { return q_.current; }  // filtered, A
  double current_d() const { return d_.current; }
  double voltage_q() const { return q_.voltage; }  // at the nominal supply, V
  double voltage_d() const { return d_.voltage; }

 private:
  struct Axis {
    double current = 0.0, voltage = 0.0, sum = 0.0, before = 0.0;

    void advance(double target, double seconds) {
      const double most = static_cast<double>(firmware::board::kVoltageLimit), error = target - current;
      const double gain = static_cast<double>(firmware::board::kCurrentI) * 0.5 * seconds;
      sum = std::fmin(std::fmax(sum + gain * (error + before), -most), most);
      before = error;
      voltage = std::fmin(std::fmax(static_cast<double>(firmware::board::kCurrentP) * error + sum, -most), most);
    }
  };

  Axis d_, q_;
};

}  // namespace plant
}  // namespace tensionlab
