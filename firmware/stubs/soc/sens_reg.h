// Not a library: declares just what firmware/esp32 uses of one, so that its syntax and types can be checked
// without the vendor's toolchain. firmware/fakes has something to run behind it.
#pragma once

#include <stdint.h>

#define SENS_SAR_MEAS_START1_REG 0x3FF48854u
#define SENS_MEAS1_START_SAR_M (1u << 17)
#define SENS_MEAS1_DONE_SAR (1u << 16)
#define SENS_SAR1_EN_PAD 0xFFFu
#define SENS_SAR1_EN_PAD_S 19
#define SENS_MEAS1_DATA_SAR 0xFFFFu
#define SENS_MEAS1_DATA_SAR_S 0
void SET_PERI_REG_MASK(uint32_t reg, uint32_t mask);
void CLEAR_PERI_REG_MASK(uint32_t reg, uint32_t mask);
void SET_PERI_REG_BITS(uint32_t reg, uint32_t bits, uint32_t value, int shift);
uint32_t GET_PERI_REG_MASK(uint32_t reg, uint32_t mask);
uint32_t GET_PERI_REG_BITS2(uint32_t reg, uint32_t mask, int shift);
