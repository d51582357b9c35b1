// Choice of a kernel's build: the best that was compiled and that this processor can run, or a lower one that the
// environment variable TENSIONLAB_ISA names.
//
// CMake compiles each kernel source once for each instruction set, with TENSIONLAB_BUILD for its namespace and
// TENSIONLAB_LANES for its width, and defines TENSIONLAB_BASELINE, TENSIONLAB_AVX2 and TENSIONLAB_AVX512 for the
// builds that exist. TENSIONLAB_BUILDS=native runs this check in CMake, too.
#pragma once

#include <atomic>
#include <cstdlib>
#include <cstring>

#if (defined(__GNUC__) || defined(__clang__)) && (defined(__x86_64__) || defined(_M_X64))
#include <cpuid.h>
#define TENSIONLAB_HAS_CPUID
#endif

#if defined(TENSIONLAB_BASELINE)
#define TENSIONLAB_IF_BASELINE(...) __VA_ARGS__
#else
#define TENSIONLAB_IF_BASELINE(...)
#endif
#if defined(TENSIONLAB_AVX2)
#define TENSIONLAB_IF_AVX2(...) __VA_ARGS__
#else
#define TENSIONLAB_IF_AVX2(...)
#endif
#if defined(TENSIONLAB_AVX512)
#define TENSIONLAB_IF_AVX512(...) __VA_ARGS__
#else
#define TENSIONLAB_IF_AVX512(...)
#endif

// Declares a kernel in every build, and `name`_for_this_processor(), which chooses one. Empty inside the builds.
#if defined(TENSIONLAB_LANES)
#define TENSIONLAB_KERNEL(name, ...)
#else
#define TENSIONLAB_KERNEL(name, ...)                                                  \
  TENSIONLAB_IF_BASELINE(namespace baseline { void name(__VA_ARGS__); })              \
  TENSIONLAB_IF_AVX2(namespace avx2 { void name(__VA_ARGS__); })                      \
  TENSIONLAB_IF_AVX512(namespace avx512 { void name(__VA_ARGS__); })                  \
  inline auto name##_for_this_processor() -> void (*)(__VA_ARGS__) {                  \
    switch (instruction_set()) {                                                      \
      TENSIONLAB_IF_AVX512(case InstructionSet::avx512 : return &avx512::name;)       \
      TENSIONLAB_IF_AVX2(case InstructionSet::avx2 : return &avx2::name;)             \
      TENSIONLAB_IF_BASELINE(case InstructionSet::baseline : return &baseline::name;) \
      default:                                                                        \
        return nullptr;                                                               \
    }                                                                                 \
  }
#endif

namespace tensionlab {

enum class InstructionSet { none = -1, baseline, avx2, avx512 };
constexpr int kInstructionSets = 3;
constexpr const char* kInstructionSetNames[kInstructionSets] = {"baseline", "avx2", "avx512"};

constexpr bool kCompiled[kInstructionSets] = {
    TENSIONLAB_IF_BASELINE(true ||) false,
    TENSIONLAB_IF_AVX2(true ||) false,
    TENSIONLAB_IF_AVX512(true ||) false,
};

// The best set whose features the processor has, and whose registers the system saves (Intel, 2024, Software
// Developer's Manual, volume 2, CPUID).
inline InstructionSet best_of_this_processor() {
#if defined(TENSIONLAB_HAS_CPUID)
  unsigned a = 0, b = 0, c = 0, d = 0;
  const auto bits = [](unsigned word, unsigned mask) { return (word & mask) == mask; };
  if (!__get_cpuid_count(1, 0, &a, &b, &c, &d) || !bits(c, bit_FMA | bit_OSXSAVE)) return InstructionSet::baseline;
  unsigned saved = 0, saved_high = 0;
  __asm__("xgetbv" : "=a"(saved), "=d"(saved_high) : "c"(0));
  if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || !bits(b, bit_AVX2) || !bits(saved, 0x06)) {
    return InstructionSet::baseline;
  }
  const bool avx512 = bits(b, bit_AVX512F | bit_AVX512DQ | bit_AVX512VL) && bits(saved, 0xe6);
  return avx512 ? InstructionSet::avx512 : InstructionSet::avx2;
#else
  return InstructionSet::baseline;
#endif
}

// The best compiled set that the processor has, not above TENSIONLAB_ISA; if that is below all of them, the
// lowest. none: the processor has no compiled one.
inline InstructionSet choose_instruction_set() {
  const char* requested = std::getenv("TENSIONLAB_ISA");
  int chosen = -1;
  for (int set = static_cast<int>(best_of_this_processor()); set >= 0; --set) {
    if (!kCompiled[set]) continue;
    chosen = set;
    if (requested == nullptr || std::strcmp(requested, kInstructionSetNames[set]) == 0) break;
  }
  return static_cast<InstructionSet>(chosen);
}

// Chosen at the first call; threads that call at once choose the same.
inline InstructionSet instruction_set() {
  constexpr int kNotYet = -2;
  static std::atomic<int> chosen{kNotYet};
  int set = chosen.load(std::memory_order_relaxed);
  if (set == kNotYet) chosen.store(set = static_cast<int>(choose_instruction_set()), std::memory_order_relaxed);
  return static_cast<InstructionSet>(set);
}

}  // namespace tensionlab
