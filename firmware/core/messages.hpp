// What can be said over the link, and how it lies in a payload. PROTOCOL.md has the same as tables.
//
// Every message has one length; one of another length, or with a number that is not finite, is refused whole.
#pragma once

#include "frame.hpp"
#include "numbers.hpp"

namespace tensionlab {
namespace firmware {

constexpr uint8_t kProtocol = 6;
constexpr uint16_t kFirmware = 0x0005;  // major, minor: 0.5

enum class Type : uint8_t {
  hello = 0x01,
  arm = 0x02,
  set_tension = 0x03,
  set_impedance = 0x04,
  stop = 0x05,
  estop = 0x06,
  clear = 0x07,
  get_parameter = 0x08,
  set_parameter = 0x09,
  save = 0x0A,
  calibrate = 0x0B,
  ping = 0x0C,
  configure_telemetry = 0x0D,
  // From the module: bit 7 is set.
  info = 0x81,
  parameter = 0x88,
  pong = 0x8C,
  telemetry = 0x8D,
  acknowledge = 0x90,
  event = 0x91,
  log = 0x92,
};

// Why a command was refused or came to nothing; ok if it was not.
enum class Code : uint8_t {
  ok = 0,
  unknown_type = 1,
  bad_length = 2,
  bad_value = 3,
  bad_state = 4,
  bad_session = 5,
  stale = 6,
  not_calibrated = 7,
  fault_present = 8,
  unknown_parameter = 9,
  failed = 10,
  stopped = 11,
};

struct Arm {
  uint16_t session;
  uint8_t stops;  // of INFO
};

struct SetTension {
  uint16_t session;
  float tension;  // N
  bool brake;
  uint16_t ttl_ms;  // 0: the module's own
  uint8_t rounds;   // how often the sequence numbers have begun again since ARM
};

struct SetImpedance {
  uint16_t session;
  float rest;          // cable length without tension, m
  float stiffness;     // N/m
  float damping;       // N s/m, against paying out
  float feed_forward;  // N
  float amplitude;     // of the vibration, N
  float frequency;     // of the vibration, Hz
  float phase;         // of the vibration at 0 of the module's clock, in turns
  bool brake;
  uint16_t ttl_ms;
  uint8_t rounds;
};

// What to calibrate, and the number that it needs.
enum class Calibration : uint8_t {
  length = 0,             // the cable is `value` m long now
  newton_per_ampere = 1,  // measured; the module counts as calibrated
  encoder = 2,            // find the motor's electrical zero; `value` is ignored
};

struct Calibrate {
  Calibration what;
  float value;
};

struct SetParameter {
  uint8_t index;
  float value;
};

struct GetParameter {
  uint8_t index;
};

struct ConfigureTelemetry {
  uint16_t period_ms;  // 0: none
};

constexpr uint16_t kShortestPeriod = 5;  // ms

inline bool read_flag(Reader& reader, bool& flag) {
  const uint8_t byte = reader.u8();
  flag = byte == 1;
  return byte < 2;
}

inline Code read(const Frame& frame, Arm& arm) {
  Reader reader(frame.payload, frame.size);
  arm.session = reader.u16();
  arm.stops = reader.u8();
  if (!reader.exhausted()) return Code::bad_length;
  return arm.session == 0 ? Code::bad_value : Code::ok;
}

inline Code read(const Frame& frame, SetTension& command) {
  Reader reader(frame.payload, frame.size);
  command.session = reader.u16();
  command.tension = reader.f32();
  const bool flag = read_flag(reader, command.brake);
  command.ttl_ms = reader.u16();
  command.rounds = reader.u8();
  if (!reader.exhausted()) return Code::bad_length;
  return flag && is_finite(command.tension) ? Code::ok : Code::bad_value;
}

inline Code read(const Frame& frame, SetImpedance& command) {
  Reader reader(frame.payload, frame.size);
  command.session = reader.u16();
  float* const numbers[] = {&command.rest,      &command.stiffness, &command.damping, &command.feed_forward,
                            &command.amplitude, &command.frequency, &command.phase};
  bool finite = true;
  for (float* number : numbers) {
    *number = reader.f32();
    finite = finite && is_finite(*number);
  }
  const bool flag = read_flag(reader, command.brake);
  command.ttl_ms = reader.u16();
  command.rounds = reader.u8();
  if (!reader.exhausted()) return Code::bad_length;
  return flag && finite ? Code::ok : Code::bad_value;
}

inline Code read(const Frame& frame, SetParameter& command) {
  Reader reader(frame.payload, frame.size);
  command.index = reader.u8();
  command.value = reader.f32();
  if (!reader.exhausted()) return Code::bad_length;
  return is_finite(command.value) ? Code::ok : Code::bad_value;
}

inline Code read(const Frame& frame, Calibrate& command) {
  Reader reader(frame.payload, frame.size);
  const uint8_t what = reader.u8();
  command.value = reader.f32();
  if (!reader.exhausted()) return Code::bad_length;
  command.what = static_cast<Calibration>(what);
  return what <= 2 && is_finite(command.value) ? Code::ok : Code::bad_value;
}

inline Code read(const Frame& frame, GetParameter& command) {
  Reader reader(frame.payload, frame.size);
  command.index = reader.u8();
  return reader.exhausted() ? Code::ok : Code::bad_length;
}

inline Code read(const Frame& frame, ConfigureTelemetry& command) {
  Reader reader(frame.payload, frame.size);
  command.period_ms = reader.u16();
  if (!reader.exhausted()) return Code::bad_length;
  return command.period_ms == 0 || command.period_ms >= kShortestPeriod ? Code::ok : Code::bad_value;
}

}  // namespace firmware
}  // namespace tensionlab
