// The motor's supply: a source that gives and does not take, its wires, and the capacitor at the bridge.
#pragma once

#include <algorithm>

namespace tensionlab {
namespace plant {

struct SupplyParameters {
  double source = 12.0;       // V
  double resistance = 0.1;    // of source and wires, ohm
  double capacitance = 1e-3;  // F
  double leakage = 1200.0;    // ohm: what hangs on it besides the bridge draws 10 mA
};

class Supply {
 public:
  explicit Supply(const SupplyParameters& parameters) : p_(parameters), voltage_(parameters.source) {}

  // drawn: A, negative where the motor brakes a hand that pulls.
  void advance(double drawn, double seconds) {
    // The source charges the capacitor; nothing flows back into it. Solved for the voltage at the end of the step,
    // which stays stable where the capacitor is small.
    const double share = seconds / p_.capacitance;
    const double alone = (voltage_ - share * drawn) / (1.0 + share / p_.leakage);
    const double charged = (voltage_ - share * drawn + share * p_.source / p_.resistance) /
                           (1.0 + share / p_.leakage + share / p_.resistance);
    voltage_ = std::max(alone > p_.source ? alone : charged, 0.0);
  }

  // The source gives another voltage from now on.
  void set_source(double volts) { p_.source = volts; }
  double voltage() const { return voltage_; }

 private:
  SupplyParameters p_;
  double voltage_;
};

}  // namespace plant
}  // namespace tensionlab
