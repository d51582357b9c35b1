// Which build of a kernel this processor can run; the environment variable TENSIONLAB_ISA may ask for less.
//
// CMake compiles a kernel's one source file for each instruction set, with TENSIONLAB_BUILD for its namespace and
// TENSIONLAB_LANES for its width. Where there is only one build, it is the baseline.
#pragma once

#include <cstdlib>
#include <cstring>

// Declares a kernel, in every build, and `name`_for_this_processor(), which picks one; nothing in the builds.
#if defined(TENSIONLAB_LANES)
#define TENSIONLAB_KERNEL(name, ...)
#elif defined(TENSIONLAB_X86)
#define TENSIONLAB_KERNEL(name, ...) \
  namespace baseline {               \
  void name(__VA_ARGS__);            \
  }                                  \
  namespace avx2 {                   \
  void name(__VA_ARGS__);            \
  }                                  \
  namespace avx512 {                 \
  void name(__VA_ARGS__);            \
  }                                  \
  inline auto name##_for_this_processor() { return pick_build(&baseline::name, &avx2::name, &avx512::name); }
#else
#define TENSIONLAB_KERNEL(name, ...) \
  namespace baseline {               \
  void name(__VA_ARGS__);            \
  }                                  \
  inline auto name##_for_this_processor() { return &baseline::name; }
#endif

namespace tensionlab {

enum class InstructionSet { baseline, avx2, avx512 };

inline InstructionSet choose_instruction_set() {
#if defined(TENSIONLAB_X86)
  const char* wish = std::getenv("TENSIONLAB_ISA");
  const auto allowed = [wish](const char* name) { return wish == nullptr || std::strcmp(wish, name) == 0; };
  if (allowed("avx512") && __builtin_cpu_supports("x86-64-v4")) return InstructionSet::avx512;
  if (!(wish != nullptr && std::strcmp(wish, "baseline") == 0) && __builtin_cpu_supports("x86-64-v3")) {
    return InstructionSet::avx2;
  }
#endif
  return InstructionSet::baseline;
}

inline InstructionSet instruction_set() {
  static const InstructionSet chosen = choose_instruction_set();
  return chosen;
}

inline const char* instruction_set_name() {
  constexpr const char* kNames[] = {"baseline", "avx2", "avx512"};
  return kNames[static_cast<int>(instruction_set())];
}

template <class Function>
Function* pick_build(Function* baseline, Function* avx2, Function* avx512) {
  switch (instruction_set()) {
    case InstructionSet::avx512:
      return avx512;
    case InstructionSet::avx2:
      return avx2;
    default:
      return baseline;
  }
}

}  // namespace tensionlab
