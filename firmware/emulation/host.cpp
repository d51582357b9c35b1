// The bench on this computer: it has no instruction counter and no stack to look at.
#include <cstdint>
#include <cstdio>

extern "C" {
int bench(void);
uint32_t platform_instructions(uint32_t) { return 0; }
extern unsigned char* const platform_stack_end = nullptr;
uint32_t platform_ticks(void) { return 0; }
void platform_write(const char* text, unsigned size) { std::fwrite(text, 1, size, stdout); }
}

int main() { return bench(); }
