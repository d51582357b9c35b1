// The gimbal motor: its three windings and its rotor's magnets.
#pragma once

#include <cmath>

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

// Windings and rotor. Its electrical angle grows in the direction in which a positive current along q turns it.
class GimbalMotor {
 public:
  // resistance and inductance of a phase; flux in V s/rad of the electrical angle. `voltage` is that of the
  // half-bridges, or null where their switches are open: then currents die out within a step.
  void advance(const Vector* voltage, double angle, double speed, double resistance, double inductance,
               double flux, double seconds) {
    if (voltage == nullptr) {
      current_ = {0.0, 0.0};
      return;
    }
    // The voltage that the rotor induces turns on during the step: take its middle.
    const Vector induced = Vector{0.0, flux * speed}.turned(angle + 0.5 * speed * seconds);
    const double kept = std::exp(-seconds * resistance / inductance);
    const double a = (voltage->alpha - induced.alpha) / resistance;
    const double b = (voltage->beta - induced.beta) / resistance;
    current_ = {a + (current_.alpha - a) * kept, b + (current_.beta - b) * kept};
    if (cut_phase < 0) return;
    // Without one wire, the same current goes in by one of the other two and out by the other.
    const double phase = 2.0943951023931953 * cut_phase;
    current_ = Vector{0.0, current_.turned(-phase).beta}.turned(phase);
  }

  const Vector& current() const { return current_; }  // A
  // The part of it that makes torque, at an electrical angle of the rotor.
  double along_q(double angle) const { return current_.turned(-angle).beta; }

  int cut_phase = -1;  // 0, 1 or 2: the phase whose wire is off

 private:
  Vector current_ = {0.0, 0.0};
};

}  // namespace plant
}  // namespace tensionlab
