// The three half-bridges that switch the supply to the windings, in means over a period of their switching.
#pragma once

#include <cmath>

#include "motor.hpp"

namespace tensionlab {
namespace plant {

// Shares of the supply that the half-bridges give the phases.
struct Duties {
  double a, b, c;

  // For a voltage at some supply, in the middle between the rails; what the supply cannot give is cut off.
  static Duties of(const Vector& voltage, double supply) {
    const double a = voltage.alpha, across = 0.8660254037844386 * voltage.beta;
    const double b = -0.5 * a + across, c = -0.5 * a - across;
    const double middle = 0.5 * (std::fmax(a, std::fmax(b, c)) + std::fmin(a, std::fmin(b, c)));
    const auto duty = [&](double phase) {
      return std::fmin(std::fmax(0.5 + (phase - middle) / supply, 0.0), 1.0);
    };
    return {duty(a), duty(b), duty(c)};
  }

  Vector voltage(double supply) const {
    return {supply * (2.0 * a - b - c) / 3.0, supply * (b - c) / 1.7320508075688772};
  }
};

// What a real bridge gives: its switches have a resistance (ohm), and for a share of the period both of a phase
// are open, in which its current takes the output to the rail that lies against it.
inline Vector bridge_voltage(const Duties& duties, const Vector& current, double supply, double resistance,
                             double dead_share) {
  const double across = 0.8660254037844386 * current.beta;
  const auto lost = [&](double amperes) { return dead_share * std::tanh(50.0 * amperes); };
  const Duties real = {duties.a - lost(current.alpha), duties.b - lost(-0.5 * current.alpha + across),
                       duties.c - lost(-0.5 * current.alpha - across)};
  const Vector voltage = real.voltage(supply);
  return {voltage.alpha - resistance * current.alpha, voltage.beta - resistance * current.beta};
}

}  // namespace plant
}  // namespace tensionlab
