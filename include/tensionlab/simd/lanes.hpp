// SIMD values: Lanes<Real, L> holds one number for each of L problems.
//
// With GCC and Clang it is the compiler's vector type, so that one expression becomes SIMD code for the
// instruction set of the build. With one lane it is a plain number, which any C++17 compiler can build, such as
// MSVC.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstring>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

// Namespace of a build. Files compiled for different instruction sets are linked together; their functions must
// have different names.
#ifndef TENSIONLAB_BUILD
#define TENSIONLAB_BUILD portable
#endif

// Vector types and attributes as in GCC; clang-cl has them without defining __GNUC__.
#if defined(__GNUC__) || defined(__clang__)
#define TENSIONLAB_GNU_LIKE
#endif

// Unrolls a loop over wrench components: compilers leave nests of short loops alone, and arrays indexed in a loop
// do not fit into registers.
#if defined(TENSIONLAB_GNU_LIKE)
#define TENSIONLAB_UNROLL _Pragma("GCC unroll 8")
#else
#define TENSIONLAB_UNROLL
#endif

// For large or rarely called functions: inlined, they would take registers from their caller.
#if defined(TENSIONLAB_GNU_LIKE)
#define TENSIONLAB_NOINLINE __attribute__((noinline))
#else
#define TENSIONLAB_NOINLINE
#endif

#if defined(TENSIONLAB_GNU_LIKE)
#define TENSIONLAB_INLINE inline __attribute__((always_inline))
#else
#define TENSIONLAB_INLINE inline
#endif

