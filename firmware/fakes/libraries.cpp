// The Arduino core and the vendor's libraries.
#include <Arduino.h>
#include <BluetoothSerial.h>
#include <Preferences.h>
#include <SPI.h>
#include <esp_gap_bt_api.h>
#include <esp_system.h>
#include <esp_task_wdt.h>
#include <soc/gpio_reg.h>
#include <soc/sens_reg.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "board.hpp"
#include "tasks.hpp"

using tensionlab::fakes::board;
using tensionlab::fakes::now_us;
using tensionlab::fakes::Port;
using tensionlab::fakes::sleep_us;
using tensionlab::plant::CurrentSensing;
namespace pins = tensionlab::firmware::board;

namespace tensionlab {
namespace fakes {

Board board;

namespace {

std::uint64_t hardware_us = 0;              // up to when it has moved
std::uint64_t watchdog_us = 0, fed_us = 0;  // the watchdog's time, and when the FOC task was last heard of
std::uint32_t pad = 0;                      // of the converter, one bit

}  // namespace

void catch_up() {
  const std::uint64_t now = now_us();
  if (now > hardware_us) board.hardware->advance(1e-6 * static_cast<double>(now - hardware_us), board.hand_speed);
  hardware_us = std::max(now, hardware_us);
}

void watch() {
  if (watchdog_us == 0 || now_us() - fed_us <= watchdog_us) return;
  watchdog_us = 0;
  board.hanging = true;  // until the chip starts afresh, which here it does not
  esp_task_wdt_isr_user_handler();
  board.on_event("panic", 1);
}

}  // namespace fakes
}  // namespace tensionlab

// Pins

void pinMode(uint8_t pin, uint8_t mode) {
  if (pin == pins::kEnable && mode == OUTPUT) board.on_event("output", pin);
}
void digitalWrite(uint8_t pin, uint8_t value) {
  if (pin != pins::kEnable || board.hardware->enabled == (value != 0)) return;
  tensionlab::fakes::catch_up();
  board.hardware->enabled = value != 0;
  board.on_event("driver", value);
}
int digitalRead(uint8_t) { return board.pressed ? LOW : HIGH; }
int8_t digitalPinToAnalogChannel(uint8_t pin) {
  if (pin == pins::kThermistor) return 0;
  return pin == pins::kSupply ? 4 : (pin == pins::kSenseA ? 6 : 7);
}
unsigned long micros() { return static_cast<uint32_t>(now_us() + board.clock_us); }
void delayMicroseconds(uint32_t) {}
bool ledcAttach(uint8_t, uint32_t, uint8_t) { return true; }
bool ledcWrite(uint8_t, uint32_t duty) {
  const double pulse_us = duty * 20000.0 / 65536.0;
  board.hardware->brake = std::clamp((pulse_us - 1000.0) / 500.0, 0.0, 1.0);
  board.on_event("servo_us", std::round(pulse_us));
  return true;
}
void REG_WRITE(uint32_t reg, uint32_t value) {
  if (reg == GPIO_OUT1_W1TC_REG && value == 1u << (pins::kEnable - 32)) digitalWrite(pins::kEnable, LOW);
}

// Links

String::String(const char*) {}
HardwareSerial Serial;
EspClass ESP;
SPIClass SPI;

namespace {

Port& port_of(const Stream* stream) { return stream == &Serial ? board.usb : board.air; }

size_t pass_on(Port& port, const uint8_t* bytes, size_t size) {
  port.sent.insert(port.sent.end(), bytes, bytes + size);
  return size;
}

}  // namespace

size_t Stream::write(const uint8_t* bytes, size_t size) { return pass_on(port_of(this), bytes, size); }
size_t Stream::readBytes(uint8_t* bytes, size_t size) {
  auto& arriving = port_of(this).arriving;
  const size_t count = std::min(size, arriving.size());
  std::copy_n(arriving.begin(), count, bytes);
  arriving.erase(arriving.begin(), arriving.begin() + static_cast<std::ptrdiff_t>(count));
  return count;
}
size_t HardwareSerial::setRxBufferSize(size_t size) { return size; }
size_t HardwareSerial::setTxBufferSize(size_t size) { return size; }
void HardwareSerial::begin(unsigned long) {}
int HardwareSerial::available() { return static_cast<int>(board.usb.arriving.size()); }
size_t HardwareSerial::write(uint8_t byte) { return Stream::write(&byte, 1); }
uint64_t EspClass::getEfuseMac() { return 0xA1B2C3D4E5F6u; }

