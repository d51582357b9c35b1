#include "link.hpp"

#include <Arduino.h>
#include <BluetoothSerial.h>

#include "../core/frame.hpp"
#include "board.hpp"

namespace tensionlab {
namespace firmware {

namespace {

BluetoothSerial bluetooth;
constexpr size_t kPiece = 128;  // bytes at a time

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
  bluetooth.enableSSP();  // pairs without asking anybody
  const bool found = bluetooth.begin(name);
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
  Stream& from = stream(by_bluetooth);
  uint8_t bytes[kPiece];
  const size_t room = received_.room();
  const size_t most = room < sizeof bytes ? room : sizeof bytes;
  const int waiting = from.available();
  const size_t there = waiting > 0 ? static_cast<size_t>(waiting) : 0;
  const size_t size = there < most ? there : most;
  if (size == 0) {
    vTaskDelay(1);
    return;
  }
  received_.put(bytes, from.readBytes(bytes, size));
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
