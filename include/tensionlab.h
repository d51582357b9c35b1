/* Cable tensions for a wrench, from C: sizes at run time, up to 6 components and 32 cables, in double.

     W t = w,  lower <= t <= upper,  |t - reference| least

   The exact solver and the verification of the Python package, with its code for the processor at hand: the same
   answers, bit for bit. No heap, no exceptions, no locks; any number of threads. From C++, tensionlab/allocate.hpp
   has the same without a library, in float as well. */
#ifndef TENSIONLAB_H
#define TENSIONLAB_H

#if defined(_WIN32) && defined(TENSIONLAB_SHARED)
#if defined(TENSIONLAB_EXPORTS)
#define TENSIONLAB_API __declspec(dllexport)
#else
#define TENSIONLAB_API __declspec(dllimport)
#endif
#elif defined(__GNUC__)
#define TENSIONLAB_API __attribute__((visibility("default")))
#else
#define TENSIONLAB_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define TENSIONLAB_MAX_COMPONENTS 6
#define TENSIONLAB_MAX_CABLES 32

/* What to render where no tensions inside the limits render the wrench: the nearest wrench; the wrench of the
   tensions nearest to equilibrium; or the longest wrench in the same direction. */
enum tensionlab_policy { TENSIONLAB_FORCE = 0, TENSIONLAB_TENSION = 1, TENSIONLAB_DIRECTION = 2 };

/* EXACT: the wrench is rendered, to 1e-6 max(1, |w|). NEAREST: `separation` proves that no tensions render it, and
   the tensions are the best for the policy. UNPROVEN: neither is proved; the tensions are inside the limits.
   FAILED: the library was compiled for other processors than this. INVALID: an argument is out of range (see
   tensionlab_allocate), and nothing is written. */
enum tensionlab_status {
  TENSIONLAB_INVALID = -1,
  TENSIONLAB_EXACT = 0,
  TENSIONLAB_NEAREST = 1,
  TENSIONLAB_UNPROVEN = 2,
  TENSIONLAB_FAILED = 3
};

typedef struct tensionlab_result {
  double wrench[TENSIONLAB_MAX_COMPONENTS];     /* rendered: W t */
  double separation[TENSIONLAB_MAX_COMPONENTS]; /* where NEAREST: d with d'w > d'W t for all t inside the limits */
  double residual;                              /* weighted length of w - W t */
  double scale;                                 /* 1 where EXACT; s of W t = s w for DIRECTION; NaN elsewhere */
  int iterations;
} tensionlab_result;

/* Writes m tensions, and what is proved of them unless `result` is null; returns a status.

   structure: n x m, row by row. reference: m tensions to stay close to; null for zeros. weights: n, positive, of
   the components in the wrench error; null for ones. All numbers must be below 1e100 in magnitude, lower <= upper,
   n from 1 to 6 and m from 1 to 32. */
TENSIONLAB_API int tensionlab_allocate(int n, int m, const double* structure, const double* wrench,
                                       const double* lower, const double* upper, const double* reference,
                                       const double* weights, int policy, double* tensions,
                                       tensionlab_result* result);

/* "1.0.0". */
TENSIONLAB_API const char* tensionlab_version(void);

#ifdef __cplusplus
}
#endif
#endif
