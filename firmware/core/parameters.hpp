// What can be set on a module, between which bounds, and the image of it that is stored.
//
// A parameter is a float known by its index; PROTOCOL.md and the host take names and bounds from this table.
#pragma once

#include "bytes.hpp"
#include "crc16.hpp"
#include "numbers.hpp"

namespace tensionlab {
namespace firmware {

enum class Parameter : uint8_t {
  tension_lower,
  tension_upper,
  slew,
  newton_per_ampere,
  friction_coulomb,
  friction_viscous,
  current_peak,
  ambient,
  winding_limit,
  winding_resistance,
  winding_to_housing,
  housing_to_ambient,
  winding_capacity,
  housing_capacity,
  thermistor_resistance,
  thermistor_beta,
  speed_limit,
  length_lower,
  length_upper,
  spool_radius,
  ttl,
  stiffness_limit,
  damping_limit,
  supply_lower,
  supply_upper,
  brake_open_pulse,
  brake_closed_pulse,
  brake_travel,
  brake_dwell,
  brake_tooth,
  brake_release_tension,
  timeout_brake,
  brake_on_fault,
  motor_direction,
  motor_zero,
  calibrated,
  count,
};

struct ParameterInfo {
  const char* name;
  const char* unit;
  float lower, upper, standard;
};

inline constexpr size_t kParameterCount = static_cast<size_t>(Parameter::count);

inline constexpr ParameterInfo kParameters[kParameterCount] = {
    {"tension_lower", "N", 0.1f, 2.0f, 0.5f},  // the minimum tension
    {"tension_upper", "N", 0.5f, 12.0f, 6.0f},
    {"slew", "N/s", 10.0f, 300.0f, 60.0f},  // so that every ramp ends before a timeout's second stage
    {"newton_per_ampere", "N/A", 0.5f, 12.0f, 3.0f},
    {"friction_coulomb", "N", 0.0f, 2.0f, 0.0f},  // at the cable, against its motion
    {"friction_viscous", "N s/m", 0.0f, 5.0f, 0.0f},
    {"current_peak", "A", 0.1f, 3.0f, 2.2f},
    // On the warm side of what is known of the motor; README.md has the sources.
    {"ambient", "°C", 0.0f, 50.0f, 30.0f},
    {"winding_limit", "°C", 60.0f, 180.0f, 100.0f},
    {"winding_resistance", "ohm", 0.05f, 50.0f, 3.0f},  // of a phase at 20 °C
    {"winding_to_housing", "K/W", 0.2f, 50.0f, 4.6f},
    {"housing_to_ambient", "K/W", 0.2f, 100.0f, 7.0f},
    {"winding_capacity", "J/K", 0.2f, 500.0f, 2.4f},
    {"housing_capacity", "J/K", 0.2f, 5000.0f, 27.0f},
    {"thermistor_resistance", "ohm", 0.0f, 200000.0f, 0.0f},  // at 25 °C; 0: none
    {"thermistor_beta", "K", 2000.0f, 6000.0f, 3950.0f},
    {"speed_limit", "m/s", 0.1f, 10.0f, 1.5f},  // reeling in; at 1.4 times this the module faults
    {"length_lower", "m", 0.0f, 10.0f, 0.05f},
    {"length_upper", "m", 0.1f, 20.0f, 5.0f},
    {"spool_radius", "m", 0.005f, 0.1f, 0.0195f},
    {"ttl", "ms", 50.0f, 2000.0f, 250.0f},
    {"stiffness_limit", "N/m", 0.0f, 2000.0f, 500.0f},
    {"damping_limit", "N s/m", 0.0f, 50.0f, 10.0f},
    {"supply_lower", "V", 3.0f, 24.0f, 8.0f},
    {"supply_upper", "V", 5.0f, 28.0f, 16.0f},
    {"brake_open_pulse", "us", 500.0f, 2500.0f, 1000.0f},
    {"brake_closed_pulse", "us", 500.0f, 2500.0f, 1500.0f},
    {"brake_travel", "ms", 5.0f, 1000.0f, 60.0f},      // of the servo, from one end to the other
    {"brake_dwell", "ms", 0.0f, 5000.0f, 100.0f},      // least time from one change to the next
    {"brake_tooth", "m", 0.0005f, 0.02f, 0.003f},      // of cable, from tooth to tooth
    {"brake_release_tension", "N", 0.5f, 6.0f, 2.0f},  // to reel the load off the pawl
    {"timeout_brake", "0 open, 1 as it is", 0.0f, 1.0f, 0.0f},
    {"brake_on_fault", "0 open, 1 closed", 0.0f, 1.0f, 0.0f},
    {"motor_direction", "1 or -1", -1.0f, 1.0f, 1.0f},  // of the encoder while the cable pays out
    {"motor_zero", "rad", 0.0f, 6.2831855f, 0.0f},      // electrical angle at the encoder's zero
    {"calibrated", "0 or 1", 0.0f, 1.0f, 0.0f},
};

// Parameters whose value is one of two, of which only those two make sense.
constexpr bool is_choice(Parameter index) {
  return index == Parameter::timeout_brake || index == Parameter::brake_on_fault ||
         index == Parameter::motor_direction || index == Parameter::calibrated;
}

class Parameters {
 public:
  // Magic, version, count, values, CRC.
  static constexpr size_t kImageSize = 4 + 2 + 2 + 4 * kParameterCount + 2;

