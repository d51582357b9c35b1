// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <stdint.h>

typedef int BaseType_t;
typedef unsigned int UBaseType_t;
typedef uint32_t TickType_t;
constexpr BaseType_t pdPASS = 1;
