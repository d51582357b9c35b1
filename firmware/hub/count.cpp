// Solves a list of problems as a bare program, without an operating system's library: cycles.py lets qemu run it,
// and counts what it does.
#include "problems.hpp"  // written by cycles.py

extern "C" int allocate_tensions(int cables, const float* structure, const float* wrench, const float* lower,
                                 const float* upper, float* tensions);

namespace {

// Linux's system calls for Arm, which qemu carries out.
long call(long number, long first, const void* second, long third) {
  register long r0 asm("r0") = first;
  register const void* r1 asm("r1") = second;
  register long r2 asm("r2") = third;
  register long r7 asm("r7") = number;
  asm volatile("svc 0" : "+r"(r0) : "r"(r1), "r"(r2), "r"(r7) : "memory");
  return r0;
}

}  // namespace

extern "C" void _start() {
  for (int problem = 0; problem < kProblems; ++problem) {
    float tensions[kCables];
    allocate_tensions(kCables, kStructures[problem], kWrenches[problem], kLower, kUpper, tensions);
    call(4, 1, tensions, sizeof tensions);  // write
  }
  call(1, 0, nullptr, 0);  // exit
}
