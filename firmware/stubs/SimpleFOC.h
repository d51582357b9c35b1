// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <Arduino.h>

// Of version 2.3.5, names and types as there.
#define NOT_SET -12345.0f
#define _NC ((int)NOT_SET)

enum MotionControlType : uint8_t { torque = 0x00, velocity = 0x01, angle = 0x02 };
enum TorqueControlType : uint8_t { voltage = 0x00, dc_current = 0x01, foc_current = 0x02 };
enum FOCModulationType : uint8_t { SinePWM = 0x00, SpaceVectorPWM = 0x01 };
enum Direction : int8_t { CW = 1, CCW = -1, UNKNOWN = 0 };

struct DQCurrent_s {
  float d, q;
};
struct DQVoltage_s {
  float d, q;
};
struct PhaseCurrent_s {
  float a, b, c;
};
struct ABCurrent_s {
  float alpha, beta;
};

class Sensor {
 public:
  virtual ~Sensor() = default;
  virtual float getAngle();
  virtual void update();

 protected:
  virtual float getSensorAngle() = 0;
  float velocity = 0.0f, angle_prev = 0.0f;
  long angle_prev_ts = 0;
  float vel_angle_prev = 0.0f;
  long vel_angle_prev_ts = 0;
  int32_t full_rotations = 0, vel_full_rotations = 0;
};

class PIDController {
 public:
  PIDController(float P, float I, float D, float ramp, float limit);
  float P, I, D, output_ramp, limit;
};

class LowPassFilter {
 public:
  LowPassFilter(float Tf);
  float Tf;
};

class FOCDriver {
 public:
  virtual ~FOCDriver() = default;
  long pwm_frequency;
  float voltage_power_supply, voltage_limit;
};

class BLDCDriver : public FOCDriver {};

class BLDCDriver3PWM : public BLDCDriver {
 public:
  BLDCDriver3PWM(int a, int b, int c, int enable_a = _NC, int enable_b = _NC, int enable_c = _NC);
  int init();
};

class CurrentSense {
 public:
  virtual ~CurrentSense() = default;
  void linkDriver(FOCDriver* driver);
  ABCurrent_s getABCurrents(PhaseCurrent_s current);
  virtual PhaseCurrent_s getPhaseCurrents() = 0;
  bool skip_align = false;
  float gain_a, gain_b, gain_c;
  float offset_ia, offset_ib, offset_ic;
};

class InlineCurrentSense : public CurrentSense {
 public:
  InlineCurrentSense(float shunt, float gain, int a, int b, int c = _NC);
  int init();
  PhaseCurrent_s getPhaseCurrents() override;
};

class FOCMotor {
 public:
  virtual ~FOCMotor() = default;
  void linkSensor(Sensor* sensor);
  void linkCurrentSense(CurrentSense* sense);
  float shaft_velocity;
  DQCurrent_s current;
  DQVoltage_s voltage;
  float voltage_sensor_align, voltage_limit, current_limit, zero_electric_angle;
  FOCModulationType foc_modulation;
  TorqueControlType torque_controller;
  MotionControlType controller;
  PIDController PID_current_q{3, 300, 0, 0, 12}, PID_current_d{3, 300, 0, 0, 12};
  LowPassFilter LPF_current_q{0.005f}, LPF_current_d{0.005f}, LPF_velocity{0.005f};
  Direction sensor_direction;
};

class BLDCMotor : public FOCMotor {
 public:
  BLDCMotor(int pole_pairs, float resistance = NOT_SET, float kv = NOT_SET, float inductance = NOT_SET);
  void linkDriver(BLDCDriver* driver);
  int init();
  int initFOC();
  void loopFOC();
  void move(float target = NOT_SET);
  void enable();
  void disable();
  void setPhaseVoltage(float q, float d, float electrical);
};

void* _configureADCInline(const void* driver, const int a, const int b, const int c = _NC);
