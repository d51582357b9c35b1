// What a module says: acknowledgements, answers, events and telemetry.
#include "module.hpp"

namespace tensionlab {
namespace firmware {

namespace {

Frame frame_of(Type type, uint8_t sequence, const Writer& writer, const uint8_t* payload) {
  Frame frame;
  frame.type = static_cast<uint8_t>(type);
  frame.sequence = sequence;
  frame.size = static_cast<uint8_t>(writer.size());
  memcpy(frame.payload, payload, writer.size());
  return frame;
}

}  // namespace

void Module::send(Type type, uint8_t sequence, const Writer& writer, const uint8_t* payload) {
  uint8_t bytes[kMaxFrame];
  const size_t size = write_frame(frame_of(type, sequence, writer, payload), bytes);
  // Telemetry that nobody fetches leaves room for the answers to commands.
  const bool answer = type != Type::telemetry && type != Type::log;
  outbox_.put(bytes, size, answer ? 0 : 256);
}

void Module::acknowledge(uint8_t type, uint8_t sequence, Code code) {
  uint8_t payload[5];
  Writer writer(payload);
  writer.u8(type);
  writer.u8(static_cast<uint8_t>(code));
  writer.u8(static_cast<uint8_t>(state_));
  writer.u16(session_);
  send(Type::acknowledge, sequence, writer, payload);
}

void Module::send_info(uint8_t sequence) {
  const Parameters& p = parameters_;
  uint8_t payload[kMaxPayload];
  Writer writer(payload);
  writer.u8(kProtocol);
  writer.u16(kFirmware);
  writer.u32(serial_number_);
  writer.u8(static_cast<uint8_t>(reset_reason_));
  writer.u8(static_cast<uint8_t>(state_));
  writer.u8(stops_);
  writer.u16(session_);
  writer.u8(p[Parameter::calibrated] == 1.0f ? 1 : 0);
  writer.u8(length_known_ ? 1 : 0);
  writer.u8(static_cast<uint8_t>(kParameterCount));
  writer.u16(static_cast<uint16_t>(p[Parameter::ttl]));
  writer.f32(p[Parameter::tension_lower]);
  writer.f32(p[Parameter::tension_upper]);
  writer.f32(p[Parameter::newton_per_ampere]);
  writer.f32(p[Parameter::spool_radius]);
  writer.f32(smaller(heat_.continuous(p) * p[Parameter::newton_per_ampere], p[Parameter::tension_upper]));
  send(Type::info, sequence, writer, payload);
}

void Module::send_pong(const Frame& frame, uint32_t now_us) {
  uint8_t payload[12];
  Writer writer(payload);
  writer.raw(frame.payload, 8);
  writer.u32(now_us);
  send(Type::pong, frame.sequence, writer, payload);
}

void Module::send_parameter(uint8_t sequence, uint8_t index) {
  uint8_t payload[13];
  Writer writer(payload);
  writer.u8(index);
  writer.f32(parameters_[static_cast<Parameter>(index)]);
  writer.f32(kParameters[index].lower);
  writer.f32(kParameters[index].upper);
  send(Type::parameter, sequence, writer, payload);
}

void Module::send_event() {
  uint8_t payload[4];
  Writer writer(payload);
  writer.u8(static_cast<uint8_t>(state_));
  writer.u16(faults());
  writer.u8(static_cast<uint8_t>(limiter_.limit()));
  send(Type::event, sent_++, writer, payload);
}

void Module::send_telemetry(const Sensors& sensors) {
  uint8_t payload[kMaxPayload];
  Writer writer(payload);
  writer.u32(sensors.now_us);
  writer.u8(static_cast<uint8_t>(state_));
  writer.u16(faults());
  writer.u8(static_cast<uint8_t>(limiter_.limit()));
  writer.u8(static_cast<uint8_t>(last_number_));
  writer.f32(limiter_.tension());
  writer.f32(monitor_.current());
  writer.f32(length_offset_ + monitor_.paid_out());
  writer.f32(monitor_.speed());
  writer.f32(sensors.supply);
  // A little less than what it limits at: so the host limits first, late telemetry or not.
  writer.f32(heat_.current_limit(parameters_, 0.8f) * parameters_[Parameter::newton_per_ampere]);
  writer.u8(static_cast<uint8_t>(clamp(heat_.winding() + 0.5f, 0.0f, 255.0f)));
  writer.u8(static_cast<uint8_t>(brake_.state()));
  writer.u16(parser_.bad_frames());
  writer.u16(outbox_.lost());
  writer.u16(monitor_.take_longest_step());
  send(Type::telemetry, sent_++, writer, payload);
}

void Module::log(const char* text) {
  uint8_t payload[kMaxPayload];
  Writer writer(payload);
  while (*text != '\0' && writer.size() < kMaxPayload) writer.u8(static_cast<uint8_t>(*text++));
  send(Type::log, sent_++, writer, payload);
}

}  // namespace firmware
}  // namespace tensionlab
