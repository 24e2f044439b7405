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
#define each(a) ((a) - zero()) /* a number in each lane; unlike by adding 0, -0 stays, and compilers see that lanes do */
#define choose(mask, a, b) blend((M)(mask), each(a), each(b))
#define truth(mask) blend((M)(mask), each(1.0), zero())
static inline int none(M mask) {
  long long any = 0;
  for (int l = 0; l < W; ++l) any |= mask[l];
  return !any;
}
static inline V v_fabs(V a) { return (V)((M)a & 0x7fffffffffffffffLL); }

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
FROM_LIBRARY_1(exp)
FROM_LIBRARY_1(log)
FROM_LIBRARY_2(pow)
#if defined(__AVX512F__)
static inline int all_below(V a, double b) { return _mm512_cmp_pd_mask((__m512d)a, _mm512_set1_pd(b), _CMP_LT_OQ) == 255; }
static inline V v_sqrt(V a) { return (V)_mm512_sqrt_pd((__m512d)a); }
static inline V v_floor(V a) { return (V)_mm512_floor_pd((__m512d)a); }
static inline V v_ceil(V a) { return (V)_mm512_ceil_pd((__m512d)a); }
static inline V v_smaller(V a, V b) { return (V)_mm512_min_pd((__m512d)a, (__m512d)b); }
static inline V v_larger(V a, V b) { return (V)_mm512_max_pd((__m512d)a, (__m512d)b); }
#elif defined(__AVX2__)
static inline int all_below(V a, double b) {
  Halves h = {a};
  __m256d limit = _mm256_set1_pd(b);
  return _mm256_movemask_pd(_mm256_and_pd(
             _mm256_cmp_pd(h.half[0], limit, _CMP_LT_OQ), _mm256_cmp_pd(h.half[1], limit, _CMP_LT_OQ))) == 15;
}
BY_HALF_1(v_sqrt, _mm256_sqrt_pd)
BY_HALF_1(v_floor, _mm256_floor_pd)
BY_HALF_1(v_ceil, _mm256_ceil_pd)
BY_HALF_2(v_smaller, _mm256_min_pd)
BY_HALF_2(v_larger, _mm256_max_pd)
#else
static inline int all_below(V a, double b) {
  int below = 1;
  for (int l = 0; l < W; ++l) below &= a[l] < b;
  return below;
}
BY_LANE_1(v_sqrt, sqrt)
BY_LANE_1(v_floor, floor)
BY_LANE_1(v_ceil, ceil)
static inline V v_smaller(V a, V b) { return choose(a < b, a, b); }
static inline V v_larger(V a, V b) { return choose(a > b, a, b); }
#endif

/* Sine and cosine together, to an ulp: reduction by multiples of pi / 2 (Cody and Waite 1980) in parts whose products are
   exact, then the polynomials of FDLIBM (Sun Microsystems 1993) on [-pi/4, pi/4]. Lanes of large or infinite numbers go
   through the library. */
static NOINLINE void sincos_by_lane(V a, V *s, V *c) {
  for (int l = 0; l < W; ++l) {
    (*s)[l] = sin(a[l]);
    (*c)[l] = cos(a[l]);
  }
}

#if LARGE
static NOINLINE
#else
static inline
#endif
void v_sincos(V a, V *s, V *c) {
  const double to_integer = 6755399441055744.0; /* 1.5 * 2^52: the last bits of a sum with it are an integer */
  V shifted = a * 0.63661977236758134308 + to_integer, n = shifted - to_integer;
  V r = a - n * 1.57079632673412561417;
  r = r - n * 6.07710050630396597660e-11;
  r = r - n * 2.02226624879595063154e-21;
  V z = r * r;
  V odd = z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 +
          z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))));
  V even = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 +
           z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)))));
  V sine = r + r * odd, cosine = 1.0 - z * (0.5 - even);
  M quarter = (M)shifted, swap = -(quarter & 1);
  *s = (V)((M)blend(swap, cosine, sine) ^ ((quarter & 2) << 62));
  *c = (V)((M)blend(swap, sine, cosine) ^ (((quarter + 1) & 2) << 62));
  if (__builtin_expect(!all_below(v_fabs(a), 1e5), 0)) sincos_by_lane(a, s, c);
}
static inline V v_sin(V a) { V s, c; v_sincos(a, &s, &c); return s; }
static inline V v_cos(V a) { V s, c; v_sincos(a, &s, &c); return c; }

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
