// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <stdint.h>

#define GPIO_OUT1_W1TC_REG 0x3FF44018u
void REG_WRITE(uint32_t reg, uint32_t value);
