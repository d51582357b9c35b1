// The firmware's ESP32 layer on firmware/fakes, for a host at the other end of pipes. USB is stdin and stdout;
// Bluetooth is two files, connected from the first byte to the end of the first one. What happens to pins and
// tasks is told on stderr. Time passes as another file says, in us, and a byte comes back when it has. Arguments:
// for how many ms Bluetooth's write() blocks; the numbers of its files; those for the time; and that of a file
// with a letter for each thing that happens: b and B press and release the button, c ends the converter's answers,
// h hangs the FOC task, p holds the cable as far as it is out, and P cuts it.
#include <Arduino.h>
#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "fakes/board.hpp"
#include "fakes/tasks.hpp"

using namespace tensionlab;
using fakes::board;

namespace {

bool ready(int file) {
  pollfd asked = {file, POLLIN, 0};
  return poll(&asked, 1, 0) > 0;
}

// Takes what has come; returns false at the end of the file.
bool pump(int file, fakes::Port& port) {
  while (ready(file)) {
    std::uint8_t bytes[4096];
    const ssize_t count = read(file, bytes, sizeof bytes);
    if (count <= 0) return false;
    port.arriving.insert(port.arriving.end(), bytes, bytes + count);
    port.connected = true;
  }
  return true;
}

void flush(fakes::Port& port, int file) {
  if (!port.sent.empty() && write(file, port.sent.data(), port.sent.size()) < 0) std::_Exit(1);
  port.sent.clear();
}

void happen(char what) {
  if (what == 'b' || what == 'B') board.pressed = what == 'b';
  if (what == 'c') board.hardware->faults.converter = true;
  if (what == 'h') board.hanging = true;
  if (what == 'p' || what == 'P') board.hardware->spool().cut = what == 'P';
  if (what == 'p') board.hardware->take_up_slack();
}

}  // namespace

// The last argument is the way in which the encoder counts, 1 or -1.
int main(int, char** words) {
  const auto number = [&](int word) { return std::atoi(words[word]); };
  const int air_in = number(2), air_out = number(3), time_in = number(4), time_out = number(5),
            happenings = number(6);
  plant::HardwareParameters parameters;
  parameters.way = number(7);
  board.hardware.emplace(parameters, 1.0, 1);
  board.hardware->spool().cut = true;
  board.blocking_us = 1000u * static_cast<std::uint64_t>(number(1));
  board.radio_shift = 0.025;
  board.reset_reason = ESP_RST_TASK_WDT;
  board.on_event = [](const char* what, double value) {
    std::fprintf(stderr, "%.4f %s %g\n", 1e-6 * static_cast<double>(fakes::now_us()), what, value);
  };
  setup();
  loop();
  for (std::uint32_t duration = 0; read(time_in, &duration, sizeof duration) == sizeof duration;) {
    if (!pump(0, board.usb)) std::_Exit(0);
    if (!pump(air_in, board.air)) board.air.connected = false;
    fakes::sleep_us(duration);
    fakes::catch_up();
    fakes::watch();
    for (char what = 0; ready(happenings) && read(happenings, &what, 1) == 1;) happen(what);
    flush(board.usb, 1);
    flush(board.air, air_out);
    if (write(time_out, "", 1) != 1) break;
  }
  std::_Exit(0);
}
