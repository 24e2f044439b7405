/* A vector of W doubles, one lane for each of W samples that run side by side: the same number on every processor, so
   that results do not depend on it. Compilers split a vector that is wider than the processor's. */
#if defined(__x86_64__)
#include <immintrin.h>
#endif
#include <math.h>
#include <string.h>

#define W 8

typedef double V __attribute__((vector_size(8 * W), aligned(8 * W)));
typedef long long M __attribute__((vector_size(8 * W), aligned(8 * W)));
#define NOINLINE __attribute__((noinline))

static inline V zero(void) { return (V){0}; }
static inline V blend(M mask, V a, V b) { return (V)(((M)a & mask) | ((M)b & ~mask)); }
#define choose(mask, a, b) blend((M)(mask), zero() + (a), zero() + (b))
#define truth(mask) blend((M)(mask), zero() + 1.0, zero())

/* Elementary functions: the vector ones of the C library where it has them, lane by lane where not. */
#define BY_LANE_1(name, f) static inline V name(V a) { for (int l = 0; l < W; ++l) a[l] = f(a[l]); return a; }
#define BY_LANE_2(name, f) static inline V name(V a, V b) { for (int l = 0; l < W; ++l) a[l] = f(a[l], b[l]); return a; }
#if defined(__AVX2__) && !defined(__AVX512F__)
#define BY_HALF_1(name, f) \
  static inline V name(V a) { Halves h = {a}; h.half[0] = f(h.half[0]); h.half[1] = f(h.half[1]); return h.whole; }
#define BY_HALF_2(name, f) \
  static inline V name(V a, V b) { \
    Halves h = {a}, g = {b}; \
    h.half[0] = f(h.half[0], g.half[0]); \
    h.half[1] = f(h.half[1], g.half[1]); \
    return h.whole; \
  }
typedef union { V whole; __m256d half[2]; } Halves;
#endif
#if defined(LIBMVEC) && defined(__AVX512F__)
#define FROM_LIBRARY_1(f) V _ZGVeN8v_##f(V); static inline V v_##f(V a) { return _ZGVeN8v_##f(a); }
#define FROM_LIBRARY_2(f) V _ZGVeN8vv_##f(V, V); static inline V v_##f(V a, V b) { return _ZGVeN8vv_##f(a, b); }
#elif defined(LIBMVEC) && defined(__AVX2__)
#define FROM_LIBRARY_1(f) __m256d _ZGVdN4v_##f(__m256d); BY_HALF_1(v_##f, _ZGVdN4v_##f)
#define FROM_LIBRARY_2(f) __m256d _ZGVdN4vv_##f(__m256d, __m256d); BY_HALF_2(v_##f, _ZGVdN4vv_##f)
#else
#define FROM_LIBRARY_1(f) BY_LANE_1(v_##f, f)
#define FROM_LIBRARY_2(f) BY_LANE_2(v_##f, f)
#endif
FROM_LIBRARY_1(sin)
FROM_LIBRARY_1(cos)
FROM_LIBRARY_1(exp)
FROM_LIBRARY_1(log)
FROM_LIBRARY_2(pow)
#if defined(__AVX512F__)
static inline V v_sqrt(V a) { return (V)_mm512_sqrt_pd((__m512d)a); }
static inline V v_floor(V a) { return (V)_mm512_floor_pd((__m512d)a); }
static inline V v_ceil(V a) { return (V)_mm512_ceil_pd((__m512d)a); }
#elif defined(__AVX2__)
BY_HALF_1(v_sqrt, _mm256_sqrt_pd)
BY_HALF_1(v_floor, _mm256_floor_pd)
BY_HALF_1(v_ceil, _mm256_ceil_pd)
#else
BY_LANE_1(v_sqrt, sqrt)
BY_LANE_1(v_floor, floor)
BY_LANE_1(v_ceil, ceil)
#endif
BY_LANE_1(v_tan, tan)
BY_LANE_1(v_asin, asin)
BY_LANE_1(v_acos, acos)
BY_LANE_1(v_atan, atan)
BY_LANE_1(v_sinh, sinh)
BY_LANE_1(v_cosh, cosh)
BY_LANE_1(v_tanh, tanh)
BY_LANE_1(v_asinh, asinh)
BY_LANE_1(v_acosh, acosh)
BY_LANE_1(v_atanh, atanh)
BY_LANE_1(v_log1p, log1p)
BY_LANE_1(v_expm1, expm1)
BY_LANE_1(v_erf, erf)
BY_LANE_2(v_atan2, atan2)
BY_LANE_2(v_fmod, fmod)
BY_LANE_2(v_remainder, remainder)
BY_LANE_2(v_copysign, copysign)
BY_LANE_2(v_hypot, hypot)
