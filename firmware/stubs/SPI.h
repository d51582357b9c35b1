// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <Arduino.h>

constexpr uint8_t MSBFIRST = 1, SPI_MODE1 = 1;

class SPISettings {
 public:
  SPISettings(uint32_t clock, uint8_t order, uint8_t mode);
};

class SPIClass {
 public:
  bool begin(int8_t clock, int8_t in, int8_t out, int8_t select);
  void beginTransaction(SPISettings settings);
  uint16_t transfer16(uint16_t frame);
  void endTransaction();
};
extern SPIClass SPI;
