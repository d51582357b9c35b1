// The libraries that firmware/esp32 uses, as far as it uses them: so that it runs here, task by task, with the
// motor and the current control of firmware/plant/motor.hpp, and a spool. USB is stdin and stdout; Bluetooth is two files, connected from the first byte to the
// end of the first one. What happens to pins and tasks is told on stderr. Time passes as another file says, in us,
// and a byte comes back when it has; one task runs at a time, so that the same bytes always have the same effects.
// Arguments: for how many ms Bluetooth's write() blocks; the numbers of its files; those for the time; and that of
// a file with a letter for each thing that happens: b and B press and release the button, c ends the converter's
// answers, h hangs the FOC task, p holds the cable as far as it is out, and P cuts it. What the libraries do is what was read of them, not tried.
#include <Arduino.h>
#include <BluetoothSerial.h>
#include <Preferences.h>
#include <SPI.h>
#include <SimpleFOC.h>
#include <esp_gap_bt_api.h>
#include <esp_system.h>
#include <esp_task_wdt.h>
#include <poll.h>
#include <soc/gpio_reg.h>
#include <soc/sens_reg.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "as5048a_chip.hpp"
#include "plant/motor.hpp"

namespace {

using tensionlab::plant::CurrentControl;
using tensionlab::plant::Duties;
using tensionlab::plant::GimbalMotor;
using tensionlab::plant::Vector;

constexpr double kTau = 6.283185307179586, kSupply = 12.0;
constexpr int kPoles = 11, kEnablePin = 33;
constexpr uint64_t kTurn = 250;  // us, of the FOC loop
constexpr double kTurnSeconds = 1e-6 * kTurn;
// Of the motor and its spool, as in firmware/plant/plant.hpp.
constexpr double kResistance = 2.8, kInductance = 1e-3, kFlux = 0.0585 / (1.5 * kPoles), kInertia = 1.2e-5;
constexpr double kRadius = 0.0195, kStiffness = 4000.0 * kRadius * kRadius, kDamping = 3.0 * kRadius * kRadius;
constexpr double kDryFriction = 0.05 * kRadius, kViscousFriction = 0.05 * kRadius * kRadius;
constexpr double kZero = 2.0;  // electrical angle of the rotor at the encoder's zero, rad

int blocking_ms = 0, air_in = 3, air_out = 4, time_in = 5, time_out = 6, happenings = 7;
bool driver_on = false, bluetooth_there = false, pressed = false, converting = true, hanging = false;
uint64_t watchdog_us = 0, fed_us = 0;  // the watchdog's time, and when the FOC task was last heard of
double radio = 0.0;                    // what the converter reads too much since the radio has started, V

// Tasks take turns: the one that wakes first runs, and its time is now.
std::mutex turns;
std::condition_variable turn_changed;
std::vector<uint64_t> wakes = {0};  // by task, us; the first is that of main(), which gives the time
size_t running = 0;
thread_local size_t self = 0;

uint64_t now_us() { return wakes[running]; }

void wait_for_turn(std::unique_lock<std::mutex> lock) {
  turn_changed.wait(lock, [] { return running == self; });
}

void sleep_us(uint64_t duration) {
  std::unique_lock<std::mutex> lock(turns);
  wakes[self] += duration;
  running = static_cast<size_t>(std::min_element(wakes.begin(), wakes.end()) - wakes.begin());
  turn_changed.notify_all();
  wait_for_turn(std::move(lock));
}

// Only the FOC task touches these.
Chip chip;
Sensor* sensor = nullptr;
double rotor = 1.0, rotor_speed = 0.0, held_at = 0.0, target = 0.0;  // rad, rad/s, rad, A
bool enabled = false, held = false;
double zero = 0.0;  // electrical angle at the encoder's zero that the control goes by, rad
float last_angle = 1.0f;
GimbalMotor windings;
CurrentControl control;
Duties duties = {};
CurrentSense* sense = nullptr;

void tell(const char* what, double number) {
  std::fprintf(stderr, "%.4f %s %g\n", 1e-6 * static_cast<double>(now_us()), what, number);
}

bool ready(int file) {
  pollfd asked = {file, POLLIN, 0};
  return poll(&asked, 1, 0) > 0;
}

int waiting(int file) {
  int count = 0;
  ioctl(file, FIONREAD, &count);
  return count == 0 && ready(file) ? 1 : count;  // the end of a file is read like a byte
}

// The cable is held at its end, or nothing holds the spool; either way round, as nobody knows which it is wound.
void turn_rotor() {
  constexpr int kParts = 4;
  constexpr double kSeconds = kTurnSeconds / kParts;
  for (int part = 0; part < kParts; ++part) {
    const double angle = kPoles * rotor - kZero;
    windings.advance(driver_on ? &duties : nullptr, kSupply, angle, kPoles * rotor_speed, kResistance, kInductance,
                     kFlux, kSeconds);
    double torque = 1.5 * kPoles * kFlux * windings.along_q(angle) - kViscousFriction * rotor_speed;
    if (held) torque -= kStiffness * (rotor - held_at) + kDamping * rotor_speed;
    const double speed = rotor_speed + torque / kInertia * kSeconds, grip = kDryFriction / kInertia * kSeconds;
    rotor_speed = speed > grip ? speed - grip : (speed < -grip ? speed + grip : 0.0);
    rotor += rotor_speed * kSeconds;
  }
}

}  // namespace

