// The gimbal motor on its three half-bridges, and the current control that turns it: the law of the library that
// firmware/esp32 uses, with the gains of board.hpp.
#pragma once

#include <cmath>

#include "../esp32/board.hpp"

namespace tensionlab {
namespace plant {

// A vector along phase A and across it; by amplitudes, so that power is 3/2 of voltage times current.
struct Vector {
  double alpha, beta;

  Vector turned(double angle) const {
    const double cosine = std::cos(angle), sine = std::sin(angle);
    return {cosine * alpha - sine * beta, sine * alpha + cosine * beta};
  }
};

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

// Windings and rotor. Its electrical angle grows in the direction in which a positive current along q turns it.
class GimbalMotor {
 public:
  // resistance and inductance of a phase; flux in V s/rad of the electrical angle. The bridge is on, or its
  // switches are open, and then currents die out within a step.
  void advance(const Duties* duties, double supply, double angle, double speed, double resistance,
               double inductance, double flux, double seconds) {
    if (duties == nullptr) {
      current_ = {0.0, 0.0};
      return;
    }
    // The voltage that the rotor induces turns on during the step: take its middle.
    const Vector induced = Vector{0.0, flux * speed}.turned(angle + 0.5 * speed * seconds);
    const Vector voltage = duties->voltage(supply);
    const double kept = std::exp(-seconds * resistance / inductance);
    const double a = (voltage.alpha - induced.alpha) / resistance, b = (voltage.beta - induced.beta) / resistance;
    current_ = {a + (current_.alpha - a) * kept, b + (current_.beta - b) * kept};
  }

  const Vector& current() const { return current_; }  // A
  // The part of it that makes torque, at an electrical angle of the rotor.
  double along_q(double angle) const { return current_.turned(-angle).beta; }

 private:
  Vector current_ = {0.0, 0.0};
};

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
