// module: the whole core with made-up samples in place of hardware. A line is "receive" and the bytes that came
// over the link, in hex; or "step" and a sample: microseconds since the last one, angle (rad), speed (rad/s),
// current (A), thermistor (ohm). The voltage that the rotor induces is that of the speed. Printed are, after each
// step, whether the driver is on, the current that is asked for (A), and the state; and what the module has to
// send, in hex.
#include "core/module.hpp"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

int main() {
  namespace fw = tensionlab::firmware;
  fw::Module module(1, fw::ResetReason::power);
  std::uint32_t now_us = 0xFFFFF000u;  // about to wrap around
  for (std::string word; std::cin >> word;) {
    if (word == "receive") {
      std::string hex;
      std::cin >> hex;
      std::vector<std::uint8_t> bytes;
      for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
        bytes.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
      }
      module.receive(bytes.data(), bytes.size(), now_us);
      continue;
    }
    std::uint32_t elapsed = 0;
    float angle = 0.0f, speed = 0.0f, current = 0.0f;
    std::string thermistor;  // may be infinite
    std::cin >> elapsed >> angle >> speed >> current >> thermistor;
    now_us += elapsed;
    const float induced = -speed * 0.0195f * 2.0f;  // at 3 N/A
    const float ohm = std::strtof(thermistor.c_str(), nullptr);
    const fw::Actuators wanted = module.step({now_us, angle, speed, current, induced, 0.0f, 12.0f, ohm, true});
    std::printf("%d %.9g %d -", wanted.driver_on, static_cast<double>(wanted.current),
                static_cast<int>(module.state()));
    std::uint8_t sent[1024];
    const std::size_t size = module.transmit(sent, sizeof sent);
    for (std::size_t i = 0; i < size; ++i) std::printf("%02x", sent[i]);
    std::printf("\n");
  }
}