void pinMode(uint8_t pin, uint8_t mode) {
  if (pin == kEnablePin && mode == OUTPUT) tell("output", pin);
}
void digitalWrite(uint8_t pin, uint8_t value) {
  if (pin != kEnablePin || driver_on == (value != 0)) return;
  driver_on = value != 0;
  tell("driver", value);
}
int digitalRead(uint8_t) { return pressed ? LOW : HIGH; }
int8_t digitalPinToAnalogChannel(uint8_t pin) { return pin == 32 ? 4 : (pin == 34 ? 6 : 7); }
unsigned long micros() { return static_cast<uint32_t>(now_us()); }
void delayMicroseconds(uint32_t) {}
bool ledcAttach(uint8_t, uint32_t, uint8_t) { return true; }
bool ledcWrite(uint8_t, uint32_t duty) {
  tell("servo_us", std::round(duty * 20000.0 / 65536.0));
  return true;
}

String::String(const char*) {}
HardwareSerial Serial;
EspClass ESP;
SPIClass SPI;

namespace {
bool still_there(int file) {
  if (!ready(file)) return true;
  pollfd asked = {file, POLLIN, 0};
  poll(&asked, 1, 0);
  return (asked.revents & POLLIN) != 0;
}
}  // namespace

size_t Stream::write(const uint8_t* bytes, size_t size) { return static_cast<size_t>(::write(1, bytes, size)); }
size_t Stream::readBytes(uint8_t* bytes, size_t size) {
  const int file = this == &Serial ? 0 : air_in;
  const ssize_t count = ::read(file, bytes, size);
  if (count == 0 && file == 0) std::_Exit(0);
  return count > 0 ? static_cast<size_t>(count) : 0;
}
size_t HardwareSerial::setRxBufferSize(size_t size) { return size; }
size_t HardwareSerial::setTxBufferSize(size_t size) { return size; }
void HardwareSerial::begin(unsigned long) {}
int HardwareSerial::available() { return waiting(0); }
size_t HardwareSerial::write(uint8_t byte) { return Stream::write(&byte, 1); }
uint64_t EspClass::getEfuseMac() { return 0xA1B2C3D4E5F6u; }

