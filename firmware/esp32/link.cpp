#include "link.hpp"

#include <Arduino.h>
#include <BluetoothSerial.h>
#include <esp_gap_bt_api.h>

#include <type_traits>

#include "../core/frame.hpp"
#include "../core/numbers.hpp"
#include "board.hpp"

namespace tensionlab {
namespace firmware {

namespace {

BluetoothSerial bluetooth;
constexpr size_t kPiece = 128;  // bytes at a time
// The next major version of the core returns an object that says more.
static_assert(std::is_same<decltype(bluetooth.begin("")), bool>::value, "made for version 3 of the Arduino core");

// In the window the module can be found, and pairs without a question: it announces that it can neither ask nor
// show anything. Outside it is hidden from strangers, and announces a display and a button, which nothing here
// serves: the core then refuses to pair. Those that have paired before connect at any time.
void set_pairing(bool open) {
  esp_bt_io_cap_t ability = open ? ESP_BT_IO_CAP_NONE : ESP_BT_IO_CAP_IO;
  esp_bt_gap_set_security_param(ESP_BT_SP_IOCAP_MODE, &ability, sizeof ability);
  esp_bt_gap_set_scan_mode(ESP_BT_CONNECTABLE, open ? ESP_BT_GENERAL_DISCOVERABLE : ESP_BT_NON_DISCOVERABLE);
}

// Passes on what a stream has, as far as there is room. Returns whether there was anything.
template <size_t kCapacity>
bool pass(Stream& from, ByteQueue<kCapacity>& to) {
  uint8_t bytes[kPiece];
  const size_t room = to.room();
  const size_t most = room < sizeof bytes ? room : sizeof bytes;
  const int waiting = from.available();
  const size_t there = waiting > 0 ? static_cast<size_t>(waiting) : 0;
  const size_t size = there < most ? there : most;
  return size > 0 && to.put(bytes, from.readBytes(bytes, size)) > 0;
}

Stream& stream(bool by_bluetooth) {
  if (by_bluetooth) return bluetooth;
  return Serial;
}

bool start(TaskFunction_t task, const char* name, void* self) {
  return xTaskCreatePinnedToCore(task, name, board::kStack, self, board::kLinkPriority, nullptr,
                                 board::kLinkCore) == pdPASS;
}

}  // namespace

bool Link::begin(uint32_t serial_number) {
  Serial.setRxBufferSize(1024);
  Serial.setTxBufferSize(1024);
  Serial.begin(board::kBaud);
  const uint8_t zeros[kDelimiter] = {};
  Serial.write(zeros, sizeof zeros);  // whatever the chip printed as it started ends here
  char name[] = "tensionlab-00000000";
  for (size_t i = sizeof name - 2; serial_number != 0; --i, serial_number >>= 4) {
    name[i] = "0123456789abcdef"[serial_number & 0xF];
  }
  pinMode(board::kPairButton, INPUT_PULLUP);
  bluetooth.enableSSP(false, false);  // no input, no output
  const bool found = bluetooth.begin(name);
  set_pairing(false);
  return start(&Link::read_forever, "read", this) && start(&Link::write_forever, "write", this) && found;
}

void Link::read_forever(void* self) {
  for (;;) static_cast<Link*>(self)->read();
}

void Link::write_forever(void* self) {
  for (;;) static_cast<Link*>(self)->write();
}

void Link::read() {
  const bool by_bluetooth = bluetooth.hasClient();
  if (by_bluetooth != bluetooth_.load(std::memory_order_relaxed)) {
    bluetooth_.store(by_bluetooth, std::memory_order_relaxed);
    closed_.store(true, std::memory_order_release);
  }
  watch_button();
  const bool received = pass(stream(by_bluetooth), received_), overheard = pass(stream(!by_bluetooth), overheard_);
  if (!received && !overheard) vTaskDelay(1);
}

void Link::watch_button() {
  const uint32_t now_us = static_cast<uint32_t>(micros());
  const bool allowed = may_pair_.load(std::memory_order_relaxed);
  const bool pressed = allowed && digitalRead(board::kPairButton) == LOW;
  if (pressed) pairing_us_ = now_us;
  const bool open = pressed || (pairing_ && allowed && since(now_us, pairing_us_) < board::kPairingTime);
  if (open != pairing_) set_pairing(open);
  pairing_ = open;
}

void Link::write() {
  uint8_t bytes[kPiece];
  const size_t size = to_send_.take(bytes, sizeof bytes);
  if (size == 0) {
    vTaskDelay(1);
    return;
  }
  stream(bluetooth_.load(std::memory_order_relaxed)).write(bytes, size);
}

}  // namespace firmware
}  // namespace tensionlab
