// The parameters in flash. Writing stops both processors for up to a tenth of a second: only when the core asks
// for it, which it does with the driver off.
#pragma once

#include <Preferences.h>

#include "../core/module.hpp"

namespace tensionlab {
namespace firmware {

// False if there are none, or if they are damaged; the module then keeps its standard ones.
inline bool load_settings(Module& module) {
  uint8_t image[Parameters::kImageSize];
  Preferences flash;
  if (!flash.begin("tensionlab", true)) return false;
  const size_t size =
      flash.getBytesLength("parameters") == sizeof image ? flash.getBytes("parameters", image, sizeof image) : 0;
  flash.end();
  return module.load(image, size);
}

inline bool store_settings(const Parameters& parameters) {
  uint8_t image[Parameters::kImageSize];
  parameters.write_image(image);
  Preferences flash;
  if (!flash.begin("tensionlab", false)) return false;
  const bool stored = flash.putBytes("parameters", image, sizeof image) == sizeof image;
  flash.end();
  return stored;
}

}  // namespace firmware
}  // namespace tensionlab
