// SimpleFOC shield v3.2: DRV8313 driver, ACS712 Hall sensors in two phases.
// Source: schematic of 2024-06-23 in the maker's repository (simplefoc/Arduino-SimpleFOCShield, tag v3.2), and
// docs.simplefoc.com/pads_soldering_v3. Not tried on one.
#pragma once

#include <stdint.h>

#include "../../core/thermal.hpp"

namespace tensionlab {
namespace firmware {
namespace board {

using Pin = uint8_t;

// Motor driver. 4.7 kOhm on the enable pin keep it off while the ESP32 starts; its sleep and reset pins are pulled
// up on the shield, so that enabled it drives at once.
constexpr Pin kPhaseA = 25;                 // header pad 6
constexpr Pin kPhaseB = 26;                 // header pad 10
constexpr Pin kPhaseC = 27;                 // header pad 5
constexpr Pin kEnable = 33;                 // header pad 8
constexpr uint32_t kWakeTime = 0;           // us, from enable until the driver drives
constexpr float kBridgeResistance = 0.34f;  // ohm: 0.24 of a switch (DRV8313), and the wires
constexpr float kCurrentLimit = 2.2f;       // A, whatever the parameters say: the DRV8313 takes 2.5 A at its peak

// Current sensing of two phases, and the motor supply behind a divider of one's own: the shield has none.
constexpr Pin kSenseA = 34;  // header pad A0
constexpr Pin kSenseB = 35;  // header pad A2
constexpr Pin kSupply = 32;  // own divider, R1 and R2
// ACS712-05B: 0.185 V/A at 5 V, in proportion to its supply, which for an ESP32 is 3.3 V (pad VDD). Its data sheet
// has 4.5 V and more only: measure yours. CALIBRATE of the encoder refuses what is far off.
constexpr float kVoltsPerAmpere = 0.185f * 3.3f / 5.0f;
constexpr float kSenseSignA = 1.0f;
constexpr float kSenseSignB = 1.0f;      // both from the driver to the motor
constexpr float kSupplyDivider = 11.0f;  // 100 kOhm above 10 kOhm

// DRV8313: 0.24 ohm cold; it switches itself off at 150 °C. The thermal resistance is that on its maker's test
// board, from memory of the data sheet: measure yours.
constexpr DriverHeat kDriverHeat = {0.36f, 0.25f, 32.0f, 1.0f, 125.0f};

}  // namespace board
}  // namespace firmware
}  // namespace tensionlab