bool BluetoothSerial::begin(String, bool, bool) {
  board.hardware->sensing().shift = board.radio_shift;
  return true;
}
void BluetoothSerial::enableSSP(bool input, bool output) {
  board.on_event("announces_at_begin", input || output ? 1 : 0);
}
int esp_bt_gap_set_security_param(esp_bt_sp_param_t, void* value, uint8_t) {
  // The core refuses what would have to be confirmed, for want of a callback.
  board.pairable = *static_cast<esp_bt_io_cap_t*>(value) == ESP_BT_IO_CAP_NONE;
  board.on_event("pairs", board.pairable ? 1 : 0);
  return 0;
}
int esp_bt_gap_set_scan_mode(esp_bt_connection_mode_t connection, esp_bt_discovery_mode_t discovery) {
  board.on_event("connectable", connection);
  board.on_event("found", discovery == ESP_BT_GENERAL_DISCOVERABLE ? 1 : 0);
  return 0;
}
bool BluetoothSerial::hasClient() { return board.air.connected || !board.air.arriving.empty(); }
int BluetoothSerial::available() { return static_cast<int>(board.air.arriving.size()); }
size_t BluetoothSerial::write(uint8_t byte) { return write(&byte, 1); }
size_t BluetoothSerial::write(const uint8_t* bytes, size_t size) {
  sleep_us(board.blocking_us);
  return pass_on(board.air, bytes, size);
}

SPISettings::SPISettings(uint32_t, uint8_t, uint8_t) {}
bool SPIClass::begin(int8_t, int8_t, int8_t, int8_t) { return true; }
void SPIClass::beginTransaction(SPISettings) {}
void SPIClass::endTransaction() {}
uint16_t SPIClass::transfer16(uint16_t frame) {
  while (board.hanging) sleep_us(1000000);
  return board.hardware->exchange(frame);
}

// Flash and the system

bool Preferences::begin(const char*, bool) { return true; }
void Preferences::end() {}
size_t Preferences::getBytesLength(const char*) { return board.flash.size(); }
size_t Preferences::getBytes(const char*, void* bytes, size_t room) {
  if (board.flash.size() > room) return 0;
  std::memcpy(bytes, board.flash.data(), board.flash.size());
  return board.flash.size();
}
size_t Preferences::putBytes(const char*, const void* bytes, size_t size) {
  const uint8_t* const begin = static_cast<const uint8_t*>(bytes);
  board.flash.assign(begin, begin + size);
  board.on_event("stored", static_cast<double>(size));
  return size;
}

esp_reset_reason_t esp_reset_reason() { return board.reset_reason; }
esp_err_t esp_task_wdt_reconfigure(const esp_task_wdt_config_t* config) {
  board.on_event("watchdog_ms", config->timeout_ms);
  tensionlab::fakes::watchdog_us = 1000u * config->timeout_ms;
  tensionlab::fakes::fed_us = now_us();
  return 0;
}
esp_err_t esp_task_wdt_add(TaskHandle_t) { return 0; }
// Once in each turn of the FOC loop.
esp_err_t esp_task_wdt_reset() {
  tensionlab::fakes::fed_us = now_us();
  const std::uint64_t stall_us = board.stall_us;
  board.stall_us = 0;
  sleep_us(board.turn_us + stall_us);
  tensionlab::fakes::catch_up();
  board.on_turn();
  return 0;
}
BaseType_t xTaskCreatePinnedToCore(TaskFunction_t task, const char* name, uint32_t, void* argument, UBaseType_t,
                                   TaskHandle_t*, BaseType_t core) {
  board.on_event((std::string("task_") + name).c_str(), core);
  tensionlab::fakes::start_task([=] { task(argument); });
  return pdPASS;
}
void vTaskDelay(TickType_t ticks) { sleep_us(static_cast<uint64_t>(board.tick_us) * ticks); }
// The task that is deleted is that of main(), which goes on as the host.
void vTaskDelete(TaskHandle_t) {}

// The converter's registers

void SET_PERI_REG_MASK(uint32_t, uint32_t) {}
void CLEAR_PERI_REG_MASK(uint32_t, uint32_t) {}
void SET_PERI_REG_BITS(uint32_t, uint32_t, uint32_t value, int) { tensionlab::fakes::pad = value; }
uint32_t GET_PERI_REG_MASK(uint32_t, uint32_t) {
  if (board.hardware->faults.converter) sleep_us(10);
  return board.hardware->faults.converter ? 0 : 1;
}
uint32_t GET_PERI_REG_BITS2(uint32_t, uint32_t, int) {
  using Input = CurrentSensing::Input;
  const uint32_t pad = tensionlab::fakes::pad;
  const Input input = pad == 1u        ? Input::thermistor
                      : pad == 1u << 4 ? Input::supply
                      : pad == 1u << 6 ? Input::phase_a
                                       : Input::phase_b;
  return static_cast<uint32_t>(board.hardware->convert(input));
}
