// Motor, driver, current sensing and encoder of the winch: SimpleFOC's loop, and what the core wants of it.
//
// The enable pin of the driver is not SimpleFOC's but ours: its set-up would switch the driver on, and a module
// must start without pulling.
#pragma once

#include <soc/gpio_reg.h>

#include "../core/module.hpp"
#include "alignment.hpp"
#include "board.hpp"
#include "current_sense.hpp"
#include "spool_encoder.hpp"

namespace tensionlab {
namespace firmware {

class Winch {
 public:
  // In the interrupt of the watchdog, where only registers may be touched.
  static void IRAM_ATTR cut() {
    static_assert(board::kEnable >= 32, "a pin of the second register");
    REG_WRITE(GPIO_OUT1_W1TC_REG, 1u << (board::kEnable - 32));
  }

  // The very first thing after a reset.
  static void driver_off() {
    pinMode(board::kEnable, OUTPUT);
    digitalWrite(board::kEnable, LOW);
  }

  // Takes some two seconds, with the driver off; false if a part of SimpleFOC did not start.
  bool begin();

  // One turn of the FOC loop, and what the sensors say after it.
  Sensors turn(const Parameters& parameters);

  // What the core decided in its step.
  void apply(const Actuators& actuators, const Parameters& parameters);

  // To find the electrical zero: a voltage that turns as told instead of currents. let_go() ends it.
  void hold(const Alignment::Wanted& wanted);
  Alignment::Measured measure_alignment();
  void let_go();

 private:
  void measure_slowly();

  static constexpr int32_t kRest = 200;  // until no current flows any more

  BLDCMotor motor_{board::kPolePairs};
  BLDCDriver3PWM driver_{board::kPhaseA, board::kPhaseB, board::kPhaseC};
  CurrentSensor sense_;
  SpoolEncoder encoder_;
  float supply_ = 0.0f, thermistor_ = 0.0f, target_ = 0.0f;
  float held_current_ = 0.0f;  // while the electrical zero is looked for, A
  uint8_t turns_ = 0;
  int32_t rested_ = 0;  // turns since the driver went off, up to kRest
  uint32_t enabled_us_ = 0;
  bool started_ = false, enabled_ = false, held_ = false;
  bool on_ = false;  // enabled and awake
};

}  // namespace firmware
}  // namespace tensionlab