  Parameters() {
    for (size_t i = 0; i < kParameterCount; ++i) values_[i] = kParameters[i].standard;
  }

  float operator[](Parameter index) const { return values_[static_cast<size_t>(index)]; }

  // Power of a squared current in all three phases, in ohm, of a winding at some °C.
  float copper(float celsius) const {
    constexpr float kCopper = 0.00393f;  // 1/K, of its resistance at 20 °C
    return 1.5f * (*this)[Parameter::winding_resistance] * (1.0f + kCopper * (celsius - 20.0f));
  }

  // The squared current that the winding stands for good, in A².
  float continuous_square() const {
    const Parameters& p = *this;
    const float celsius = p[Parameter::winding_limit];
    const float resistance = p[Parameter::winding_to_housing] + p[Parameter::housing_to_ambient];
    return (celsius - p[Parameter::ambient]) / (resistance * copper(celsius));
  }

  // Takes a value inside its bounds that agrees with the others; leaves all as it was otherwise.
  bool set(Parameter index, float value) {
    if (!allowed(index, value)) return false;
    const float before = (*this)[index];
    at(index) = value;
    if (consistent()) return true;
    at(index) = before;
    return false;
  }

  void write_image(uint8_t (&image)[kImageSize]) const {
    Writer writer(image);
    writer.u32(kMagic);
    writer.u16(kVersion);
    writer.u16(static_cast<uint16_t>(kParameterCount));
    for (const float value : values_) writer.f32(value);
    writer.u16(crc16(image, kImageSize - 2));
  }

  // Takes over a stored image if it is whole and every value is allowed; leaves all as it was otherwise.
  bool read_image(const uint8_t* image, size_t size) {
    if (size != kImageSize) return false;
    Reader reader(image, size);
    if (reader.u32() != kMagic || reader.u16() != kVersion || reader.u16() != kParameterCount) return false;
    Parameters stored;
    for (size_t i = 0; i < kParameterCount; ++i) {
      stored.values_[i] = reader.f32();
      if (!allowed(static_cast<Parameter>(i), stored.values_[i])) return false;
    }
    if (reader.u16() != crc16(image, kImageSize - 2) || !stored.consistent()) return false;
    *this = stored;
    return true;
  }

 private:
  static constexpr uint32_t kMagic = 0x424C4E54;  // "TNLB"
  static constexpr uint16_t kVersion = 2;

  static bool allowed(Parameter index, float value) {
    const ParameterInfo& info = kParameters[static_cast<size_t>(index)];
    if (!is_finite(value) || value < info.lower || value > info.upper) return false;
    return !is_choice(index) || value == info.lower || value == info.upper;
  }

  bool consistent() const {
    const Parameters& p = *this;
    // The minimum tension can be held for good.
    const float lowest = p[Parameter::tension_lower] / p[Parameter::newton_per_ampere];
    return p[Parameter::tension_lower] <= p[Parameter::tension_upper] && lowest * lowest <= continuous_square() &&
           p[Parameter::length_lower] < p[Parameter::length_upper] &&
           p[Parameter::supply_lower] < p[Parameter::supply_upper];
  }

  float& at(Parameter index) { return values_[static_cast<size_t>(index)]; }

  float values_[kParameterCount];
};

}  // namespace firmware
}  // namespace tensionlab
