// One module: bytes and sensors in; motor current, brake and bytes out. It reads no clock and touches no pin.
//
// The front end (an ESP32, or the simulation) calls receive() with what came over the link, step() some thousand
// times a second, and transmit() for what is to be sent.
#pragma once

#include "brake.hpp"
#include "drive.hpp"
#include "limiter.hpp"
#include "monitor.hpp"
#include "outbox.hpp"
#include "parser.hpp"
#include "set_point.hpp"
#include "supervisor.hpp"
#include "thermal.hpp"
#include "thermistor.hpp"

namespace tensionlab {
namespace firmware {

// What the front end is to do after each step.
struct Actuators {
  bool driver_on;
  float current;         // that makes torque, A; pulls when positive
  float brake_pulse_us;  // for the servo
};

enum class ResetReason : uint8_t { power = 0, software = 1, watchdog = 2, brownout = 3, other = 4 };

// Work that takes longer than a step, for the front end to do while the module is idle.
enum class Chore : uint8_t { none, store_parameters, align_encoder };

class Module {
 public:
  Module(uint32_t serial_number, ResetReason reason, const DriverHeat& driver = DriverHeat{})
      : serial_number_(serial_number), reset_reason_(reason), heat_(driver) {
    if (reset_reason_ != ResetReason::power) assume_hot();
  }

  // From the link, and at its end.
  void receive(const uint8_t* bytes, size_t size, uint32_t now_us);
  void link_closed(uint32_t now_us);
  // From a link that is not in use: obeys STOP and ESTOP, ignores everything else.
  void overhear(const uint8_t* bytes, size_t size, uint32_t now_us);

  // For the link: at most `room` bytes. Returns how many.
  size_t transmit(uint8_t* bytes, size_t room) { return outbox_.take(bytes, room); }

  Actuators step(const Sensors& sensors);

  // The chore that waits to be done, and how it went; `zero` is the motor's electrical zero, in rad, if asked for.
  // An alignment is to be given up as soon as it is no longer waited for.
  Chore chore() const { return chore_; }
  void chore_done(bool success, float zero);

  // A line of text for whoever listens.
  void log(const char* text);

  const Parameters& parameters() const { return parameters_; }
  // Nobody knows how warm motor and driver are; or it was kept over a reset.
  void assume_hot() { heat_.assume_hot(parameters_); }
  ThermalModel& heat() { return heat_; }
  const ThermalModel& heat() const { return heat_; }
  // At start: takes over a stored image if it is whole. A brake for loads then holds what may hang on the cable.
  bool load(const uint8_t* image, size_t size) {
    if (!parameters_.read_image(image, size)) return false;
    if (reset_reason_ != ResetReason::power) {
      assume_hot();
    } else {
      heat_.assume_cold(parameters_);
    }
    brake_ = Brake(parameters_[Parameter::brake_on_fault] == 1.0f);
    return true;
  }

  State state() const { return state_; }
  // What ARM is to quote: INFO has it.
  uint8_t stops() const { return stops_; }
  // What is wrong now, and what was and nobody cleared.
  uint16_t faults() const { return static_cast<uint16_t>(faults_ | monitor_.faults()); }
  float tension() const { return limiter_.tension(); }
  Limit limit() const { return limiter_.limit(); }

 private:
  // Commands (commands.cpp): each returns what is to be acknowledged.
  void handle(const Frame& frame, uint32_t now_us);
  Code arm(const Frame& frame, uint32_t now_us);
  template <class Command>
  Code take_set_point(const Frame& frame, uint32_t now_us);
  Code change_state(const Frame& frame, Event event, uint32_t now_us);
  Code get_parameter(const Frame& frame);
  Code set_parameter(const Frame& frame);
  Code calibrate(const Frame& frame);
  Code start(Chore chore, const Frame& frame);
  Code configure_telemetry(const Frame& frame, uint32_t now_us);

  // Answers (answers.cpp).
  void send(Type type, uint8_t sequence, const Writer& writer, const uint8_t* payload);
  void acknowledge(uint8_t type, uint8_t sequence, Code code);
  void send_info(uint8_t sequence);
  void send_pong(const Frame& frame, uint32_t now_us);
  void send_parameter(uint8_t sequence, uint8_t index);
  void send_event();
  void send_telemetry(const Sensors& sensors);

  // Idle, nothing pulls any more, and no chore waits: what the module is made of may be changed.
  bool is_resting() const { return state_ == State::idle && limiter_.tension() == 0.0f && chore_ == Chore::none; }

  bool apply(Event event, uint32_t now_us);
  void supervise(const Sensors& sensors);
  bool pull(float seconds, uint32_t now_us);
  void warm(const Sensors& sensors, bool on, float seconds);
  bool holds_load(bool active) const;

  uint32_t serial_number_;
  ResetReason reset_reason_;
  Parameters parameters_;
  FrameParser parser_, overheard_;
  Outbox outbox_;

  State state_ = State::idle;
  uint16_t faults_ = 0;      // latched until cleared
  uint32_t entered_us_ = 0;  // when the state began
  bool relaxed_ = false;     // second stage of the timeout: let go for good
  uint16_t session_ = 0;
  uint8_t stops_ = 0;         // how many STOP, ESTOP, CLEAR and ends of the link there were
  uint16_t last_number_ = 0;  // of the set-points
  uint32_t renewed_us_ = 0;   // when the last set-point came
  int32_t ttl_us_ = 0;

  SetPoint set_point_;
  TensionLimiter limiter_;
  ThermalModel heat_;
  Thermistor thermistor_;
  Brake brake_;
  bool slipped_ = false;  // in the last step
  Monitor monitor_;
  float length_offset_ = 0.0f;  // of the cable, where the encoder reads nought, m
  bool length_known_ = false;
  float current_ = 0.0f;  // asked of the motor, A
  bool driven_ = false;   // whether the driver was on in the last step

  Chore chore_ = Chore::none;
  uint8_t chore_type_ = 0, chore_sequence_ = 0;  // of the command that asked for it

  uint16_t telemetry_period_ms_ = 0;
  uint8_t sent_ = 0;  // sequence number of what nobody asked for
  uint32_t telemetry_us_ = 0;
};

}  // namespace firmware
}  // namespace tensionlab
