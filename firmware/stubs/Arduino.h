// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "freertos/FreeRTOS.h"
#include "freertos/task.h"

#define LOW 0x0
#define HIGH 0x1
#define OUTPUT 0x03
#define INPUT_PULLUP 0x05
#define IRAM_ATTR
// Names that the real one takes away from everybody.
#define PI 3.1415926535897932384626433832795
#define TWO_PI 6.283185307179586476925286766559
#define DISABLED 0x00
#define DEFAULT 1
#define F(text) (text)
#define bit(number) (1UL << (number))
#define sq(x) ((x) * (x))
#define constrain(x, low, high) ((x) < (low) ? (low) : ((x) > (high) ? (high) : (x)))
#define radians(degrees) ((degrees) * 0.017453292519943295769236907684886)
#define lowByte(word) ((uint8_t)((word) & 0xff))
#define interrupts() sei()

void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t value);
int digitalRead(uint8_t pin);
int8_t digitalPinToAnalogChannel(uint8_t pin);
unsigned long micros();
void delayMicroseconds(uint32_t microseconds);
bool ledcAttach(uint8_t pin, uint32_t frequency, uint8_t resolution);
bool ledcWrite(uint8_t pin, uint32_t duty);

class String {
 public:
  String(const char* text = "");
};

class Stream {
 public:
  virtual ~Stream() = default;
  virtual int available() = 0;
  virtual size_t write(uint8_t byte) = 0;
  virtual size_t write(const uint8_t* bytes, size_t size);
  size_t readBytes(uint8_t* bytes, size_t size);
};

class HardwareSerial : public Stream {
 public:
  size_t setRxBufferSize(size_t size);
  size_t setTxBufferSize(size_t size);
  void begin(unsigned long baud);
  int available() override;
  size_t write(uint8_t byte) override;
  using Stream::write;
};
extern HardwareSerial Serial;

class EspClass {
 public:
  uint64_t getEfuseMac();
};
extern EspClass ESP;

void setup();
void loop();
