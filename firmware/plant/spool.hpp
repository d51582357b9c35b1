// The spool with its cable and its one-way brake.
#pragma once

#include <cmath>

#include "parameters.hpp"

namespace tensionlab {
namespace plant {

class Spool {
 public:
  // `distance`: of the cable's far end from the module at the start, m; as much cable is paid out, and a tooth of
  // the brake is there.
  Spool(const PlantParameters& parameters, double distance)
      : p_(parameters), out_(distance), pawl_(distance), distance_(distance), zero_(distance) {}

  // The far end of the cable is `distance` m from the module, moving at `speed` m/s.
  void place_end(double distance, double speed) {
    distance_ = distance;
    end_speed_ = speed;
  }

  // The servo moves towards `target`, 0 open to 1 closed, at its own pace.
  void move_servo(double target, double seconds) {
    const double step = seconds / p_.servo_time;
    const bool down = pawl_down();
    // A loaded pawl is jammed: it can be laid on, but not lifted.
    if (target < servo_ && brake_force_ > 0.5) return;
    servo_ += std::fmin(std::fmax(target - servo_, -step), step);
    if (!down && pawl_down()) pawl_ = next_tooth();
  }

  // torque_current: A, positive where it reels in.
  void advance(double torque_current, double seconds) {
    const double mass = p_.inertia / (p_.radius * p_.radius);
    const double stretch = distance_ - out_;
    tension_ = 0.0;
    if (!cut && !snapped_ && stretch > 0.0) {
      tension_ = std::fmax(p_.stiffness * stretch + p_.damping * (end_speed_ - speed_), 0.0);
      snapped_ = tension_ > p_.cable_strength;
    }
    const double cogging = p_.cogging * std::sin(p_.cogging_periods * (out_ - zero_) / p_.radius);
    const double pull = p_.torque_constant / p_.radius * torque_current + cogging;
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

  double out() const { return out_; }                           // cable paid out, without stretch, m
  double turned() const { return (out_ - zero_) / p_.radius; }  // since the start, rad, positive while paying out
  double speed() const { return speed_; }                       // of paying out, m/s
  double tension() const { return tension_; }                   // of the cable, N
  double brake_force() const { return brake_force_; }           // that the pawl holds, N
  bool pawl_down() const { return servo_ > 0.5; }

  bool cut = false;  // nothing holds the far end

 private:
  // The first tooth at or beyond the cable that is out.
  double next_tooth() const { return std::ceil((out_ - zero_) / p_.tooth) * p_.tooth + zero_; }

  PlantParameters p_;
  bool snapped_ = false;
  double out_, pawl_, distance_, zero_;
  double speed_ = 0.0, end_speed_ = 0.0, tension_ = 0.0, brake_force_ = 0.0;
  double servo_ = 0.0;  // 0 open, 1 closed
};

}  // namespace plant
}  // namespace tensionlab
