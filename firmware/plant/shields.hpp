// The shields that firmware/esp32/boards has files for, as their makers' documents describe them, and not as those
// files do: what a file gets wrong shows on the simulated hardware.
#pragma once

#include "hardware.hpp"

namespace tensionlab {
namespace plant {

// The parameters of a module on this shield, by its main version. What no document says of version 4 is estimated.
inline HardwareParameters with_shield(int version) {
  HardwareParameters hardware;
  SensingParameters& sensing = hardware.sensing;
  hardware.bridge_resistance = 0.4;  // L6234 and wires
  if (version == 3) {
    hardware.bridge_resistance = 0.34;  // DRV8313
    // ACS712-05B, in proportion to its supply of 3.3 V; both from the driver to the motor.
    sensing.shunt = 0.1221;
    sensing.gain = 1.0;
    sensing.sign_b = 1.0;
  } else if (version == 4) {
    hardware.bridge_resistance = 0.15;  // DRV8316
    hardware.wake_time = 2e-3;          // estimate
    sensing.sign_b = 1.0;               // estimate
  }
  return hardware;
}

}  // namespace plant
}  // namespace tensionlab
