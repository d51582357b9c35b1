// What a module does with whatever comes: a script of bytes tells what happens to it, and after each step the
// promises of firmware/README.md are checked. libFuzzer writes the scripts, or driver.cpp does.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "../core/module.hpp"

using namespace tensionlab::firmware;

// For driver.cpp, which says how much was done.
unsigned long long chunks = 0, steps = 0, driven = 0;

namespace {

void require(bool holds, const char* promise) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", promise);
  std::abort();
}

// Reads a script from front to back; past its end there are zeros.
class Script {
 public:
  Script(const uint8_t* bytes, size_t size) : bytes_(bytes), left_(size) {}

  bool ended() const { return left_ == 0; }
  uint8_t byte() {
    if (left_ == 0) return 0;
    --left_;
    return *bytes_++;
  }
  uint8_t below(uint8_t count) { return static_cast<uint8_t>(byte() % count); }
  float between(float lower, float upper) {  // a little beyond both ends, too
    return lower + (upper - lower) * (static_cast<float>(byte()) - 8.0f) / 240.0f;
  }
  float any_float() {
    uint8_t bytes[4];
    for (uint8_t& each : bytes) each = byte();
    return Reader(bytes, 4).f32();
  }

 private:
  const uint8_t* bytes_;
  size_t left_;
};

class Bench {
 public:
  explicit Bench(Script& script) : script_(script), module_(7, static_cast<ResetReason>(script.below(5))) {
    now_ = script_.byte() < 128 ? 0 : 0xFFFFFFFFu - 100000u * script_.byte();
    for (int i = 0; i < 40; ++i) step(250);
    recover();
  }

  void happen() {
    const uint8_t what = script_.below(24);
    if (what == 0) return raw();
    if (what == 1) return any_frame();
    if (what == 2) return damaged();
    if (what == 3) return store();
    if (what == 4) return close();
    if (what == 5) return fetch(script_.byte());
    if (what == 6) return module_.chore_done(script_.below(2) == 1, script_.between(0.0f, 6.0f));
    if (what == 7) return recover();
    if (what <= 15) return steps_in_a_row();
    command();
  }

  void finish() {
    last_life_ = now_;
    for (int i = 0; i < 1000; ++i) step(4900);
    require(!on_, "a module that hears nothing lets go");
  }

 private:
  void feed(const uint8_t* bytes, size_t size) {
    ++chunks;
    const State before = module_.state();
    module_.receive(bytes, size, now_ + script_.byte());
    follow(before);
  }

  void send(Type type, uint8_t sequence, const Writer& writer, const uint8_t* payload) {
    Frame frame;
    frame.type = static_cast<uint8_t>(type);
    frame.sequence = sequence;
    frame.size = static_cast<uint8_t>(writer.size());
    memcpy(frame.payload, payload, writer.size());
    uint8_t wire[kMaxFrame];
    feed(wire, write_frame(frame, wire));
  }

  void raw() {
    uint8_t bytes[255];
    const size_t size = script_.byte();
    for (size_t i = 0; i < size; ++i) bytes[i] = script_.byte();
    feed(bytes, size);
  }

  void any_frame() {
    uint8_t payload[kMaxPayload];
    Writer writer(payload);
    const Type type = static_cast<Type>(script_.byte());
    const size_t size = script_.below(kMaxPayload + 1);
    for (size_t i = 0; i < size; ++i) writer.u8(script_.byte());
    send(type, script_.byte(), writer, payload);
  }

  // The next sequence number; where they begin again, it is another round.
  uint8_t next() {
    if (++sequence_ == 0) ++rounds_;
    return sequence_;
  }

  // With a new session. An armed module counts the rounds from its ARM on.
  void arm(uint8_t sequence) {
    uint8_t payload[3];
    Writer writer(payload);
    writer.u16(++session_);
    writer.u8(module_.stops());
    rounds_ = 0;
    send(Type::arm, sequence, writer, payload);
  }

  // A host's way back to work, if nothing is wrong.
  void recover() {
    uint8_t payload[5] = {};
    Writer nothing(payload);
    send(Type::clear, next(), nothing, payload);
    send(Type::stop, next(), nothing, payload);
    sensors_.speed = 0.0f;
    for (int i = 0; i < 100; ++i) step(1000);
    Writer ratio(payload);
    ratio.u8(static_cast<uint8_t>(Calibration::newton_per_ampere));
    ratio.f32(3.0f);
    send(Type::calibrate, next(), ratio, payload);
    arm(next());
  }