bool BluetoothSerial::begin(String, bool, bool) {
  radio = 0.025;
  return true;
}
void BluetoothSerial::enableSSP(bool input, bool output) { tell("announces_at_begin", input || output ? 1 : 0); }
int esp_bt_gap_set_security_param(esp_bt_sp_param_t, void* value, uint8_t) {
  // The core refuses what would have to be confirmed, for want of a callback.
  tell("pairs", *static_cast<esp_bt_io_cap_t*>(value) == ESP_BT_IO_CAP_NONE ? 1 : 0);
  return 0;
}
int esp_bt_gap_set_scan_mode(esp_bt_connection_mode_t connection, esp_bt_discovery_mode_t discovery) {
  tell("connectable", connection);
  tell("found", discovery == ESP_BT_GENERAL_DISCOVERABLE ? 1 : 0);
  return 0;
}
bool BluetoothSerial::hasClient() {
  const bool there = still_there(air_in) && (bluetooth_there || ready(air_in));
  bluetooth_there = there;
  return there;
}
int BluetoothSerial::available() { return bluetooth_there ? waiting(air_in) : 0; }
size_t BluetoothSerial::write(uint8_t byte) { return write(&byte, 1); }
size_t BluetoothSerial::write(const uint8_t* bytes, size_t size) {
  sleep_us(1000u * static_cast<uint64_t>(blocking_ms));
  return static_cast<size_t>(::write(air_out, bytes, size));
}

SPISettings::SPISettings(uint32_t, uint8_t, uint8_t) {}
bool SPIClass::begin(int8_t, int8_t, int8_t, int8_t) { return true; }
void SPIClass::beginTransaction(SPISettings) {}
void SPIClass::endTransaction() {}
uint16_t SPIClass::transfer16(uint16_t frame) {
  while (hanging) sleep_us(1000000);
  const double turns = rotor / kTau;
  chip.angle = static_cast<uint16_t>(16384.0 * (turns - std::floor(turns)));
  return chip.exchange(frame);
}

bool Preferences::begin(const char*, bool) { return true; }
void Preferences::end() {}
size_t Preferences::getBytesLength(const char*) { return 0; }
size_t Preferences::getBytes(const char*, void*, size_t) { return 0; }
size_t Preferences::putBytes(const char*, const void*, size_t size) {
  tell("stored", static_cast<double>(size));
  return size;
}

esp_reset_reason_t esp_reset_reason() { return ESP_RST_TASK_WDT; }
esp_err_t esp_task_wdt_reconfigure(const esp_task_wdt_config_t* config) {
  tell("watchdog_ms", config->timeout_ms);
  watchdog_us = 1000u * config->timeout_ms;
  fed_us = now_us();
  return 0;
}
esp_err_t esp_task_wdt_add(TaskHandle_t) { return 0; }
// Once in each turn of the FOC loop.
esp_err_t esp_task_wdt_reset() {
  fed_us = now_us();
  sleep_us(kTurn);
  turn_rotor();
  return 0;
}
BaseType_t xTaskCreatePinnedToCore(TaskFunction_t task, const char* name, uint32_t, void* argument, UBaseType_t,
                                   TaskHandle_t*, BaseType_t core) {
  tell((std::string("task_") + name).c_str(), core);
  const size_t number = wakes.size();
  wakes.push_back(now_us());
  std::thread([=] {
    self = number;
    wait_for_turn(std::unique_lock<std::mutex>(turns));
    task(argument);
  }).detach();
  return pdPASS;
}
void vTaskDelay(TickType_t ticks) { sleep_us(1000u * static_cast<uint64_t>(ticks)); }
namespace {
void watch() {
  if (watchdog_us == 0 || now_us() - fed_us <= watchdog_us) return;
  watchdog_us = 0;
  esp_task_wdt_isr_user_handler();
  tell("panic", 1);
}

void happen() {
  char what = 0;
  while (ready(happenings) && ::read(happenings, &what, 1) == 1) {
    if (what == 'b' || what == 'B') pressed = what == 'b';
    if (what == 'c') converting = false;
    if (what == 'h') hanging = true;
    if (what == 'p' || what == 'P') held = what == 'p';
    if (what == 'p') held_at = rotor;
  }
}
}  // namespace

void REG_WRITE(uint32_t reg, uint32_t value) {
  if (reg == GPIO_OUT1_W1TC_REG && value == 1u << (kEnablePin - 32)) digitalWrite(kEnablePin, LOW);
}

// The task that is deleted is that of main(): its thread lets time pass from now on.
void vTaskDelete(TaskHandle_t) {
  for (uint32_t duration = 0; ::read(time_in, &duration, sizeof duration) == sizeof duration;) {
    sleep_us(duration);
    watch();
    happen();
    if (::write(time_out, "", 1) != 1) break;
  }
  std::_Exit(0);
}

