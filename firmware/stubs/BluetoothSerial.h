// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. tests/data/esp32_fakes.cpp has something to run behind it.
#pragma once

#include <Arduino.h>

class BluetoothSerial : public Stream {
 public:
  bool begin(String name = String(), bool master = false, bool without_low_energy = false);
  void enableSSP();
  bool hasClient();
  int available() override;
  size_t write(uint8_t byte) override;
  size_t write(const uint8_t* bytes, size_t size) override;
};
