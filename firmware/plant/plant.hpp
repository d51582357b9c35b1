// The hardware around a module's core, simulated: sensors and current control as esp32/ has them, in short.
#pragma once

#include <cmath>
#include <cstdint>
#include <utility>

#include "../core/module.hpp"
#include "current_control.hpp"
#include "heat.hpp"
#include "noise.hpp"
#include "spool.hpp"

namespace tensionlab {
namespace plant {

// What can break.
struct Breakage {
  bool encoder = false;  // reads an error
  bool supply = false;   // sinks to 5 V
  bool motor = false;    // a wire is off: no current
  bool brake = false;    // the servo does not move
  bool cable = false;    // is cut: nothing holds the far end
};

struct PartInfo {
  const char* name;
  bool Breakage::* member;
};

inline constexpr PartInfo kParts[] = {{"encoder", &Breakage::encoder},
                                      {"supply", &Breakage::supply},
                                      {"motor", &Breakage::motor},
                                      {"brake", &Breakage::brake},
                                      {"cable", &Breakage::cable}};

class Plant {
 public:
  Plant(const PlantParameters& parameters, double distance, std::uint64_t seed)
      : p_(parameters), noise_(seed), spool_(parameters, distance), heat_(parameters) {}

  // The far end of the cable is `distance` m from the module, moving at `speed` m/s.
  void place_end(double distance, double speed) { spool_.place_end(distance, speed); }

  void advance(const firmware::Actuators& wanted, const firmware::Parameters& settings, double seconds) {
    move_current(wanted, settings, seconds);
    move_servo(wanted, settings, seconds);
    spool_.cut = broken.cable;
    spool_.advance(torque_current_, seconds);
    const double measured = encoder_angle();
    const double share = seconds / (p_.speed_filter + seconds);
    measured_speed_ += share * ((measured - angle_) / seconds - measured_speed_);
    angle_ = measured;
  }

  // What the front end measures and works out from it, as esp32/winch.cpp does.
  firmware::Sensors sense(std::uint32_t now_us) {
    const double supply = (broken.supply ? 5.0 : p_.supply) + p_.supply_noise * noise_.normal();
    const double current = control_.current_q() + p_.current_noise * noise_.normal();
    const double share = supply / static_cast<double>(firmware::board::kNominalSupply);
    const double resistance = static_cast<double>(firmware::board::kWarmResistance);
    const double reactance = static_cast<double>(firmware::board::kPhaseInductance) * electrical_speed_;
    const double d = control_.current_d();
    const double induced = share * control_.voltage_q() - resistance * current - reactance * d;
    const double across = share * control_.voltage_d() - resistance * d + reactance * current;
    return {now_us,
            static_cast<float>(angle_),
            static_cast<float>(measured_speed_),
            static_cast<float>(std::floor(current / p_.current_count + 0.5) * p_.current_count),
            on_ ? static_cast<float>(induced) : 0.0f,
            on_ ? static_cast<float>(across) : 0.0f,
            static_cast<float>(supply),
            static_cast<float>(heat_.thermistor()),
            !broken.encoder};
  }

  // The electrical zero is found: returns by how much it was wrong, rad.
  double align() { return std::exchange(p_.zero_error, 0.0); }

  const Spool& spool() const { return spool_; }
  const Heat& heat() const { return heat_; }
  double current() const { return current_; }  // of the motor, as it is asked for, A

  Breakage broken;

 private:
  // The control follows the angle that the encoder says, along the way that the settings take for pulling.
  void move_current(const firmware::Actuators& wanted, const firmware::Parameters& settings, double seconds) {
    way_ = static_cast<double>(settings[firmware::Parameter::motor_direction]);
    on_ = wanted.driver_on;
    if (!on_) control_.reset();
    const double supply = broken.supply ? 5.0 : p_.supply;
    const double angle = -way_ * firmware::board::kPolePairs * angle_;
    electrical_speed_ = -way_ * firmware::board::kPolePairs * spool_.speed() / p_.radius;
    const double rotor = -way_ * firmware::board::kPolePairs * spool_.turned() + p_.zero_error;
    const double flux = p_.torque_constant / (1.5 * firmware::board::kPolePairs);
    Duties duties{};
    if (on_) duties = control_.advance(static_cast<double>(wanted.current), motor_.current(), angle, seconds);
    const Vector voltage = duties.voltage(supply);
    motor_.advance(on_ && !broken.motor ? &voltage : nullptr, rotor, electrical_speed_, heat_.resistance(),
                   p_.inductance, flux, seconds);
    const Vector& current = motor_.current();
    heat_.advance(current.alpha * current.alpha + current.beta * current.beta, on_, seconds);
    current_ = motor_.along_q(angle);
    torque_current_ = way_ * motor_.along_q(rotor);
  }

  // The servo moves between the two pulses.
  void move_servo(const firmware::Actuators& wanted, const firmware::Parameters& settings, double seconds) {
    if (broken.brake) return;
    const double open = static_cast<double>(settings[firmware::Parameter::brake_open_pulse]);
    const double closed = static_cast<double>(settings[firmware::Parameter::brake_closed_pulse]);
    const double pulse = static_cast<double>(wanted.brake_pulse_us);
    spool_.move_servo(closed == open ? 0.0 : (pulse - open) / (closed - open), seconds);
  }

  double encoder_angle() {
    const double turn = 6.283185307179586;
    const double counts = spool_.turned() / turn * p_.encoder_counts + p_.encoder_noise * noise_.normal();
    return std::floor(counts) * turn / p_.encoder_counts;
  }

  PlantParameters p_;
  Noise noise_;
  Spool spool_;
  Heat heat_;
  GimbalMotor motor_;
  CurrentControl control_;
  bool on_ = false;  // the bridge
  double way_ = 1.0, electrical_speed_ = 0.0, torque_current_ = 0.0;
  double current_ = 0.0, angle_ = 0.0, measured_speed_ = 0.0;
};

}  // namespace plant
}  // namespace tensionlab
