// The AS5048A on the spool, as the sensor that SimpleFOC asks.
#pragma once

#include <SPI.h>
#include <SimpleFOC.h>

#include "as5048a.hpp"
#include "board.hpp"

namespace tensionlab {
namespace firmware {

class SpoolEncoder : public Sensor {
 public:
  void begin() {
    pinMode(board::kSelectEncoder, OUTPUT);
    digitalWrite(board::kSelectEncoder, HIGH);
    SPI.begin(board::kClock, board::kFromEncoder, board::kToEncoder, -1);
    for (int i = 0; i < 4; ++i) update();  // diagnostics and an angle are there after these
    velocity = 0.0f;
    vel_angle_prev = angle_prev;
    vel_full_rotations = full_rotations;
    vel_angle_prev_ts = angle_prev_ts;
  }

  // Called by SimpleFOC in each turn of its loop. Where the angle did not come, the old one stays.
  void update() override {
    ok_ = chip_.read([](uint16_t frame) { return exchange(frame); });
    angle_prev_ts = static_cast<long>(micros());
    angle_prev = kRadians * static_cast<float>(chip_.raw());
    full_rotations = (chip_.count() - chip_.raw()) / As5048a::kCountsPerTurn;
  }

  bool ok() const { return ok_; }
  const As5048a& chip() const { return chip_; }

 protected:
  float getSensorAngle() override { return kRadians * static_cast<float>(chip_.raw()); }

 private:
  static constexpr float kRadians = 6.2831853f / static_cast<float>(As5048a::kCountsPerTurn);

  // One frame each way: mode 1, and the chip wants to rest for 350 ns between frames and before the first bit.
  static uint16_t exchange(uint16_t frame) {
    SPI.beginTransaction(SPISettings(board::kEncoderClock, MSBFIRST, SPI_MODE1));
    digitalWrite(board::kSelectEncoder, LOW);
    delayMicroseconds(1);
    const uint16_t answer = SPI.transfer16(frame);
    digitalWrite(board::kSelectEncoder, HIGH);
    SPI.endTransaction();
    delayMicroseconds(1);
    return answer;
  }

  As5048a chip_;
  bool ok_ = false;
};

}  // namespace firmware
}  // namespace tensionlab
