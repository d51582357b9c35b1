// SimpleFOC shield v2.0.x: L6234 driver, INA240A2 amplifiers. The published module has this one.
// Source: schematic v2.0.4 in the maker's repository (simplefoc/Arduino-SimpleFOCShield), data sheets.
#pragma once

#include <stdint.h>

#include "../../core/thermal.hpp"

namespace tensionlab {
namespace firmware {
namespace board {

using Pin = uint8_t;

// Motor driver. The shield has 4.7 kOhm from the enable pin to ground, which keep it off while the ESP32 starts.
constexpr Pin kPhaseA = 25;                // header pad 9
constexpr Pin kPhaseB = 26;                // header pad 5
constexpr Pin kPhaseC = 27;                // header pad 6
constexpr Pin kEnable = 33;                // header pad 8
constexpr uint32_t kWakeTime = 0;          // us, from enable until the driver drives
constexpr float kBridgeResistance = 0.4f;  // ohm: 0.3 of a switch (L6234), and the wires
constexpr float kCurrentLimit = 2.5f;      // A, whatever the parameters say

// Current sensing of two phases, and the motor supply behind a divider. All on the first converter; the pins are
// inputs only, and not the two (36, 39) that disturb themselves.
constexpr Pin kSenseA = 34;       // header pad A0
constexpr Pin kSenseB = 35;       // header pad A2
constexpr Pin kSupply = 32;       // own divider, R1 and R2
constexpr float kShunt = 0.010f;  // ohm: a chip marked R010. Where it is marked R006, write 0.006f.
constexpr float kVoltsPerAmpere = 50.0f * kShunt;  // INA240A2: 50 V/V
constexpr float kSenseSignA = 1.0f;
constexpr float kSenseSignB = -1.0f;     // the second amplifier is the other way round
constexpr float kSupplyDivider = 11.0f;  // 100 kOhm above 10 kOhm

// L6234: 0.3 ohm cold; it switches itself off at 160 °C (ST, AN1088). The thermal resistance is that of the L6225
// in the same package on 6 cm2 of copper (ST, its data sheet); measure yours.
constexpr DriverHeat kDriverHeat = {0.48f, 0.25f, 36.0f, 1.0f, 125.0f};

}  // namespace board
}  // namespace firmware
}  // namespace tensionlab
