// What the simulated hardware is made of, as a table.
//
// kPlantTable says where each number comes from: data sheets, the published module (1.5 N at 0.5 A, a one-way
// brake of 186 N; Bartels et al. 2026), or an estimate where no source gives one.
#pragma once

namespace tensionlab {
namespace plant {

struct PlantParameters {
  double resistance, inductance, torque_constant, zero_error, supply;
  double radius, inertia, dry_friction, viscous_friction, cogging, cogging_periods;
  double stiffness, damping, cable_strength;
  double brake_strength, tooth, servo_time;
  double encoder_counts, encoder_noise, speed_filter, current_noise, current_count, supply_noise;
  double ambient, winding_to_housing, housing_to_ambient, winding_capacity, housing_capacity;
  double driver_resistance, driver_idle_power, driver_to_ambient, driver_capacity;
};

struct PlantInfo {
  const char* name;
  double PlantParameters::* member;
  const char* unit;
  double lower, standard;
  const char* about;
};

inline constexpr PlantInfo kPlantTable[] = {
    {"resistance", &PlantParameters::resistance, "ohm", 0.01, 2.8, "of a motor phase at 20 °C; GM3506 data sheet"},
    {"inductance", &PlantParameters::inductance, "H", 1e-6, 1.0e-3, "of a motor phase; estimate"},
    {"torque_constant", &PlantParameters::torque_constant, "N m/A", 1e-4, 0.0585, "8.3 / KV at KV 142"},
    {"zero_error", &PlantParameters::zero_error, "rad", -6.3, 0.0,
     "of the electrical angle that the module was aligned to"},
    {"supply", &PlantParameters::supply, "V", 0.0, 12.0, "of the three half-bridges"},
    {"radius", &PlantParameters::radius, "m", 0.001, 0.0195, "of the spool, from 3 N/A as published"},
    {"inertia", &PlantParameters::inertia, "kg m2", 1e-7, 1.2e-5, "of rotor and spool; estimate"},
    {"dry_friction", &PlantParameters::dry_friction, "N", 0.0, 0.05, "at the cable; estimate"},
    {"viscous_friction", &PlantParameters::viscous_friction, "N s/m", 0.0, 0.05, "at the cable; estimate"},
    {"cogging", &PlantParameters::cogging, "N", 0.0, 0.03, "at the cable; estimate"},
    {"cogging_periods", &PlantParameters::cogging_periods, "1", 0.0, 264.0, "a turn: 24 slots, 22 poles"},
    {"stiffness", &PlantParameters::stiffness, "N/m", 0.0, 4000.0, "of cable and attachments; estimate"},
    {"damping", &PlantParameters::damping, "N s/m", 0.0, 3.0, "of the cable; estimate"},
    {"cable_strength", &PlantParameters::cable_strength, "N", 1.0, 500.0, "at which the cable snaps; estimate"},
    {"brake_strength", &PlantParameters::brake_strength, "N", 0.0, 186.0,
     "beyond which the pawl slips; as published"},
    {"tooth", &PlantParameters::tooth, "m", 1e-4, 0.003, "of cable from tooth to tooth; estimate"},
    {"servo_time", &PlantParameters::servo_time, "s", 1e-3, 0.05, "of the brake servo from end to end; estimate"},
    {"encoder_counts", &PlantParameters::encoder_counts, "1", 16.0, 16384.0, "a turn: AS5048A, 14 bit"},
    {"encoder_noise", &PlantParameters::encoder_noise, "counts", 0.0, 1.0, "standard deviation; estimate"},
    {"speed_filter", &PlantParameters::speed_filter, "s", 0.0, 2.0e-3,
     "time constant of the measured speed; estimate"},
    {"current_noise", &PlantParameters::current_noise, "A", 0.0, 0.005, "standard deviation; estimate"},
    {"current_count", &PlantParameters::current_count, "A", 1e-6, 0.0016, "a count: 3.3 A either way in 12 bits"},
    {"supply_noise", &PlantParameters::supply_noise, "V", 0.0, 0.05, "standard deviation; estimate"},
    {"ambient", &PlantParameters::ambient, "°C", -20.0, 25.0, "of the room"},
    // No data sheet of a gimbal motor has these: they are those of a motor of the same size.
    {"winding_to_housing", &PlantParameters::winding_to_housing, "K/W", 0.1, 3.96,
     "of a motor of this size: maxon EC 45 flat, 30 W, data sheet of 2012"},
    {"housing_to_ambient", &PlantParameters::housing_to_ambient, "K/W", 0.1, 5.7, "the same"},
    {"winding_capacity", &PlantParameters::winding_capacity, "J/K", 0.1, 2.9, "the same: 11.5 s over 3.96 K/W"},
    {"housing_capacity", &PlantParameters::housing_capacity, "J/K", 0.1, 32.0,
     "estimate: 251 s over 5.7 K/W would be 44, of a heavier motor"},
    {"driver_resistance", &PlantParameters::driver_resistance, "ohm", 0.0, 0.3, "of a switch at 25 °C; L6234"},
    {"driver_idle_power", &PlantParameters::driver_idle_power, "W", 0.0, 0.2, "with switching; estimate"},
    {"driver_to_ambient", &PlantParameters::driver_to_ambient, "K/W", 0.1, 30.0, "with its copper; estimate"},
    {"driver_capacity", &PlantParameters::driver_capacity, "J/K", 0.01, 1.5, "with its copper; estimate"},
};

inline PlantParameters standard_plant() {
  PlantParameters parameters;
  for (const PlantInfo& info : kPlantTable) parameters.*info.member = info.standard;
  return parameters;
}

}  // namespace plant
}  // namespace tensionlab
