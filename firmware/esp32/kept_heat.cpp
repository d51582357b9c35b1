#include "kept_heat.hpp"

#include <esp_attr.h>

namespace tensionlab {
namespace firmware {

RTC_NOINIT_ATTR uint8_t kept_heat[ThermalModel::kImageSize];

}  // namespace firmware
}  // namespace tensionlab