namespace tensionlab {
inline namespace TENSIONLAB_BUILD {

template <class Real, int L>
struct LaneType;
template <class Real>
struct LaneType<Real, 1> {
  using type = Real;
};
#if defined(TENSIONLAB_GNU_LIKE)
template <class Real, int L>
struct LaneType {
  typedef Real type __attribute__((vector_size(sizeof(Real) * L)));
};
#endif
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

// One instruction each, where compilers would compare and blend.
#if defined(__SSE2__)
inline Lanes<double, 2> smaller(const Lanes<double, 2>& a, const Lanes<double, 2>& b) { return _mm_min_pd(a, b); }
inline Lanes<double, 2> larger(const Lanes<double, 2>& a, const Lanes<double, 2>& b) { return _mm_max_pd(a, b); }
inline Lanes<double, 2> magnitude(const Lanes<double, 2>& a) { return _mm_andnot_pd(_mm_set1_pd(-0.0), a); }
#endif
#if defined(__AVX__)
inline Lanes<double, 4> smaller(const Lanes<double, 4>& a, const Lanes<double, 4>& b) {
  return _mm256_min_pd(a, b);
}
inline Lanes<double, 4> larger(const Lanes<double, 4>& a, const Lanes<double, 4>& b) {
  return _mm256_max_pd(a, b);
}
inline Lanes<double, 4> magnitude(const Lanes<double, 4>& a) { return _mm256_andnot_pd(_mm256_set1_pd(-0.0), a); }
#endif
#if defined(__AVX512F__)
inline Lanes<double, 8> smaller(const Lanes<double, 8>& a, const Lanes<double, 8>& b) {
  return _mm512_maskz_min_pd(0xff, a, b);
}
inline Lanes<double, 8> larger(const Lanes<double, 8>& a, const Lanes<double, 8>& b) {
  return _mm512_maskz_max_pd(0xff, a, b);
}
inline Lanes<double, 8> magnitude(const Lanes<double, 8>& a) { return _mm512_abs_pd(a); }
#endif

// Consecutive numbers, aligned or not.
template <class Real, int L>
inline Lanes<Real, L> load(const Real* numbers) {
  Lanes<Real, L> v;
  std::memcpy(&v, numbers, sizeof v);
  return v;
}
template <class Real, class V>
inline void store(const V& v, Real* numbers) {
  std::memcpy(numbers, &v, sizeof v);
}

// Prefetches numbers into the second-level cache. Always inline: GCC drops calls of a function without effects.
template <class Real>
TENSIONLAB_INLINE void prefetch([[maybe_unused]] const Real* numbers, [[maybe_unused]] std::size_t count) {
#if defined(TENSIONLAB_GNU_LIKE)
  for (std::size_t i = 0; i < count; i += 64 / sizeof(Real)) __builtin_prefetch(numbers + i, 0, 2);
#endif
}

// Lane l of a value, for writing and for reading.
template <class Real, class V>
inline Real& lane(V& v, int l) {
  return reinterpret_cast<Real*>(&v)[l];
}
template <class Real, class V>
inline Real read(const V& v, int l) {
  return reinterpret_cast<const Real*>(&v)[l];
}

// f(l) in each lane l.
template <class Real, int L, class F>
inline Lanes<Real, L> gather(const F& f) {
  if constexpr (L == 1) {
    return f(0);
  } else if constexpr (L == 2) {
    return Lanes<Real, L>{f(0), f(1)};
  } else if constexpr (L == 4) {
    return Lanes<Real, L>{f(0), f(1), f(2), f(3)};
  } else {
    static_assert(L == 8, "1, 2, 4 or 8 lanes");
    return Lanes<Real, L>{f(0), f(1), f(2), f(3), f(4), f(5), f(6), f(7)};
  }
}

#if defined(__AVX__)
// Transposes four vectors of four numbers.
inline void transpose_four(__m256d (&v)[4]) {
  const __m256d ab = _mm256_unpacklo_pd(v[0], v[1]), ab_odd = _mm256_unpackhi_pd(v[0], v[1]);
  const __m256d cd = _mm256_unpacklo_pd(v[2], v[3]), cd_odd = _mm256_unpackhi_pd(v[2], v[3]);
  v[0] = _mm256_permute2f128_pd(ab, cd, 0x20);
  v[1] = _mm256_permute2f128_pd(ab_odd, cd_odd, 0x20);
  v[2] = _mm256_permute2f128_pd(ab, cd, 0x31);
  v[3] = _mm256_permute2f128_pd(ab_odd, cd_odd, 0x31);
}

// The transpose of numbers i to i + 3 of four rows.
inline void load_transposed(const double* const* row, int i, __m256d (&out)[4]) {
  for (int k = 0; k < 4; ++k) out[k] = _mm256_loadu_pd(row[k] + i);
  transpose_four(out);
}
#endif

// Calls out(i, v) with number i of each lane's row, for `count` numbers a row.
template <class Real, int L, class Out>
inline void transpose(const Real* const (&row)[L], int count, const Out& out) {
  int i = 0;
#if defined(__AVX__)
  if constexpr (L == 4 && sizeof(Real) == 8) {
    for (; i + 4 <= count; i += 4) {
      __m256d four[4];
      load_transposed(row, i, four);
      for (int k = 0; k < 4; ++k) out(i + k, four[k]);
    }
  }
#endif
#if defined(__AVX512F__)
  if constexpr (L == 8 && sizeof(Real) == 8) {
    for (; i + 4 <= count; i += 4) {
      __m256d low[4], high[4];
      load_transposed(row, i, low);
      load_transposed(row + 4, i, high);
      for (int k = 0; k < 4; ++k)
        out(i + k, _mm512_maskz_insertf64x4(0xff, _mm512_castpd256_pd512(low[k]), high[k], 1));
    }
  }
#endif
  for (; i < count; ++i) out(i, gather<Real, L>([&](int l) { return row[l][i]; }));
}

// Writes values[i] to number i of each lane's row, for `count` numbers a row.
template <class Real, int L>
inline void store_rows(const Lanes<Real, L>* values, int count, Real* const (&row)[L]) {
  int i = 0;
#if defined(__AVX__)
  if constexpr ((L == 4 || L == 8) && sizeof(Real) == 8) {
    for (; i + 4 <= count; i += 4) {
      for (int half = 0; half < L; half += 4) {
        __m256d four[4];
        for (int k = 0; k < 4; ++k)
          four[k] = _mm256_loadu_pd(reinterpret_cast<const double*>(values + i + k) + half);
        transpose_four(four);
        for (int k = 0; k < 4; ++k) _mm256_storeu_pd(row[half + k] + i, four[k]);
      }
    }
  }
#endif
  for (; i < count; ++i) {
    for (int l = 0; l < L; ++l) row[l][i] = read<Real>(values[i], l);
  }
}

template <class Real, int L>
inline Lanes<Real, L> square_root(const Lanes<Real, L>& v) {
#if defined(__SSE2__)
  if constexpr (L == 2 && sizeof(Real) == 8) return _mm_sqrt_pd(v);
#endif
#if defined(__AVX__)
  if constexpr (L == 4 && sizeof(Real) == 8) return _mm256_sqrt_pd(v);
#endif
#if defined(__AVX512F__)
  if constexpr (L == 8 && sizeof(Real) == 8) return _mm512_maskz_sqrt_pd(0xff, v);
#endif
  return gather<Real, L>([&](int l) { return std::sqrt(read<Real>(v, l)); });
}

template <class V, int N>
inline V inner(const V (&x)[N], const V (&y)[N]) {
  V sum = x[0] * y[0];
  TENSIONLAB_UNROLL
  for (int k = 1; k < N; ++k) sum += x[k] * y[k];
  return sum;
}

// Lane l of a comparison.
inline bool holds(bool mask, int) { return mask; }
inline bool holds(int mask, int) { return mask != 0; }  // of bools joined by & and |
template <class Mask>
inline bool holds(const Mask& mask, int l) {
  return mask[l] != 0;
}

inline bool any(bool mask) { return mask; }
inline bool any(int mask) { return mask != 0; }  // of bools joined by & and |
template <class Mask>
inline bool any(const Mask& mask) {
#if defined(__AVX512F__)
  if constexpr (sizeof mask == 64) return _mm512_test_epi64_mask((__m512i)mask, (__m512i)mask) != 0;
#endif
  bool found = false;
  for (unsigned l = 0; l < sizeof(mask) / sizeof(mask[0]); ++l) found = found || mask[l] != 0;
  return found;
}

}  // namespace TENSIONLAB_BUILD
}  // namespace tensionlab
