// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#define RTC_NOINIT_ATTR
