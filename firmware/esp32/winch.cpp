#include "winch.hpp"

#include <math.h>

#include <initializer_list>

namespace tensionlab {
namespace firmware {

namespace {

// The sign that turns a current that pulls into one along the encoder, and back: the cable pays out along
// motor_direction, and pulling is the other way.
float pull_sign(const Parameters& parameters) { return -parameters[Parameter::motor_direction]; }

}  // namespace

bool Winch::begin() {
  encoder_.begin();
  motor_.linkSensor(&encoder_);

  driver_.voltage_power_supply = board::kNominalSupply;
  driver_.voltage_limit = board::kNominalSupply;
  driver_.pwm_frequency = board::kPwmRate;
  const bool driven = driver_.init() != 0;
  motor_.linkDriver(&driver_);
  sense_.linkDriver(&driver_);

  motor_.controller = MotionControlType::torque;
  motor_.torque_controller = TorqueControlType::foc_current;
  motor_.foc_modulation = FOCModulationType::SpaceVectorPWM;
  motor_.voltage_limit = board::kVoltageLimit;
  motor_.current_limit = board::kCurrentLimit;
  motor_.voltage_sensor_align = board::kAlignVoltage;
  for (PIDController* loop : {&motor_.PID_current_q, &motor_.PID_current_d}) {
    loop->P = board::kCurrentP;
    loop->I = board::kCurrentI;
    loop->limit = board::kVoltageLimit;
  }
  motor_.LPF_current_q.Tf = board::kCurrentFilter;
  motor_.LPF_current_d.Tf = board::kCurrentFilter;
  motor_.LPF_velocity.Tf = board::kSpeedFilter;

  // With the driver off no current flows, and the offsets of the amplifiers are found.
  sense_.skip_align = true;
  const bool sensed = sense_.init() != 0;
  sense_.gain_a *= board::kSenseSignA;
  sense_.gain_b *= board::kSenseSignB;
  motor_.linkCurrentSense(&sense_);
  _configureADCInline(nullptr, board::kSupply, board::kThermistor);

  // Both known, so that SimpleFOC moves nothing to find them; the true zero is set before each start.
  motor_.sensor_direction = Direction::CW;
  motor_.zero_electric_angle = 0.0f;
  started_ = driven && sensed && motor_.init() != 0 && motor_.initFOC() != 0;
  motor_.disable();
  return started_;
}

Sensors Winch::turn(const Parameters& parameters) {
  motor_.loopFOC();
  motor_.move(target_);
  measure_slowly();
  rested_ = on_ || held_ ? 0 : (rested_ < kRest ? rested_ + 1 : kRest);
  if (rested_ == kRest) sense_.follow_offsets();
  const float sign = pull_sign(parameters), share = supply_ / board::kNominalSupply;
  const float q = motor_.current.q, d = motor_.current.d;
  const float resistance = board::kWarmResistance + board::kBridgeResistance;
  const float reactance = board::kPhaseInductance * board::kPolePairs * motor_.shaft_velocity;
  // What resistance and inductance leave of the voltages.
  const float induced = share * motor_.voltage.q - resistance * q - reactance * d;
  const float across = share * motor_.voltage.d - resistance * d + reactance * q;
  return {static_cast<uint32_t>(micros()),
          encoder_.getAngle(),
          motor_.shaft_velocity,
          !sense_.ok() ? NAN : (on_ ? sign * q : held_current_),
          on_ ? sign * induced : 0.0f,
          on_ ? across : 0.0f,
          supply_,
          thermistor_,
          started_ && encoder_.ok()};
}

void Winch::apply(const Actuators& actuators, const Parameters& parameters) {
  target_ = pull_sign(parameters) * clamp(actuators.current, 0.0f, board::kCurrentLimit);
  const uint32_t now_us = static_cast<uint32_t>(micros());
  if (!actuators.driver_on) {
    if (enabled_) let_go();
    return;
  }
  if (!enabled_) {
    digitalWrite(board::kEnable, HIGH);
    enabled_us_ = now_us;
    enabled_ = true;
  }
  // A driver that still wakes gives no voltage, and the current control would wind up meanwhile.
  if (on_ || since(now_us, enabled_us_) < static_cast<int32_t>(board::kWakeTime)) return;
  motor_.zero_electric_angle = parameters[Parameter::motor_zero];
  motor_.enable();
  on_ = true;
}

// Supply and thermistor in turn. What the converter does not tell is no number, which the core takes for a fault.
void Winch::measure_slowly() {
  constexpr float kFull = 3.3f;  // V
  float volts = 0.0f;
  const uint8_t turn = turns_++ % 8;
  if (turn == 0) supply_ = convert(board::kSupply, volts) ? board::kSupplyDivider * volts : NAN;
  if (turn == 4) {
    thermistor_ = convert(board::kThermistor, volts) && volts < kFull
                      ? board::kThermistorPullUp * volts / (kFull - volts)
                      : NAN;
  }
}

void Winch::hold(const Alignment::Wanted& wanted) {
  held_ = true;
  motor_.setPhaseVoltage(wanted.voltage, 0.0f, wanted.electrical);
  digitalWrite(board::kEnable, HIGH);
}

Alignment::Measured Winch::measure_alignment() {
  const ABCurrent_s current = sense_.getABCurrents(sense_.getPhaseCurrents());
  // As they would be at the nominal supply, for which the voltages are meant.
  const float share = board::kNominalSupply / larger(supply_, 1.0f);
  held_current_ = square_root(current.alpha * current.alpha + current.beta * current.beta);
  return {encoder_.getAngle(), share * current.alpha, share * current.beta};
}

void Winch::let_go() {
  digitalWrite(board::kEnable, LOW);
  motor_.disable();
  on_ = enabled_ = held_ = false;
  held_current_ = 0.0f;
}

}  // namespace firmware
}  // namespace tensionlab
