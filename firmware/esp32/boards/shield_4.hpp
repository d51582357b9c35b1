// SimpleFOC shield v4.1: DRV8316 driver, INA240 amplifiers in two phases, and a divider for the supply.
// Source: docs.simplefoc.com/pads_soldering_v4 and the maker's notes on release v4.1. Its schematic was not
// available: what is marked so is not confirmed. Not tried on one.
#pragma once

#include <stdint.h>

#include "../../core/thermal.hpp"

namespace tensionlab {
namespace firmware {
namespace board {

using Pin = uint8_t;

// Motor driver. The enable pin also wakes it from sleep. Measure that it is low while the ESP32 starts: what keeps
// it there is not confirmed.
constexpr Pin kPhaseA = 25;           // header pad 6
constexpr Pin kPhaseB = 26;           // header pad 10
constexpr Pin kPhaseC = 27;           // header pad 5
constexpr Pin kEnable = 33;           // header pad 8
constexpr uint32_t kWakeTime = 5000;  // us, from enable until the driver drives: not confirmed, measure yours
constexpr float kBridgeResistance = 0.15f;  // ohm: 0.05 of a switch (DRV8316), and the wires
constexpr float kCurrentLimit = 2.5f;       // A, whatever the parameters say: what the motor and its supply take

// Current sensing of two phases, and the motor supply behind the shield's own divider.
constexpr Pin kSenseA = 34;  // header pad A0
constexpr Pin kSenseB = 35;  // header pad A2
constexpr Pin kSupply = 32;  // header pad A3
// Not confirmed, measure yours: the marks on shunts and amplifiers (INA240A1: 20 V/V, A2: 50) say the gain, and
// CALIBRATE of the encoder refuses a gain that is far off, and a wrong sign.
constexpr float kShunt = 0.010f;  // ohm
constexpr float kVoltsPerAmpere = 50.0f * kShunt;
constexpr float kSenseSignA = 1.0f;
constexpr float kSenseSignB = 1.0f;
constexpr float kSupplyDivider = 11.0f;  // as on the maker's DriveShield; measure yours

// DRV8316: 0.05 ohm cold; it switches itself off at 150 °C. The thermal resistance is that on its maker's test
// board, from memory of the data sheet: measure yours.
constexpr DriverHeat kDriverHeat = {0.08f, 0.25f, 26.0f, 1.0f, 125.0f};

}  // namespace board
}  // namespace firmware
}  // namespace tensionlab
