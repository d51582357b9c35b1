// Commands as a host sends them: all types, mostly right, with numbers, sessions, lengths and bits that are wrong
// now and then.
#pragma once

#include <limits>

#include "../core/messages.hpp"
#include "../core/parameters.hpp"
#include "bench.hpp"

namespace tensionlab {
namespace emulation {

using firmware::Frame;
using firmware::Type;
using firmware::Writer;

constexpr int kCommandTypes = 14;  // 1 to 13, and all that do not exist

class Commands {
 public:
  explicit Commands(Random& random) : random_(random) {}

  // Writes the frame of a command of this type; returns its size on the wire. ARM quotes the module's count of
  // stops.
  size_t write(Type type, uint8_t stops, uint8_t* wire) {
    Frame frame;
    const bool again = random_.once_in(40);
    frame.type = static_cast<uint8_t>(type);
    frame.sequence = again ? sequence_ : ++sequence_;
    if (frame.sequence == 0 && !again) ++rounds_;  // a set-point tells the round; ARM begins the first
    Writer writer(frame.payload);
    fill(type, stops, writer);
    frame.size = static_cast<uint8_t>(writer.size());
    if (random_.once_in(50)) frame.size = static_cast<uint8_t>(random_.below(frame.size + 1));
    const size_t size = firmware::write_frame(frame, wire);
    if (random_.once_in(50)) {
      uint8_t& byte = wire[random_.below(static_cast<int>(size))];
      byte = static_cast<uint8_t>(byte ^ 1U << random_.below(8));
    }
    return size;
  }

 private:
  void fill(Type type, uint8_t stops, Writer& writer) {
    switch (type) {
      case Type::arm:
        if (!random_.once_in(6)) ++session_;
        rounds_ = 0;
        writer.u16(random_.once_in(20) ? uint16_t{0} : session_);
        writer.u8(random_.once_in(20) ? static_cast<uint8_t>(stops - 1) : stops);
        return;
      case Type::set_tension:
        writer.u16(session());
        writer.f32(number(0.0F, 6.0F));
        return end_set_point(writer);
      case Type::set_impedance:
        return fill_impedance(writer);
      case Type::get_parameter:
        writer.u8(static_cast<uint8_t>(random_.below(firmware::kParameterCount + 1)));
        return;
      case Type::set_parameter:
        return fill_parameter(writer);
      case Type::calibrate:
        return fill_calibration(writer);
      case Type::ping:
        writer.u32(random_.bits());
        writer.u32(random_.bits());
        return;
      case Type::configure_telemetry:
        writer.u16(static_cast<uint16_t>(random_.once_in(8) ? random_.below(5) : 5 + random_.below(20)));
        return;
      default:  // the others are empty, and so may be those that do not exist
        return;
    }
  }

  void fill_impedance(Writer& writer) {
    writer.u16(session());
    writer.f32(number(0.0F, 3.0F));                                // rest
    writer.f32(random_.once_in(3) ? 0.0F : number(0.0F, 500.0F));  // stiffness
    writer.f32(number(0.0F, 10.0F));                               // damping
    writer.f32(number(-1.0F, 4.0F));                               // feed-forward
    writer.f32(random_.once_in(3) ? 0.0F : number(0.0F, 3.0F));    // amplitude
    writer.f32(number(0.0F, 500.0F));                              // frequency
    writer.f32(number(0.0F, 1.0F));                                // phase
    end_set_point(writer);
  }

  void end_set_point(Writer& writer) {
    if (random_.once_in(20)) brake_ = !brake_;
    writer.u8(random_.once_in(50) ? uint8_t{2} : static_cast<uint8_t>(brake_));
    writer.u16(static_cast<uint16_t>(random_.once_in(2) ? 0 : 40 + random_.below(300)));
    writer.u8(rounds_);
  }

  // Near the default: so that a module with other parameters still works.
  void fill_parameter(Writer& writer) {
    const int index = random_.below(firmware::kParameterCount + 1);
    writer.u8(static_cast<uint8_t>(index));
    if (index == firmware::kParameterCount) return writer.f32(1.0F);
    const firmware::ParameterInfo& info = firmware::kParameters[index];
    if (firmware::is_choice(static_cast<firmware::Parameter>(index))) {
      return writer.f32(random_.once_in(2) ? info.lower : info.upper);
    }
    writer.f32(number(0.8F * info.standard, 1.2F * info.standard));
  }

  void fill_calibration(Writer& writer) {
    const int what = random_.below(4) % 3;  // a length twice as often
    writer.u8(static_cast<uint8_t>(random_.once_in(20) ? 3 : what));
    writer.f32(what == 0 ? number(0.0F, 5.0F) : number(2.5F, 3.5F));
  }

  uint16_t session() { return static_cast<uint16_t>(random_.once_in(40) ? session_ - 1 : session_); }

  float number(float least, float most) {
    constexpr float kNumber = std::numeric_limits<float>::quiet_NaN();
    const float odd[] = {kNumber,    std::numeric_limits<float>::infinity(), -1.0F, -0.0F, 1e-40F, 1e30F,
                         2.0F * most};
    return random_.once_in(60) ? odd[random_.below(7)] : random_.uniform(least, most);
  }

  Random& random_;
  uint16_t session_ = 0;
  uint8_t sequence_ = 0, rounds_ = 0;
  bool brake_ = false;
};

}  // namespace emulation
}  // namespace tensionlab
