// The hardware around a module's firmware, simulated: motor, spool, cable, brake and sensors.
//
// Sources of the numbers: GM3506 motor and SimpleFOC shield (data sheets; Kt = 8.3 / KV), AS5048A encoder
// (14 bit), the published module (1.5 N at 0.5 A; one-way brake of 186 N; Bartels et al. 2026). What no source
// gives (inertia, friction, cogging, stretch, servo travel, noise) is an estimate, marked so below.
#pragma once

#include <cmath>
#include <cstdint>

#include "../core/module.hpp"

namespace tensionlab {
namespace plant {

struct PlantParameters {
  // Motor, as one coil that makes torque.
  double resistance = 2.8;          // ohm, of a phase
  double inductance = 1.0e-3;       // H, estimate
  double torque_constant = 0.0585;  // N m/A
  double current_loop = 1.0e-3;     // s, time constant of the current controller
  double supply = 12.0;             // V; a phase gets at most this over the square root of 3
  // Spool and rotor.
  double radius = 0.0195;           // m
  double inertia = 1.2e-5;          // kg m2, estimate
  double dry_friction = 0.12;       // N at the cable, estimate
  double viscous_friction = 0.05;   // N s/m at the cable, estimate
  double cogging = 0.05;            // N at the cable, estimate
  double cogging_periods = 264.0;   // a turn; 24 slots and 22 poles
  // Cable.
  double stiffness = 4000.0;        // N/m, estimate: 1 m of braided polyethylene and its attachments
  double damping = 3.0;             // N s/m, estimate
  // Brake.
  double brake_strength = 186.0;    // N, beyond which the pawl slips
  double tooth = 0.003;             // m of cable
  double servo_time = 0.05;         // s from one end to the other, estimate
  // Sensors.
  double encoder_counts = 16384.0;  // a turn
  double encoder_noise = 1.0;       // counts, standard deviation, estimate
  double speed_filter = 2.0e-3;     // s, time constant of the speed that the driver library reports
  double current_noise = 0.005;     // A, standard deviation, estimate
  double current_count = 0.0016;    // A a count of the converter: 3.3 A either way in 12 bits
  double supply_noise = 0.05;       // V, standard deviation, estimate
};

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
  bool encoder = false;   // reads an error
  bool supply = false;    // sinks to 5 V
  bool motor = false;     // a wire is off: no current
  bool brake = false;     // the servo does not move
  bool runaway = false;   // the cable is cut: nothing holds the far end
};

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
    move_current(wanted, seconds);
    move_servo(wanted, settings, seconds);
    move_spool(seconds);
    const double measured = encoder_angle();
    const double share = seconds / (p_.speed_filter + seconds);
    measured_speed_ += share * ((measured - angle_) / seconds - measured_speed_);
    angle_ = measured;
  }

  firmware::Sensors sense(std::uint32_t now_us) {
    const double supply = (broken.supply ? 5.0 : p_.supply) + p_.supply_noise * noise_.normal();
    const double current = current_ + p_.current_noise * noise_.normal();
    return {now_us,
            static_cast<float>(angle_),
            static_cast<float>(measured_speed_),
            static_cast<float>(std::floor(current / p_.current_count + 0.5) * p_.current_count),
            static_cast<float>(supply),
            !broken.encoder};
  }

  double tension() const { return tension_; }                          // of the cable, N
  double length() const { return out_; }                               // paid out, without stretch, m
  double current() const { return current_; }                          // A
  double brake_force() const { return brake_force_; }                  // that the pawl holds, N
  bool pawl_down() const { return servo_ > 0.5; }

  Breakage broken;

 private:
  void move_current(const firmware::Actuators& wanted, double seconds) {
    const double back_emf = -p_.torque_constant * speed_ / p_.radius;  // reeling in is against the supply
    if (broken.motor || !wanted.driver_on) {
      current_ = 0.0;  // the bridge is open, and currents die out within a step
      return;
    }
    const double most = (broken.supply ? 5.0 : p_.supply) / 1.7320508;
    const double target = static_cast<double>(wanted.current);
    double voltage = p_.resistance * current_ + back_emf + (target - current_) * p_.inductance / p_.current_loop;
    voltage = std::fmin(std::fmax(voltage, -most), most);
    const double settled = (voltage - back_emf) / p_.resistance;
    current_ = settled + (current_ - settled) * std::exp(-seconds * p_.resistance / p_.inductance);
  }

  // The servo moves between the two pulses at its own pace.
  void move_servo(const firmware::Actuators& wanted, const firmware::Parameters& settings, double seconds) {
    if (broken.brake) return;
    const double open = static_cast<double>(settings[firmware::Parameter::brake_open_pulse]);
    const double closed = static_cast<double>(settings[firmware::Parameter::brake_closed_pulse]);
    const double target = closed == open ? 0.0 : (static_cast<double>(wanted.brake_pulse_us) - open) / (closed - open);
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
    if (!broken.runaway && stretch > 0.0) {
      tension_ = std::fmax(p_.stiffness * stretch + p_.damping * (end_speed_ - speed_), 0.0);
    }
    const double cogging = p_.cogging * std::sin(p_.cogging_periods * (out_ - zero_) / p_.radius);
    const double pull = p_.torque_constant / p_.radius * current_ + cogging;
    const double push = tension_ - pull - p_.viscous_friction * speed_;  // of paying out
    brake_force_ = 0.0;
    // Dry friction takes away at most what would stop the spool within the step.
    double speed = speed_ + push / mass * seconds;
    const double grip = p_.dry_friction / mass * seconds;
    speed = speed > grip ? speed - grip : (speed < -grip ? speed + grip : 0.0);
    if (pawl_down()) {
      pawl_ = std::fmin(pawl_, next_tooth());
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
    const double counts = (out_ - zero_) / p_.radius / turn * p_.encoder_counts + p_.encoder_noise * noise_.normal();
    return std::floor(counts) * turn / p_.encoder_counts;
  }

  PlantParameters p_;
  Noise noise_;
  double out_, pawl_, distance_, zero_;
  double speed_ = 0.0, end_speed_ = 0.0, tension_ = 0.0, current_ = 0.0, brake_force_ = 0.0;
  double servo_ = 0.0;  // 0 open, 1 closed
  double angle_ = 0.0, measured_speed_ = 0.0;
};

}  // namespace plant
}  // namespace tensionlab
