// monitor: what the firmware's monitor makes of samples, one a line: microseconds since the last one, angle (rad),
// speed (rad/s), current (A), induced and across (V), supply (V), encoder_ok, and the current that was commanded
// before (A). Printed are, for each, the faults, the seconds that may pass, and the length that is paid out (m).
#include "core/monitor.hpp"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>

int main() {
  namespace fw = tensionlab::firmware;
  const fw::Parameters parameters;
  fw::Monitor monitor;
  std::uint32_t now_us = 0xFFFFF000u;  // about to wrap around
  const auto number = [] {
    std::string word;
    std::cin >> word;
    return std::strtof(word.c_str(), nullptr);
  };
  for (std::string word; std::cin >> word;) {
    now_us += static_cast<std::uint32_t>(std::atoi(word.c_str()));
    const float angle = number(), speed = number(), current = number(), induced = number(), across = number();
    const float supply = number(), ok = number();
    const float commanded = number();
    const float seconds = monitor.take({now_us, angle, speed, current, induced, across, supply, 0.0f, ok != 0.0f},
                                       true, commanded, parameters);
    std::printf("%d %.9g %.9g\n", monitor.faults(), static_cast<double>(seconds),
                static_cast<double>(monitor.paid_out()));
  }
}
