// Which build of the solver this processor can run; the environment variable TENSIONLAB_ISA may ask for less.
#pragma once

#include <cstdlib>
#include <cstring>

#include "newton_batch.hpp"

namespace tensionlab {

void newton_baseline(const Batch&, Policy, double, std::size_t, std::size_t, const NewtonAnswer&);
#if defined(TENSIONLAB_X86)
void newton_avx2(const Batch&, Policy, double, std::size_t, std::size_t, const NewtonAnswer&);
void newton_avx512(const Batch&, Policy, double, std::size_t, std::size_t, const NewtonAnswer&);
#endif

struct NewtonKernel {
  const char* name;
  NewtonSolve solve;
};

inline NewtonKernel choose_newton_kernel() {
#if defined(TENSIONLAB_X86)
  const char* wish = std::getenv("TENSIONLAB_ISA");
  const auto allowed = [wish](const char* name) { return wish == nullptr || std::strcmp(wish, name) == 0; };
  if (allowed("avx512") && __builtin_cpu_supports("x86-64-v4")) return {"avx512", newton_avx512};
  if ((wish == nullptr || std::strcmp(wish, "baseline") != 0) && __builtin_cpu_supports("x86-64-v3")) {
    return {"avx2", newton_avx2};
  }
#endif
  return {"baseline", newton_baseline};
}

inline const NewtonKernel& newton_kernel() {
  static const NewtonKernel kernel = choose_newton_kernel();
  return kernel;
}

}  // namespace tensionlab
