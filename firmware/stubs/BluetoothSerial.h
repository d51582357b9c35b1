// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <Arduino.h>

// Of version 3 of the Arduino core. With no callback that confirms, the module pairs by itself only if it
// announces neither input nor output; by default it announces both, and the core answers "refusing pairing".

class BluetoothSerial : public Stream {
 public:
  bool begin(String name = String(), bool master = false, bool without_low_energy = false);
  void enableSSP(bool input, bool output);
  bool hasClient();
  int available() override;
  size_t write(uint8_t byte) override;
  size_t write(const uint8_t* bytes, size_t size) override;
};
