// What a module makes of each command.
#include "module.hpp"

namespace tensionlab {
namespace firmware {

void Module::receive(const uint8_t* bytes, size_t size, uint32_t now_us) {
  Frame frame;
  for (size_t i = 0; i < size; ++i) {
    if (parser_.take(bytes[i], frame)) handle(frame, now_us);
  }
}

void Module::overhear(const uint8_t* bytes, size_t size, uint32_t now_us) {
  Frame frame;
  for (size_t i = 0; i < size; ++i) {
    if (!overheard_.take(bytes[i], frame)) continue;
    const bool stop = frame.type == static_cast<uint8_t>(Type::stop);
    if (!stop && frame.type != static_cast<uint8_t>(Type::estop)) continue;
    if (change_state(frame, stop ? Event::stop : Event::estop, now_us) == Code::ok) send_event();
  }
}

void Module::handle(const Frame& frame, uint32_t now_us) {
  Code code = Code::unknown_type;
  switch (static_cast<Type>(frame.type)) {
    // Set-points are not acknowledged, and one that comes too late is dropped without a word.
    case Type::set_tension:
      code = take_set_point<SetTension>(frame, now_us);
      if (code != Code::ok && code != Code::stale) acknowledge(frame.type, frame.sequence, code);
      return;
    case Type::set_impedance:
      code = take_set_point<SetImpedance>(frame, now_us);
      if (code != Code::ok && code != Code::stale) acknowledge(frame.type, frame.sequence, code);
      return;
    // These are answered with what was asked for.
    case Type::hello:
      if (frame.size == 0) return send_info(frame.sequence);
      code = Code::bad_length;
      break;
    case Type::ping:
      if (frame.size == 8) return send_pong(frame, now_us);
      code = Code::bad_length;
      break;
    case Type::get_parameter:
      code = get_parameter(frame);
      if (code == Code::ok) return;
      break;
    // These when they are done.
    case Type::save:
      code = start(Chore::store_parameters, frame);
      if (code == Code::ok) return;
      break;
    case Type::calibrate:
      code = calibrate(frame);
      if (code == Code::ok && chore_ != Chore::none) return;
      break;
    case Type::arm:
      code = arm(frame, now_us);
      break;
    case Type::stop:
      code = change_state(frame, Event::stop, now_us);
      break;
    case Type::estop:
      code = change_state(frame, Event::estop, now_us);
      break;
    case Type::clear:
      code = change_state(frame, Event::clear, now_us);
      break;
    case Type::set_parameter:
      code = set_parameter(frame);
      break;
    case Type::configure_telemetry:
      code = configure_telemetry(frame, now_us);
      break;
    default:
      break;
  }
  acknowledge(frame.type, frame.sequence, code);
}

Code Module::arm(const Frame& frame, uint32_t now_us) {
  Arm command;
  const Code code = read(frame, command);
  if (code != Code::ok) return code;
  // The same command once more, because its acknowledgement was lost.
  const bool waiting = state_ == State::armed || state_ == State::running;
  if (waiting && command.session == session_) return Code::ok;
  // A stop has come since the INFO that it quotes, however late this is, and by whichever link it came.
  if (command.stops != stops_) return Code::stopped;
  // Set-points of the last session may still be on their way.
  if (command.session == session_) return Code::bad_session;
  if (!transition(state_, Event::arm).accepted || chore_ != Chore::none) return Code::bad_state;
  if (parameters_[Parameter::calibrated] == 0.0f) return Code::not_calibrated;
  if (monitor_.faults() != 0) return Code::fault_present;
  apply(Event::arm, now_us);
  session_ = command.session;
  last_number_ = frame.sequence;
  renewed_us_ = now_us;
  ttl_us_ = static_cast<int32_t>(1000.0f * parameters_[Parameter::ttl]);
  return Code::ok;
}

template <class Command>
Code Module::take_set_point(const Frame& frame, uint32_t now_us) {
  Command command;
  const Code code = read(frame, command);
  if (code != Code::ok) return code;
  if (!transition(state_, Event::set_point).accepted) return Code::bad_state;
  if (command.session != session_) return Code::bad_session;
  const uint16_t number = static_cast<uint16_t>(command.rounds << 8 | frame.sequence);
  if (static_cast<int16_t>(number - last_number_) <= 0) return Code::stale;
  if (needs_length(command) && !length_known_) return Code::not_calibrated;
  const ParameterInfo& ttl = kParameters[static_cast<size_t>(Parameter::ttl)];
  const float wanted = command.ttl_ms == 0 ? parameters_[Parameter::ttl] : static_cast<float>(command.ttl_ms);
  if (wanted < ttl.lower || wanted > ttl.upper || !set_point_.take(command, parameters_, now_us))
    return Code::bad_value;
  apply(Event::set_point, now_us);
  last_number_ = number;
  renewed_us_ = now_us;
  ttl_us_ = static_cast<int32_t>(1000.0f * wanted);
  return Code::ok;
}

Code Module::change_state(const Frame& frame, Event event, uint32_t now_us) {
  if (frame.size != 0) return Code::bad_length;
  ++stops_;
  // A fault can't be cleared while it is there.
  if (event == Event::clear && state_ == State::fault && monitor_.faults() != 0) return Code::fault_present;
  if (!apply(event, now_us)) return Code::bad_state;
  if (event == Event::clear) faults_ = 0;
  if (event != Event::clear && chore_ == Chore::align_encoder) chore_done(false, 0.0f);
  return Code::ok;
}

Code Module::get_parameter(const Frame& frame) {
  GetParameter command;
  const Code code = read(frame, command);
  if (code != Code::ok) return code;
  if (state_ != State::idle) return Code::bad_state;
  if (command.index >= kParameterCount) return Code::unknown_parameter;
  send_parameter(frame.sequence, command.index);
  return Code::ok;
}

Code Module::set_parameter(const Frame& frame) {
  SetParameter command;
  const Code code = read(frame, command);
  if (code != Code::ok) return code;
  if (!is_resting()) return Code::bad_state;
  if (command.index >= kParameterCount) return Code::unknown_parameter;
  const Parameter index = static_cast<Parameter>(command.index);
  if (!parameters_.set(index, command.value)) return Code::bad_value;
  // The encoder's turns are now other lengths of cable.
  if (index == Parameter::spool_radius || index == Parameter::motor_direction) length_known_ = false;
  return Code::ok;
}

Code Module::calibrate(const Frame& frame) {
  Calibrate command;
  const Code code = read(frame, command);
  if (code != Code::ok) return code;
  if (command.what == Calibration::encoder) return start(Chore::align_encoder, frame);
  if (!is_resting()) return Code::bad_state;
  if (command.what == Calibration::newton_per_ampere) {
    if (!parameters_.set(Parameter::newton_per_ampere, command.value)) return Code::bad_value;
    parameters_.set(Parameter::calibrated, 1.0f);
    return Code::ok;
  }
  if ((monitor_.faults() & kFaultEncoder) != 0) return Code::fault_present;
  if (command.value < 0.0f || command.value > parameters_[Parameter::length_upper]) return Code::bad_value;
  length_offset_ = command.value - monitor_.paid_out();
  length_known_ = true;
  return Code::ok;
}

Code Module::start(Chore chore, const Frame& frame) {
  if (chore == Chore::store_parameters && frame.size != 0) return Code::bad_length;
  // The same command once more, because its acknowledgement takes long.
  if (chore_ == chore && chore_sequence_ == frame.sequence) return Code::ok;
  if (!is_resting()) return Code::bad_state;
  chore_ = chore;
  chore_type_ = frame.type;
  chore_sequence_ = frame.sequence;
  return Code::ok;
}

void Module::chore_done(bool success, float zero) {
  if (chore_ == Chore::none) return;
  if (success && chore_ == Chore::align_encoder) success = parameters_.set(Parameter::motor_zero, zero);
  chore_ = Chore::none;
  acknowledge(chore_type_, chore_sequence_, success ? Code::ok : Code::failed);
}

Code Module::configure_telemetry(const Frame& frame, uint32_t now_us) {
  ConfigureTelemetry command;
  const Code code = read(frame, command);
  if (code != Code::ok) return code;
  telemetry_period_ms_ = command.period_ms;
  telemetry_us_ = now_us;
  return Code::ok;
}

}  // namespace firmware
}  // namespace tensionlab
