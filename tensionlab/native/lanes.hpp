// Several problems side by side: a value of type Lanes<Real, L> holds one number for each of L problems.
//
// With GCC and Clang it is the compiler's own vector type, so that an expression written once becomes SIMD
// code for whatever instruction set the file is compiled for. With one lane it is the plain number: any C++17
// compiler can build that, and the firmware does.
#pragma once

// Files compiled for different instruction sets are linked together. Each names its build, so that the linker
// never takes a function of one for the other.
#ifndef TENSIONLAB_BUILD
#define TENSIONLAB_BUILD portable
#endif

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L>
struct LaneType {
  typedef Real type __attribute__((vector_size(sizeof(Real) * L)));
};
template <class Real>
struct LaneType<Real, 1> {
  using type = Real;
};
template <class Real, int L>
using Lanes = typename LaneType<Real, L>::type;

template <class V>
inline V smaller(const V& a, const V& b) {
  return a < b ? a : b;
}
template <class V>
inline V larger(const V& a, const V& b) {
  return a > b ? a : b;
}
template <class V>
inline V magnitude(const V& a) {
  return larger(a, V(-a));
}

// Lane l of a value, to write or to read.
template <class Real, class V>
inline Real& lane(V& v, int l) {
  return reinterpret_cast<Real*>(&v)[l];
}
template <class Real, class V>
inline Real read(const V& v, int l) {
  return reinterpret_cast<const Real*>(&v)[l];
}

inline bool any(bool mask) { return mask; }
inline bool any(int mask) { return mask != 0; }  // of bools joined by & and |
template <class Mask>
inline bool any(const Mask& mask) {
  bool found = false;
  for (unsigned l = 0; l < sizeof(mask) / sizeof(mask[0]); ++l) found = found || mask[l] != 0;
  return found;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