float Sensor::getAngle() { return static_cast<float>(full_rotations) * 6.2831853f + angle_prev; }
void Sensor::update() {}
PIDController::PIDController(float p, float i, float d, float ramp, float most)
    : P(p), I(i), D(d), output_ramp(ramp), limit(most) {}
LowPassFilter::LowPassFilter(float time) : Tf(time) {}
BLDCDriver3PWM::BLDCDriver3PWM(int, int, int, int, int, int) {}
int BLDCDriver3PWM::init() { return 1; }
void CurrentSense::linkDriver(FOCDriver*) {}
InlineCurrentSense::InlineCurrentSense(float shunt, float gain, int, int, int) {
  gain_a = gain_b = 1.0f / (shunt * gain);
}
int InlineCurrentSense::init() {
  if (driver_on) tell("offsets_with_driver_on", 1);
  offset_ia = offset_ib = 1.65f;
  return 1;
}
PhaseCurrent_s InlineCurrentSense::getPhaseCurrents() { return {0.0f, 0.0f, 0.0f}; }

namespace {
uint32_t pad = 0;  // of the converter, one bit

double phase_current(bool second) {
  const Vector& current = windings.current();
  return second ? -0.5 * current.alpha + 0.8660254037844386 * current.beta : current.alpha;
}

// Voltage at the chosen pin. The second amplifier is the other way round, as on the shield; half a volt for an
// ampere.
double pin_voltage() {
  if (pad == 1u << 4) return kSupply / 11.0;
  const bool second = pad == 1u << 7;
  return 1.65 + radio + (second ? -0.5 : 0.5) * phase_current(second);
}
}  // namespace

void SET_PERI_REG_MASK(uint32_t, uint32_t) {}
void CLEAR_PERI_REG_MASK(uint32_t, uint32_t) {}
void SET_PERI_REG_BITS(uint32_t, uint32_t, uint32_t value, int) { pad = value; }
uint32_t GET_PERI_REG_MASK(uint32_t, uint32_t) {
  if (!converting) sleep_us(10);
  return converting ? 1 : 0;
}
uint32_t GET_PERI_REG_BITS2(uint32_t, uint32_t, int) {
  return static_cast<uint32_t>(std::lround(pin_voltage() * 4095.0 / 3.3));
}
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
  tell("zero_mrad", std::round(1e3 * static_cast<double>(zero_electric_angle)));
}
void BLDCMotor::disable() {
  enabled = false;
  control.reset();
  duties = Duties::of({0.0, 0.0}, kSupply);
}
void BLDCMotor::loopFOC() {
  sensor->update();
  if (!enabled) return;
  const ABCurrent_s measured = sense->getABCurrents(sense->getPhaseCurrents());
  const Vector along = {static_cast<double>(measured.alpha), static_cast<double>(measured.beta)};
  duties = control.advance(target, along, kPoles * static_cast<double>(sensor->getAngle()) - zero, kTurnSeconds);
  current = {static_cast<float>(control.current_d()), static_cast<float>(control.current_q())};
  voltage = {static_cast<float>(control.voltage_d()), static_cast<float>(control.voltage_q())};
}
void BLDCMotor::move(float wanted) {
  const float angle = sensor->getAngle(), turn = static_cast<float>(kTurnSeconds);
  shaft_velocity += turn / (LPF_velocity.Tf + turn) * ((angle - last_angle) / turn - shaft_velocity);
  last_angle = angle;
  if (enabled) target = static_cast<double>(wanted);
}
void BLDCMotor::setPhaseVoltage(float q, float, float electrical) {
  duties = Duties::of(Vector{0.0, static_cast<double>(q)}.turned(static_cast<double>(electrical)), kSupply);
}

void* _configureADCInline(const void*, const int, const int, const int) { return nullptr; }

int main(int, char** words) {
  int* const numbers[] = {&blocking_ms, &air_in, &air_out, &time_in, &time_out, &happenings};
  for (int* number : numbers) *number = std::atoi(*++words);
  setup();
  loop();
}