  // Mostly what a host would say; its numbers are somewhat beyond what is allowed, now and then.
  void command() {
    uint8_t payload[kMaxPayload];
    Writer writer(payload);
    const uint8_t sequence = next();
    switch (script_.below(14)) {
      case 0:
        return arm(sequence);
      case 1:
      case 2:
      case 3:
      case 4:
        writer.u16(session_);
        writer.f32(script_.byte() == 0 ? script_.any_float() : script_.between(0.0f, 6.0f));
        writer.u8(script_.below(2));
        writer.u16(static_cast<uint16_t>(8 * script_.byte()));
        writer.u8(rounds_);
        return send(Type::set_tension, sequence, writer, payload);
      case 5:
      case 6:
        writer.u16(session_);
        writer.f32(script_.between(0.0f, 5.0f));
        writer.f32(script_.between(0.0f, 500.0f));
        writer.f32(script_.between(0.0f, 10.0f));
        writer.f32(script_.between(-6.0f, 6.0f));
        writer.f32(script_.between(0.0f, 6.0f));
        writer.f32(script_.between(0.0f, 500.0f));
        writer.f32(script_.between(0.0f, 1.0f));
        writer.u8(script_.below(2));
        writer.u16(0);
        writer.u8(rounds_);
        return send(Type::set_impedance, sequence, writer, payload);
      case 7:
        return send(Type::stop, sequence, writer, payload);
      case 8:
        return send(script_.below(4) == 0 ? Type::estop : Type::clear, sequence, writer, payload);
      case 9: {
        const uint8_t index = script_.below(kParameterCount);
        writer.u8(index);
        writer.f32(script_.between(kParameters[index].lower, kParameters[index].upper));
        return send(Type::set_parameter, sequence, writer, payload);
      }
      case 10:
      case 11:
        writer.u8(script_.below(3));
        writer.f32(script_.between(1.0f, 4.0f));
        return send(Type::calibrate, sequence, writer, payload);
      case 12:
        writer.u16(script_.byte());
        return send(Type::configure_telemetry, sequence, writer, payload);
      default:
        return send(script_.below(2) == 0 ? Type::save : Type::hello, sequence, writer, payload);
    }
  }

  // A set-point with one byte changed, lost or sent twice.
  void damaged() {
    Frame frame;
    frame.type = static_cast<uint8_t>(Type::set_tension);
    frame.sequence = next();
    Writer writer(frame.payload);
    writer.u16(session_);
    writer.f32(script_.between(0.0f, 6.0f));
    writer.u8(0);
    writer.u16(0);
    writer.u8(rounds_);
    frame.size = static_cast<uint8_t>(writer.size());
    uint8_t wire[kMaxFrame + 1];
    size_t size = write_frame(frame, wire);
    const size_t at = script_.below(static_cast<uint8_t>(size));
    const uint8_t how = script_.below(3);
    if (how == 0) wire[at] = static_cast<uint8_t>(wire[at] ^ (1u << script_.below(8)));
    if (how == 1) memmove(wire + at, wire + at + 1, --size - at);
    if (how == 2) memmove(wire + at + 1, wire + at, size++ - at);
    feed(wire, size);
  }

  // What is stored is found again, unless it was damaged.
  void store() {
    uint8_t image[Parameters::kImageSize];
    module_.parameters().write_image(image);
    Parameters found;
    require(found.read_image(image, sizeof image), "what was stored can be loaded");
    image[script_.byte() % sizeof image] ^= static_cast<uint8_t>(1u << script_.below(8));
    require(!found.read_image(image, sizeof image), "damaged settings are refused");
    uint8_t heat[ThermalModel::kImageSize];
    module_.heat().write_image(heat);
    ThermalModel kept{DriverHeat{}};
    require(kept.read_image(heat), "kept temperatures come back");
    heat[script_.byte() % sizeof heat] ^= static_cast<uint8_t>(1u << script_.below(8));
    require(!kept.read_image(heat), "damaged temperatures are refused");
  }

  void close() {
    const State before = module_.state();
    module_.link_closed(now_);
    follow(before);
    require(module_.state() != State::running && module_.state() != State::armed, "a closed link is a timeout");
    answers_ = FrameParser();
  }

