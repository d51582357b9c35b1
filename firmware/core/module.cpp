// What a module does step by step: watch the sensors and the clock, and pull.
#include "module.hpp"

namespace tensionlab {
namespace firmware {

namespace {

// From the end of a set-point's life to the driver going off.
constexpr int32_t kRelaxTime = 2000000;  // us

}  // namespace

Actuators Module::step(const Sensors& sensors) {
  const float seconds = monitor_.take(sensors, driven_, current_, parameters_);
  supervise(sensors);
  const bool on = pull(seconds, sensors.now_us);
  driven_ = on;
  warm(sensors, on, seconds);
  if (telemetry_period_ms_ != 0 && since(sensors.now_us, telemetry_us_) >= 1000 * telemetry_period_ms_) {
    telemetry_us_ = sensors.now_us;
    send_telemetry(sensors);
  }
  return {on, current_, brake_.pulse_us(parameters_)};
}

void Module::warm(const Sensors& sensors, bool on, float seconds) {
  constexpr float kMost = 20.0f;  // A: more is no current of this motor
  const float known = smaller(magnitude(monitor_.current()), kMost);
  heat_.advance(on ? larger(known, current_) : known, seconds, parameters_);
  if (thermistor_.take(sensors.thermistor, parameters_)) {
    if (thermistor_.state() == Thermistor::State::broken) log("thermistor: broken; goes on without it");
    if (thermistor_.state() == Thermistor::State::shorted) log("thermistor: shorted; goes on without it");
  }
  if (thermistor_.state() == Thermistor::State::good) heat_.correct(thermistor_.temperature());
}

// Events that no command brings: faults, and time that is up.
void Module::supervise(const Sensors& sensors) {
  const uint16_t faults = monitor_.faults();
  if (faults != 0) {
    const State before = state_;
    apply(Event::fault, sensors.now_us);
    if (state_ == State::fault) faults_ = static_cast<uint16_t>(faults_ | faults);
    if (state_ != before) send_event();
    // Turns may have gone by uncounted.
    if ((faults & (kFaultEncoder | kFaultLoop)) != 0) length_known_ = false;
  }
  const bool waiting = state_ == State::armed || state_ == State::running;
  if (waiting && since(sensors.now_us, renewed_us_) > ttl_us_) {
    apply(Event::expire, sensors.now_us);
    send_event();
  }
  if (state_ == State::timeout && since(sensors.now_us, entered_us_) >= kRelaxTime) relaxed_ = true;
}

// Sets the current. Returns whether the driver is to be on.
bool Module::pull(float seconds, uint32_t now_us) {
  const Parameters& p = parameters_;
  const bool active = is_driven(state_) && !relaxed_;
  const bool laid = state_ == State::running && set_point_.brake();
  const CableState cable = {length_offset_ + monitor_.paid_out(), monitor_.speed(), length_known_};
  const bool slips = brake_.slips(monitor_.paid_out(), p);
  if (slips && !slipped_) log("brake: on, but the cable pays out");
  slipped_ = slips;
  brake_.advance(laid || holds_load(active), active, monitor_.paid_out(), now_us, p);

  bool on = active;
  if (active) {
    float wanted = p[Parameter::tension_lower];
    Limit reason = state_ == State::timeout ? Limit::timeout : Limit::none;
    if (state_ == State::running) {
      wanted = set_point_.tension(cable.length, cable.speed);
      set_point_.advance(seconds);
    }
    if (brake_.is_releasing() && wanted < p[Parameter::brake_release_tension]) {
      wanted = p[Parameter::brake_release_tension];
      reason = Limit::releasing;
    }
    limiter_.advance(wanted, reason, cable, heat_.current_limit(p), seconds, p);
  } else if (state_ == State::fault || state_ == State::estop || monitor_.faults() != 0) {
    limiter_.cut();
  } else {
    on = !limiter_.fade(seconds, p);
  }
  current_ = on ? current_for(limiter_.tension(), cable.speed, heat_.current_limit(p), p) : 0.0f;
  return on;
}

// Whether the brake is to hold what hangs on the cable, though no set-point says so.
bool Module::holds_load(bool active) const {
  if (state_ == State::timeout && parameters_[Parameter::timeout_brake] == 1.0f && brake_.is_closed()) return true;
  if (active || parameters_[Parameter::brake_on_fault] != 1.0f) return false;
  return state_ == State::fault || state_ == State::estop || brake_.is_closed();
}

// Returns whether the table lets the event happen; then it has.
bool Module::apply(Event event, uint32_t now_us) {
  const Transition transition = firmware::transition(state_, event);
  if (!transition.accepted) return false;
  if (transition.next != state_) {
    state_ = transition.next;
    entered_us_ = now_us;
    relaxed_ = false;
  }
  return true;
}

void Module::link_closed(uint32_t now_us) {
  ++stops_;
  telemetry_period_ms_ = 0;
  parser_.restart();
  outbox_.clear();
  apply(Event::expire, now_us);
}

}  // namespace firmware
}  // namespace tensionlab
