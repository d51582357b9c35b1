// How warm motor and driver are, in memory that a reset leaves as it is, though not a loss of power: what is there
// then fails its checksum. The memory is written in each 64th turn of the loop, some 16 ms apart.
// Source: Espressif, ESP-IDF Programming Guide, "Memory Types": RTC_NOINIT_ATTR.
#pragma once

#include "../core/module.hpp"

namespace tensionlab {
namespace firmware {

extern uint8_t kept_heat[ThermalModel::kImageSize];

inline void keep_heat(const ThermalModel& heat) { heat.write_image(kept_heat); }

// Where nothing was kept, all are as warm as they can be: the clock does not tell for how long the power was off.
inline void recall_heat(Module& module) {
  if (!module.heat().read_image(kept_heat)) module.assume_hot();
}

}  // namespace firmware
}  // namespace tensionlab