  void fetch(size_t room) {
    uint8_t bytes[255];
    Frame frame;
    const size_t size = module_.transmit(bytes, room);
    require(size <= room, "no more is fetched than there is room for");
    for (size_t i = 0; i < size; ++i) {
      if (!answers_.take(bytes[i], frame)) continue;
      require((frame.type & 0x80) != 0, "what a module says has bit 7");
    }
    require(answers_.bad_frames() == 0, "what a module says is whole");
  }

  void steps_in_a_row() {
    static const uint32_t kTimes[] = {250, 100, 1000, 2500, 4999, 5000};
    const uint32_t time = script_.byte() < 4 ? 5001 + 400 * script_.byte() : kTimes[script_.below(6)];
    const uint8_t count = static_cast<uint8_t>(1 + script_.below(40));
    const uint8_t trouble = script_.byte();  // mostly none
    const float none = std::numeric_limits<float>::quiet_NaN();
    sensors_.speed = script_.between(-20.0f, 20.0f);
    current_error_ = script_.between(-0.05f, 0.05f);
    sensors_.supply = trouble == 1 ? none : (trouble == 2 ? script_.between(0.0f, 30.0f) : 12.0f);
    sensors_.encoder_ok = trouble != 3;
    if (trouble == 4) sensors_.speed = script_.any_float();
    if (trouble == 5) current_error_ = script_.any_float();
    for (uint8_t i = 0; i < count; ++i) step(time);
  }

  void step(uint32_t time) {
    ++steps;
    now_ += time;
    sensors_.now_us = now_;
    sensors_.angle += 1e-6f * static_cast<float>(time) * (sensors_.encoder_ok ? sensors_.speed : 0.0f);
    sensors_.current = current_ + current_error_;
    const Parameters& now = module_.parameters();
    const float reeled_in = -sensors_.speed * now[Parameter::spool_radius] * now[Parameter::motor_direction];
    sensors_.induced = on_ ? reeled_in * now[Parameter::newton_per_ampere] * (2.0f / 3.0f) : 0.0f;
    const float before = module_.tension();
    const State state_before = module_.state();
    const Actuators actuators = module_.step(sensors_);
    on_ = actuators.driver_on;
    current_ = actuators.current;
    if (on_) ++driven;
    follow(state_before);

    const Parameters& p = module_.parameters();
    const float tension = module_.tension(), tiny = 1e-5f;
    const float change = p[Parameter::slew] * 1e-6f * static_cast<float>(time < 5000 ? time : 5000) + tiny;
    const State state = module_.state();
    const bool off = state == State::fault || state == State::estop;
    require(tension >= 0.0f && tension <= p[Parameter::tension_upper], "tension stays inside its limits");
    require(tension - before <= change, "tension rises no faster than the slew");
    require(before - tension <= change || (tension == 0.0f && !on_), "tension falls no faster than the slew");
    require(actuators.current >= 0.0f && actuators.current <= p[Parameter::current_peak], "current is limited");
    require(on_ || actuators.current == 0.0f, "no current without a driver");
    require(!off || (!on_ && tension == 0.0f), "fault and estop let go");
    require(state != State::idle || !on_ || tension > 0.0f, "an idle module only lets go");
    require(actuators.brake_pulse_us == p[Parameter::brake_open_pulse] ||
                actuators.brake_pulse_us == p[Parameter::brake_closed_pulse],
            "the brake is on or off");
    // 2 s is the longest life of a set-point, and 2 s the second stage; then the rest fades.
    if (since(now_, last_life_) > 4700000) require(!on_, "nothing pulls for ever");
  }

  // Every change of state is one that the table knows, and running comes only after arming.
  void follow(State before) {
    const State after = module_.state();
    if (after == State::armed || after == State::running) last_life_ = now_;
    if (after == before) return;
    require(after != State::running || before == State::armed || before == State::idle, "no way around arming");
    const bool rest = before == State::timeout || before == State::fault || before == State::estop;
    require(!rest || after != State::running, "from rest nothing leads to running at once");
    require(before != State::estop || after == State::idle || after == State::armed, "estop latches");
  }

  Script& script_;
  Module module_;
  Sensors sensors_ = {0, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 12.0f, 10000.0f, true};
  FrameParser answers_;
  uint32_t now_ = 0, last_life_ = 0;
  uint16_t session_ = 0;
  uint8_t sequence_ = 0, rounds_ = 0;
  bool on_ = false;
  float current_ = 0.0f, current_error_ = 0.0f;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  Script script(bytes, size);
  Bench bench(script);
  while (!script.ended()) bench.happen();
  bench.finish();
  return 0;
}
