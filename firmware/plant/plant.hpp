// The hardware around a module's firmware, simulated: motor, spool, cable, brake and sensors.
//
// kPlantTable says where each number comes from: data sheets, the published module (1.5 N at 0.5 A, a one-way
// brake of 186 N; Bartels et al. 2026), or an estimate where no source gives one.
#pragma once

#include <cmath>
#include <cstdint>

#include "../core/module.hpp"
#include "motor.hpp"

namespace tensionlab {
namespace plant {

struct PlantParameters {
  double resistance, inductance, torque_constant, zero_error, supply;
  double radius, inertia, dry_friction, viscous_friction, cogging, cogging_periods;
  double stiffness, damping;
  double brake_strength, tooth, servo_time;
  double encoder_counts, encoder_noise, speed_filter, current_noise, current_count, supply_noise;
};

struct PlantInfo {
  const char* name;
  double PlantParameters::* member;
  const char* unit;
  double lower, standard;
  const char* about;
};

inline constexpr PlantInfo kPlantTable[] = {
    {"resistance", &PlantParameters::resistance, "ohm", 0.01, 2.8, "of a motor phase; GM3506 data sheet"},
    {"inductance", &PlantParameters::inductance, "H", 1e-6, 1.0e-3, "of a motor phase; estimate"},
    {"torque_constant", &PlantParameters::torque_constant, "N m/A", 1e-4, 0.0585, "8.3 / KV at KV 142"},
    {"zero_error", &PlantParameters::zero_error, "rad", -6.3, 0.0,
     "of the electrical angle that the module was aligned to"},
    {"supply", &PlantParameters::supply, "V", 0.0, 12.0, "of the three half-bridges"},
    {"radius", &PlantParameters::radius, "m", 0.001, 0.0195, "of the spool, from 3 N/A as published"},
    {"inertia", &PlantParameters::inertia, "kg m2", 1e-7, 1.2e-5, "of rotor and spool; estimate"},
    {"dry_friction", &PlantParameters::dry_friction, "N", 0.0, 0.05, "at the cable; estimate"},
    {"viscous_friction", &PlantParameters::viscous_friction, "N s/m", 0.0, 0.05, "at the cable; estimate"},
    {"cogging", &PlantParameters::cogging, "N", 0.0, 0.03, "at the cable; estimate"},
    {"cogging_periods", &PlantParameters::cogging_periods, "1", 0.0, 264.0, "a turn: 24 slots, 22 poles"},
    {"stiffness", &PlantParameters::stiffness, "N/m", 0.0, 4000.0, "of cable and attachments; estimate"},
    {"damping", &PlantParameters::damping, "N s/m", 0.0, 3.0, "of the cable; estimate"},
    {"brake_strength", &PlantParameters::brake_strength, "N", 0.0, 186.0,
     "beyond which the pawl slips; as published"},
    {"tooth", &PlantParameters::tooth, "m", 1e-4, 0.003, "of cable from tooth to tooth; estimate"},
    {"servo_time", &PlantParameters::servo_time, "s", 1e-3, 0.05, "of the brake servo from end to end; estimate"},
    {"encoder_counts", &PlantParameters::encoder_counts, "1", 16.0, 16384.0, "a turn: AS5048A, 14 bit"},
    {"encoder_noise", &PlantParameters::encoder_noise, "counts", 0.0, 1.0, "standard deviation; estimate"},
    {"speed_filter", &PlantParameters::speed_filter, "s", 0.0, 2.0e-3,
     "time constant of the measured speed; estimate"},
    {"current_noise", &PlantParameters::current_noise, "A", 0.0, 0.005, "standard deviation; estimate"},
    {"current_count", &PlantParameters::current_count, "A", 1e-6, 0.0016, "a count: 3.3 A either way in 12 bits"},
    {"supply_noise", &PlantParameters::supply_noise, "V", 0.0, 0.05, "standard deviation; estimate"},
};

inline PlantParameters standard_plant() {
  PlantParameters parameters;
  for (const PlantInfo& info : kPlantTable) parameters.*info.member = info.standard;
  return parameters;
}

// Random numbers that are the same everywhere: xorshift64*.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : state_(seed * 2685821657736338717ull + 88172645463325252ull) {}

  double uniform() {  // 0 to 1
    state_ ^= state_ >> 12;
    state_ ^= state_ << 25;
    state_ ^= state_ >> 27;
    return static_cast<double>((state_ * 2685821657736338717ull) >> 11) * 0x1p-53;
  }

  // Near enough to a normal distribution, of standard deviation 1: four uniform numbers.
  double normal() { return (uniform() + uniform() + uniform() + uniform() - 2.0) * 1.7320508; }

 private:
  std::uint64_t state_;
};

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
      : p_(parameters), noise_(seed), out_(distance), pawl_(distance), distance_(distance), zero_(distance) {}

  // The far end of the cable is `distance` m from the module, moving at `speed` m/s.
  void place_end(double distance, double speed) {
    distance_ = distance;
    end_speed_ = speed;
  }

