// The motor library: its current control is firmware/plant/current_control.hpp.
#include <Arduino.h>
#include <SimpleFOC.h>

#include "board.hpp"
#include "esp32/current_sense.hpp"
#include "plant/current_control.hpp"

using tensionlab::fakes::board;
using tensionlab::plant::CurrentControl;
using tensionlab::plant::Duties;
using tensionlab::plant::Vector;
namespace pins = tensionlab::firmware::board;

namespace {

constexpr double kSupply = static_cast<double>(pins::kNominalSupply);

// Only the FOC task touches these.
Sensor* sensor = nullptr;
CurrentSense* sense = nullptr;
CurrentControl control;
bool enabled = false;
double zero = 0.0;    // electrical angle at the encoder's zero that the control goes by, rad
double target = 0.0;  // A
float last_angle = 0.0f;
bool moved = false;
uint32_t controlled_us = 0, moved_us = 0;

// Seconds since it was last asked, as far as the library believes them.
double seconds_since(uint32_t& before_us) {
  const uint32_t now_us = static_cast<uint32_t>(micros());
  const double seconds = 1e-6 * static_cast<double>(now_us - before_us);
  before_us = now_us;
  return seconds > 0.0 && seconds < 0.5 ? seconds : 1e-3;
}

}  // namespace

float Sensor::getAngle() { return static_cast<float>(full_rotations) * 6.2831853f + angle_prev; }
void Sensor::update() {}
PIDController::PIDController(float p, float i, float d, float ramp, float most)
    : P(p), I(i), D(d), output_ramp(ramp), limit(most) {}
LowPassFilter::LowPassFilter(float time) : Tf(time) {}
BLDCDriver3PWM::BLDCDriver3PWM(int, int, int, int, int, int) {}
int BLDCDriver3PWM::init() { return 1; }

void* _configureADCInline(const void*, const int, const int, const int) { return nullptr; }
void CurrentSense::linkDriver(FOCDriver*) {}
InlineCurrentSense::InlineCurrentSense(float shunt, float gain, int, int, int) {
  gain_a = gain_b = 1.0f / (shunt * gain);
}
// What it reads with no current is offset. The real one takes a thousand readings.
int InlineCurrentSense::init() {
  if (board.hardware->enabled) board.on_event("offsets_with_driver_on", 1);
  constexpr int kReadings = 64;
  offset_ia = offset_ib = 0.0f;
  for (int reading = 0; reading < kReadings; ++reading) {
    float a = 0.0f, b = 0.0f;
    tensionlab::firmware::convert(pins::kSenseA, a);
    tensionlab::firmware::convert(pins::kSenseB, b);
    offset_ia += a / kReadings;
    offset_ib += b / kReadings;
  }
  return 1;
}
PhaseCurrent_s InlineCurrentSense::getPhaseCurrents() { return {0.0f, 0.0f, 0.0f}; }
ABCurrent_s CurrentSense::getABCurrents(PhaseCurrent_s current) {
  return {current.a, (current.a + 2.0f * current.b) / 1.7320508f};
}

void FOCMotor::linkSensor(Sensor* linked) { sensor = linked; }
void FOCMotor::linkCurrentSense(CurrentSense* linked) { sense = linked; }
BLDCMotor::BLDCMotor(int, float, float, float) {}
void BLDCMotor::linkDriver(BLDCDriver*) {}
int BLDCMotor::init() {
  enabled = true;  // as the real one does
  return 1;
}
int BLDCMotor::initFOC() { return zero_electric_angle < -12000.0f || sensor_direction == UNKNOWN ? 0 : 1; }
void BLDCMotor::enable() {
  enabled = true;
  zero = static_cast<double>(zero_electric_angle);
  seconds_since(controlled_us);
  board.on_event("zero_mrad", static_cast<double>(static_cast<int>(1e3 * zero + 0.5)));
}
void BLDCMotor::disable() {
  enabled = false;
  control.reset();
  board.hardware->duties = Duties::of({0.0, 0.0}, kSupply);
}
void BLDCMotor::loopFOC() {
  sensor->update();
  if (!enabled) return;
  const ABCurrent_s measured = sense->getABCurrents(sense->getPhaseCurrents());
  const Vector along = {static_cast<double>(measured.alpha), static_cast<double>(measured.beta)};
  const double angle = pins::kPolePairs * static_cast<double>(sensor->getAngle()) - zero;
  board.hardware->duties = control.advance(target, along, angle, seconds_since(controlled_us));
  current = {static_cast<float>(control.current_d()), static_cast<float>(control.current_q())};
  voltage = {static_cast<float>(control.voltage_d()), static_cast<float>(control.voltage_q())};
}
void BLDCMotor::move(float wanted) {
  const float angle = sensor->getAngle(), turn = static_cast<float>(seconds_since(moved_us));
  if (!moved) last_angle = angle;
  moved = true;
  shaft_velocity += turn / (LPF_velocity.Tf + turn) * ((angle - last_angle) / turn - shaft_velocity);
  last_angle = angle;
  if (enabled) target = static_cast<double>(wanted);
}
void BLDCMotor::setPhaseVoltage(float q, float, float electrical) {
  board.hardware->duties =
      Duties::of(Vector{0.0, static_cast<double>(q)}.turned(static_cast<double>(electrical)), kSupply);
}
