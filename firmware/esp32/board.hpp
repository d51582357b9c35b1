// One board: an ESP32-DevKitC (ESP32-WROOM-32E) beside a SimpleFOC shield, and a GM3506 motor. Every pin and every
// number of the hardware that no parameter holds is here or in the shield's own file; README.md has the pins as a
// wiring table.
#pragma once

#include <stdint.h>

// The shield's main version: 2 (published), 3 or 4. platformio.ini has an environment for each.
#ifndef TENSIONLAB_SHIELD
#define TENSIONLAB_SHIELD 2
#endif
#if TENSIONLAB_SHIELD == 2
#include "boards/shield_2.hpp"
#elif TENSIONLAB_SHIELD == 3
#include "boards/shield_3.hpp"
#elif TENSIONLAB_SHIELD == 4
#include "boards/shield_4.hpp"
#else
#error "TENSIONLAB_SHIELD is 2, 3 or 4: firmware/esp32/boards has a file for each"
#endif

namespace tensionlab {
namespace firmware {
namespace board {

// Encoder (AS5048A).
constexpr Pin kClock = 18, kFromEncoder = 19, kToEncoder = 23, kSelectEncoder = 5;
constexpr uint32_t kConversionTime = 100;    // us at most; a conversion takes 10
constexpr uint32_t kEncoderClock = 8000000;  // Hz; the chip takes 10 MHz

// A thermistor on the motor's housing, if there is one (parameter thermistor_resistance): from here to ground,
// with 100 nF beside it, which this pin needs because the converter disturbs it.
constexpr Pin kThermistor = 36;
constexpr float kThermistorPullUp = 10000.0f;  // ohm, from here to 3.3 V

// The board's own button (BOOT): pressed while nothing pulls, it lets strangers pair for a while.
constexpr Pin kPairButton = 0;
#ifndef TENSIONLAB_PAIRING_S
#define TENSIONLAB_PAIRING_S 60
#endif
constexpr int32_t kPairingTime = 1000000 * TENSIONLAB_PAIRING_S;  // us

// Servo of the brake (DS2312).
constexpr Pin kServo = 13;
constexpr uint32_t kServoRate = 50;  // Hz
constexpr uint8_t kServoBits = 16;

// Motor (GM3506) and its control.
constexpr int kPolePairs = 11;
constexpr float kPhaseResistance = 2.8f;      // ohm, at 20 °C
constexpr float kWarmResistance = 3.2f;       // ohm, at 60 °C: between a cold winding and one at its limit
constexpr float kPhaseInductance = 0.00125f;  // H: 0.5 to 2 mH, by type and angle
constexpr float kNominalSupply = 12.0f;       // V
constexpr float kVoltageLimit = 6.9f;         // V across a phase: the supply over the square root of 3
constexpr float kAlignVoltage = 2.0f;         // V, to find the electrical zero: some 0.7 A
constexpr long kPwmRate = 25000;              // Hz
// Proportional and integral gain and filter for a current loop of 2 ms (inductance and resistance over that);
// values to start from, which nobody has tried on the motor yet.
constexpr float kCurrentP = 0.5f, kCurrentI = 1400.0f, kCurrentFilter = 0.0005f;
constexpr float kSpeedFilter = 0.002f;  // s

// The two processors: Bluetooth's tasks run on the first one anyway.
constexpr int kLinkCore = 0, kFocCore = 1;
constexpr uint32_t kFocPriority = 20, kLinkPriority = 5;
constexpr uint32_t kStack = 8192;  // bytes, each task
// Longest time without a turn of the FOC loop, in ms: the watchdog then takes the driver off, and the module
// starts afresh. With the driver off, flash may be written meanwhile, which halts both processors.
constexpr uint32_t kDrivenWatchdog = 20, kIdleWatchdog = 1000;
constexpr unsigned long kBaud = 921600;  // of USB

}  // namespace board
}  // namespace firmware
}  // namespace tensionlab
