// A host at one end of a link: says commands, and notes what the module answers.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>

#include "core/parser.hpp"
#include "core/supervisor.hpp"
#include "fakes/board.hpp"

namespace tensionlab {
namespace dangers {

class Host {
 public:
  Host(fakes::Port& port, std::uint16_t session) : port_(&port), session_(session) {}

  void hello() { say(firmware::Type::hello, firmware::Writer(payload_)); }

  void set_parameter(firmware::Parameter index, double value) {
    firmware::Writer writer(payload_);
    writer.u8(static_cast<std::uint8_t>(index));
    writer.f32(static_cast<float>(value));
    say(firmware::Type::set_parameter, writer);
  }

  void calibrate(firmware::Calibration what, double value) {
    firmware::Writer writer(payload_);
    writer.u8(static_cast<std::uint8_t>(what));
    writer.f32(static_cast<float>(value));
    say(firmware::Type::calibrate, writer);
  }

  void estop() { say(firmware::Type::estop, firmware::Writer(payload_)); }

  void arm() {
    firmware::Writer writer(payload_);
    writer.u16(session_);
    writer.u8(stops_);
    say(firmware::Type::arm, writer);
    rounds_ = 0;
  }

  void pull(double tension, bool brake) {
    firmware::Writer writer(payload_);
    if (sequence_ == 255) ++rounds_;
    writer.u16(session_);
    writer.f32(static_cast<float>(tension));
    writer.u8(brake ? 1 : 0);
    writer.u16(0);
    writer.u8(rounds_);
    say(firmware::Type::set_tension, writer);
  }

  // Reads what has come since.
  void listen() {
    for (const std::uint8_t byte : port_->sent) {
      firmware::Frame frame;
      if (parser_.take(byte, frame)) note(frame);
    }
    port_->sent.clear();
  }

  bool refused = false;                           // a command, by its acknowledgement
  int acknowledged = 0;                           // commands
  firmware::State state = firmware::State::idle;  // as it said last
  std::uint16_t faults = 0;                       // of all its events
  std::string log;                                // its last line

 private:
  void say(firmware::Type type, const firmware::Writer& writer) {
    firmware::Frame frame;
    frame.type = static_cast<std::uint8_t>(type);
    frame.sequence = ++sequence_;
    frame.size = static_cast<std::uint8_t>(writer.size());
    std::copy_n(payload_, writer.size(), frame.payload);
    std::uint8_t bytes[firmware::kMaxFrame];
    const std::size_t size = firmware::write_frame(frame, bytes);
    port_->arriving.insert(port_->arriving.end(), bytes, bytes + size);
  }

  void note(const firmware::Frame& frame) {
    firmware::Reader reader(frame.payload, frame.size);
    if (frame.type == static_cast<std::uint8_t>(firmware::Type::acknowledge)) {
      reader.u8();
      refused = refused || reader.u8() != static_cast<std::uint8_t>(firmware::Code::ok);
      state = static_cast<firmware::State>(reader.u8());
      ++acknowledged;
    } else if (frame.type == static_cast<std::uint8_t>(firmware::Type::info)) {
      // After the protocol, the firmware, the serial number, the reason of the start, and the state.
      for (int before = 0; before < 9; ++before) reader.u8();
      stops_ = reader.u8();
    } else if (frame.type == static_cast<std::uint8_t>(firmware::Type::event)) {
      state = static_cast<firmware::State>(reader.u8());
      faults = static_cast<std::uint16_t>(faults | reader.u16());
    } else if (frame.type == static_cast<std::uint8_t>(firmware::Type::log)) {
      log.assign(reinterpret_cast<const char*>(frame.payload), frame.size);
    }
  }

  fakes::Port* port_;
  firmware::FrameParser parser_;
  std::uint8_t payload_[firmware::kMaxPayload] = {};
  std::uint16_t session_;
  std::uint8_t sequence_ = 0, rounds_ = 0, stops_ = 0;
};

}  // namespace dangers
}  // namespace tensionlab
