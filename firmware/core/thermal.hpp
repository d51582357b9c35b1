// How warm winding, housing and driver are, and how much current they stand.
//
// The winding warms its housing, and that the room: two bodies, as in motors' data sheets. The driver with its
// copper is a third. All parameters are on the warm side of what is known, so that the estimate is not colder than
// the truth; firmware/ratings.py holds it against random hardware.
#pragma once

#include "numbers.hpp"
#include "parameters.hpp"

namespace tensionlab {
namespace firmware {

// The driver on its board, by whoever knows the board; without a resistance it stays as it is.
struct DriverHeat {
  float resistance;          // ohm, of a switch, warm
  float idle_power;          // W, and what switching takes
  float thermal_resistance;  // K/W, from the junction to the room
  float heat_capacity;       // J/K
  float limit;               // °C
};

class ThermalModel {
 public:
  // Magic, temperatures, CRC.
  static constexpr size_t kImageSize = 4 + 3 * 4 + 2;

  explicit ThermalModel(const DriverHeat& driver) : driver_(driver) { assume_cold(Parameters()); }

  // As warm as the room.
  void assume_cold(const Parameters& p) {
    set(p[Parameter::ambient], p[Parameter::ambient], p[Parameter::ambient]);
  }

  // Nobody knows what they went through: as warm as they can be in the long run.
  void assume_hot(const Parameters& p) {
    const float limit = p[Parameter::winding_limit];
    const float power = p.copper(limit) * p.continuous_square();
    set(limit, p[Parameter::ambient] + power * p[Parameter::housing_to_ambient],
        larger(driver_.limit, p[Parameter::ambient]));
    assumed_ = true;
  }

  // By its amplitude, so that the winding's power is 3/2 of resistance times squared current.
  void advance(float current, float seconds, const Parameters& p) {
    charge_ += current * current * seconds;
    elapsed_ += seconds;
    // A step changes less than single precision can tell.
    if (elapsed_ < kBlock) return;
    const float square = charge_ / elapsed_, ambient = p[Parameter::ambient];
    const float inward = (winding_ - housing_) / p[Parameter::winding_to_housing];
    const float outward = (housing_ - ambient) / p[Parameter::housing_to_ambient];
    winding_ += elapsed_ * (p.copper(winding_) * square - inward) / p[Parameter::winding_capacity];
    housing_ += elapsed_ * (inward - outward) / p[Parameter::housing_capacity];
    if (driver_.resistance > 0.0f) {
      const float power = driver_.idle_power + 1.5f * driver_.resistance * square;
      driver_temperature_ += elapsed_ * (power - (driver_temperature_ - ambient) / driver_.thermal_resistance) /
                             driver_.heat_capacity;
    }
    charge_ = elapsed_ = 0.0f;
  }

  // What a thermistor on the housing says, °C. Colder than estimated is believed only where the estimate was an
  // assumption: a thermistor that has come off must not make the motor pull more.
  void correct(float measured) {
    constexpr float kMargin = 3.0f;  // K: of the thermistor, and from where it sits
    if (assumed_) housing_ = smaller(housing_, measured + kMargin);
    assumed_ = false;
    housing_ = larger(housing_, measured);
  }

  // The largest current that all stand now, in A, so that none passes its limit: it sinks smoothly to what they
  // stand for good. With `haste` below 1 it begins to sink sooner.
  float current_limit(const Parameters& p, float haste = 1.0f) const {
    const float winding =
        (winding_ - housing_) / p[Parameter::winding_to_housing] +
        haste * p[Parameter::winding_capacity] * (p[Parameter::winding_limit] - winding_) / kApproach;
    float square = winding / p.copper(winding_);
    if (driver_.resistance > 0.0f) {
      const float driver = (driver_temperature_ - p[Parameter::ambient]) / driver_.thermal_resistance +
                           haste * driver_.heat_capacity * (driver_.limit - driver_temperature_) / kApproach;
      square = smaller(square, (driver - driver_.idle_power) / (1.5f * driver_.resistance));
    }
    return smaller(square_root(square), p[Parameter::current_peak]);
  }

  // The current that they stand for good, in A.
  float continuous(const Parameters& p) const {
    ThermalModel hot = *this;
    hot.assume_hot(p);
    return hot.current_limit(p);
  }

  float winding() const { return winding_; }  // °C
  float housing() const { return housing_; }
  float driver() const { return driver_temperature_; }

  // To keep over a reset.
  void write_image(uint8_t (&image)[kImageSize]) const {
    Writer writer(image);
    writer.u32(kMagic);
    writer.f32(winding_);
    writer.f32(housing_);
    writer.f32(driver_temperature_);
    writer.u16(crc16(image, kImageSize - 2));
  }

  // Takes over what was kept, if it is whole; leaves all as it was otherwise. No cooling since is assumed, and the
  // winding warmed on until the driver went off.
  bool read_image(const uint8_t (&image)[kImageSize]) {
    constexpr float kLate = 1.0f;  // K
    Reader reader(image, kImageSize);
    if (reader.u32() != kMagic) return false;
    const float winding = reader.f32(), housing = reader.f32(), driver = reader.f32();
    if (reader.u16() != crc16(image, kImageSize - 2)) return false;
    if (!is_finite(winding) || !is_finite(housing) || !is_finite(driver)) return false;
    set(winding + kLate, housing, driver + kLate);
    return true;
  }

 private:
  static constexpr uint32_t kMagic = 0x54414548;  // "HEAT"
  static constexpr float kBlock = 0.01f;          // s
  static constexpr float kApproach = 2.0f;        // s, in which the rest of the way to a limit is gone to 1/e

  void set(float winding, float housing, float driver) {
    winding_ = winding;
    housing_ = housing;
    driver_temperature_ = driver;
    assumed_ = false;
  }

  DriverHeat driver_;
  float winding_ = 0.0f, housing_ = 0.0f, driver_temperature_ = 0.0f;  // °C
  float charge_ = 0.0f, elapsed_ = 0.0f;                               // A² s and s since the last block
  bool assumed_ = false;
};

}  // namespace firmware
}  // namespace tensionlab