  void advance(const firmware::Actuators& wanted, const firmware::Parameters& settings, double seconds) {
    move_current(wanted, settings, seconds);
    move_servo(wanted, settings, seconds);
    move_spool(seconds);
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
    const double resistance = static_cast<double>(firmware::board::kPhaseResistance);
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
            !broken.encoder};
  }

  double tension() const { return tension_; }          // of the cable, N
  double length() const { return out_; }               // paid out, without stretch, m
  double current() const { return current_; }          // of the motor, as it is asked for, A
  double brake_force() const { return brake_force_; }  // that the pawl holds, N
  bool pawl_down() const { return servo_ > 0.5; }

  Breakage broken;

 private:
  // The control follows the angle that the encoder says, along the way that the settings take for pulling.
  void move_current(const firmware::Actuators& wanted, const firmware::Parameters& settings, double seconds) {
    way_ = static_cast<double>(settings[firmware::Parameter::motor_direction]);
    on_ = wanted.driver_on;
    if (!on_) control_.reset();
    const double supply = broken.supply ? 5.0 : p_.supply;
    const double angle = -way_ * firmware::board::kPolePairs * angle_;
    electrical_speed_ = -way_ * firmware::board::kPolePairs * speed_ / p_.radius;
    const double rotor = -way_ * firmware::board::kPolePairs * (out_ - zero_) / p_.radius + p_.zero_error;
    const double flux = p_.torque_constant / (1.5 * firmware::board::kPolePairs);
    Duties duties{};
    if (on_) duties = control_.advance(static_cast<double>(wanted.current), motor_.current(), angle, seconds);
    motor_.advance(on_ && !broken.motor ? &duties : nullptr, supply, rotor, electrical_speed_, p_.resistance,
                   p_.inductance, flux, seconds);
    current_ = motor_.along_q(angle);
    torque_current_ = way_ * motor_.along_q(rotor);
  }

  // The servo moves between the two pulses at its own pace.
  void move_servo(const firmware::Actuators& wanted, const firmware::Parameters& settings, double seconds) {
    if (broken.brake) return;
    const double open = static_cast<double>(settings[firmware::Parameter::brake_open_pulse]);
    const double closed = static_cast<double>(settings[firmware::Parameter::brake_closed_pulse]);
    const double target =
        closed == open ? 0.0 : (static_cast<double>(wanted.brake_pulse_us) - open) / (closed - open);
    const double step = seconds / p_.servo_time;
    const bool down = pawl_down();
    // A loaded pawl is jammed: it can be laid on, but not lifted.
    if (target < servo_ && brake_force_ > 0.5) return;
    servo_ += std::fmin(std::fmax(target - servo_, -step), step);
    if (!down && pawl_down()) pawl_ = next_tooth();
  }

  // The first tooth at or beyond the cable that is out.
  double next_tooth() const { return std::ceil((out_ - zero_) / p_.tooth) * p_.tooth + zero_; }

  void move_spool(double seconds) {
    const double mass = p_.inertia / (p_.radius * p_.radius);
    const double stretch = distance_ - out_;
    tension_ = 0.0;
    if (!broken.cable && stretch > 0.0) {
      tension_ = std::fmax(p_.stiffness * stretch + p_.damping * (end_speed_ - speed_), 0.0);
    }
    const double cogging = p_.cogging * std::sin(p_.cogging_periods * (out_ - zero_) / p_.radius);
    const double pull = p_.torque_constant / p_.radius * torque_current_ + cogging;
    const double push = tension_ - pull - p_.viscous_friction * speed_;  // of paying out
    brake_force_ = 0.0;
    // Dry friction takes away at most what would stop the spool within the step.
    double speed = speed_ + push / mass * seconds;
    const double grip = p_.dry_friction / mass * seconds;
    speed = speed > grip ? speed - grip : (speed < -grip ? speed + grip : 0.0);
    if (pawl_down()) {
      // One way: reeled in, an earlier tooth holds; where it slipped, a later one.
      const bool slipped = out_ > pawl_ + 0.01 * p_.tooth;
      pawl_ = slipped ? next_tooth() : std::fmin(pawl_, next_tooth());
      const double free = (pawl_ - out_) / seconds;
      if (speed > free) {
        const double held = push - p_.dry_friction - mass * (free - speed_) / seconds;
        if (held <= p_.brake_strength) {
          brake_force_ = std::fmax(push, 0.0);
          speed = free;
        }
      }
    }
    // Energy-conserving order: the new speed moves the spool.
    speed_ = speed;
    out_ += speed_ * seconds;
  }

  double encoder_angle() {
    const double turn = 6.283185307179586;
    const double counts =
        (out_ - zero_) / p_.radius / turn * p_.encoder_counts + p_.encoder_noise * noise_.normal();
    return std::floor(counts) * turn / p_.encoder_counts;
  }

  PlantParameters p_;
  Noise noise_;
  GimbalMotor motor_;
  CurrentControl control_;
  bool on_ = false;  // the bridge
  double way_ = 1.0, electrical_speed_ = 0.0, torque_current_ = 0.0;
  double out_, pawl_, distance_, zero_;
  double speed_ = 0.0, end_speed_ = 0.0, tension_ = 0.0, current_ = 0.0, brake_force_ = 0.0;
  double servo_ = 0.0;  // 0 open, 1 closed
  double angle_ = 0.0, measured_speed_ = 0.0;
};

}  // namespace plant
}  // namespace tensionlab
