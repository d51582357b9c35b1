// The ESP32 as far as firmware/esp32 uses it: its pins lead to firmware/plant/hardware.hpp, its links to whoever
// plays the hosts. What the libraries do is what was read of them, not tried.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "esp_system.h"
#include "plant/hardware.hpp"

namespace tensionlab {
namespace fakes {

// One end of a link.
struct Port {
  std::vector<std::uint8_t> arriving, sent;
  bool connected = false;  // Bluetooth: somebody is there
};

struct Board {
  std::optional<plant::Hardware> hardware;
  Port usb, air;
  std::vector<std::uint8_t> flash;  // settings that were stored; none at first
  esp_reset_reason_t reset_reason = ESP_RST_POWERON;
  std::uint32_t tick_us = 1000;   // of the tasks of the link, which wait a tick
  std::uint32_t clock_us = 0;     // at the start, which wraps around at 2^32
  std::uint32_t turn_us = 250;    // of the FOC loop
  std::uint64_t blocking_us = 0;  // for which Bluetooth's write() blocks
  std::uint64_t stall_us = 0;     // for which both processors stop once, as they do while flash is written
  double radio_shift = 0.0;       // that the converter reads too much once the radio has started, V
  double hand_speed = 0.0;        // of the cable's far end, m/s
  bool pressed = false;           // the button
  bool hanging = false;           // the FOC task, for ever
  bool pairable = false;          // whoever asks is paired, and its key stored
  void (*on_event)(const char* what, double number) = [](const char*, double) {};
  void (*on_turn)() = [] {};  // after each turn of the FOC loop
};

extern Board board;

// The hardware moves on up to now. Whoever lets time pass calls it: the FOC task may hang.
void catch_up();
// Lets the watchdog see whether the FOC task has been heard of.
void watch();

}  // namespace fakes
}  // namespace tensionlab
