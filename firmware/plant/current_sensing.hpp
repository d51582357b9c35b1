// Shunts, amplifiers and the ESP32's converter: from currents and the supply to counts.
#pragma once

#include <algorithm>
#include <cmath>

#include "motor.hpp"
#include "noise.hpp"

namespace tensionlab {
namespace plant {

struct SensingParameters {
  double shunt = 0.010, gain = 50.0;   // ohm, V/V
  double sign_a = 1.0, sign_b = -1.0;  // the shield's second amplifier is the other way round
  double middle = 1.65;                // V at no current
  double divider = 11.0;               // of the supply
  double pull_up = 1e4;                // above the thermistor, ohm
  // The converter counts nothing up to `dead` V, all 4095 from `full` V on, and bows in between by at most so
  // much.
  double dead = 0.0, full = 3.3, bow = 0.0;
  double noise = 0.0;  // standard deviation, counts
};

class CurrentSensing {
 public:
  enum class Input { phase_a, phase_b, supply, thermistor };

  struct Measured {
    Vector current;     // A
    double supply;      // V
    double thermistor;  // ohm
  };

  CurrentSensing(const SensingParameters& parameters, std::uint64_t seed) : p_(parameters), noise_(seed) {}

  // Counts, 0 to 4095.
  int convert(Input input, const Measured& measured) {
    const double share = std::clamp((volts(input, measured) - p_.dead) / (p_.full - p_.dead), 0.0, 1.0);
    const double bowed = share + 4.0 * p_.bow / p_.full * share * (1.0 - share);
    const double counts = 4095.0 * bowed + (p_.noise > 0.0 ? p_.noise * noise_.normal() : 0.0);
    return static_cast<int>(std::lround(std::clamp(counts, 0.0, 4095.0)));
  }

  double shift = 0.0;  // that the radio adds to each input, V

 private:
  double volts(Input input, const Measured& measured) const {
    if (input == Input::supply) return shift + measured.supply / p_.divider;
    if (input == Input::thermistor) return shift + 3.3 / (1.0 + p_.pull_up / measured.thermistor);
    const Vector& current = measured.current;
    const double b = -0.5 * current.alpha + 0.8660254037844386 * current.beta;
    const double phase = input == Input::phase_a ? p_.sign_a * current.alpha : p_.sign_b * b;
    return shift + p_.middle + p_.shunt * p_.gain * phase;
  }

  SensingParameters p_;
  Noise noise_;
};

}  // namespace plant
}  // namespace tensionlab
