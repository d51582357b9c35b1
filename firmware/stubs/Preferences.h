// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <stddef.h>

class Preferences {
 public:
  bool begin(const char* name, bool read_only = false);
  void end();
  size_t getBytesLength(const char* key);
  size_t getBytes(const char* key, void* bytes, size_t room);
  size_t putBytes(const char* key, const void* bytes, size_t size);
};
