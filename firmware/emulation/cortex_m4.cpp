// The bench on an emulated Cortex-M4F (qemu-system-arm -M mps2-an386 -icount shift=5): vectors, counter, text.
//
// One instruction takes 32 ns of the emulated clock, and SysTick counts 25 MHz: 4 ticks are 5 instructions.
#include <cstdint>

extern "C" {
extern unsigned char stack_end_[], stack_top_[], data_start_[], data_end_[], data_load_[], bss_start_[],
    bss_end_[];
extern void (*init_start_[])(), (*init_end_[])();
int bench(void);

uint32_t platform_instructions(uint32_t ticks) { return ticks * 5 / 4; }
extern unsigned char* const platform_stack_end = stack_end_;

static volatile uint32_t* const kSysTick = reinterpret_cast<volatile uint32_t*>(0xE000E010);

uint32_t platform_ticks(void) { return 0xFFFFFF - kSysTick[2]; }

static int semihost(int call, const void* argument) {
  register int r0 __asm__("r0") = call;
  register const void* r1 __asm__("r1") = argument;
  __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

void platform_write(const char* text, unsigned size) {
  for (unsigned i = 0; i < size; ++i) semihost(3, text + i);  // SYS_WRITEC
}

__attribute__((noreturn)) void reset() {
  *reinterpret_cast<volatile uint32_t*>(0xE000ED88) |= 0xFU << 20;  // the floating point unit
  __asm__ volatile("dsb\n isb");
  for (unsigned char *to = data_start_, *from = data_load_; to < data_end_;) *to++ = *from++;
  for (unsigned char* to = bss_start_; to < bss_end_;) *to++ = 0;
  for (void (**call)() = init_start_; call < init_end_; ++call) (*call)();
  kSysTick[1] = 0xFFFFFF;
  kSysTick[2] = 0;
  kSysTick[0] = 5;
  bench();
  semihost(0x18, reinterpret_cast<const void*>(0x20026));  // SYS_EXIT, ended
  for (;;) {
  }
}

void fault() {
  for (const char* text = "fault\n"; *text != 0; ++text) platform_write(text, 1);
  semihost(0x18, nullptr);
  for (;;) {
  }
}
}

__attribute__((section(".vectors"), used)) const void* const vectors[16] = {
    stack_top_,
    reinterpret_cast<const void*>(&reset),
    reinterpret_cast<const void*>(&fault),
    reinterpret_cast<const void*>(&fault),
    reinterpret_cast<const void*>(&fault),
    reinterpret_cast<const void*>(&fault),
    reinterpret_cast<const void*>(&fault),
};
