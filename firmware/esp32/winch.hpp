// Motor, driver, current sensing and encoder of the winch: SimpleFOC's loop, and what the core wants of it.
//
// The enable pin of the driver is not SimpleFOC's but ours: its set-up would switch the driver on, and a module
// must start without pulling.
#pragma once

#include "../core/module.hpp"
#include "alignment.hpp"
#include "board.hpp"
#include "spool_encoder.hpp"

namespace tensionlab {
namespace firmware {

class Winch {
 public:
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

  // To find the electrical zero: a voltage that turns as told instead of currents.
  void hold(const Alignment::Wanted& wanted);
  Alignment::Measured measure_alignment();
  void let_go();

 private:
  void switch_driver(bool on);

  BLDCMotor motor_{board::kPolePairs};
  BLDCDriver3PWM driver_{board::kPhaseA, board::kPhaseB, board::kPhaseC};
  InlineCurrentSense sense_{board::kShunt, board::kSenseGain, board::kSenseA, board::kSenseB};
  SpoolEncoder encoder_;
  void* supply_input_ = nullptr;
  float supply_ = 0.0f, target_ = 0.0f;
  uint8_t turns_ = 0;
  bool started_ = false, on_ = false;
};

}  // namespace firmware
}  // namespace tensionlab
