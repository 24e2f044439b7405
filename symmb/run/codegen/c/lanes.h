/* Vectors of W doubles, where W is the vector width of the processor. Each lane is one of W samples that run in parallel. WIDTH
   samples have the same steps and fill PARTS vectors. WIDTH is the same on every processor, so that results do not depend on
   the processor. */
#ifndef LANES_H
#define LANES_H

#ifdef __cplusplus
#include "scalar.h"
#else
#include <math.h>
#include <string.h>
#endif

#ifndef WIDTH
#define WIDTH 8
#endif
#if WIDTH == 1 /* samples with jumps of velocities have separate steps */
#define W 1
#elif defined(__AVX512F__)
#define W 8
#elif defined(__AVX2__)
#define W 4
#else
#define W 2
#endif
#define PARTS (WIDTH / W)

#ifndef __cplusplus
typedef double V __attribute__((vector_size(8 * W), aligned(8 * W)));
typedef long long M __attribute__((vector_size(8 * W), aligned(8 * W)));
#endif
#define NOINLINE __attribute__((noinline))
#define PRIVATE static __attribute__((unused)) /* a function that a model may not use */

/* A function of a model, a part of such a function, and data of a model. If the parts of a model and the engine are compiled
   separately, PART is the number of the part. */
#ifdef PART
#define MODEL __attribute__((visibility("hidden")))
#define PIECE __attribute__((noinline, visibility("hidden")))
#define DATA MODEL
#else
#define MODEL PRIVATE
#define PIECE PRIVATE NOINLINE
#define DATA PRIVATE
#endif

PRIVATE inline V zero(void) { V a = {0}; return a; }
PRIVATE inline V blend(M mask, V a, V b) { return (V)(((M)a & mask) | ((M)b & ~mask)); }
#define each(a) ((a) - zero()) /* a number in each lane. A sum with 0 would change -0 to 0, and compilers could not remove it */
#define choose(mask, a, b) blend((M)(mask), each(a), each(b))
#define truth(mask) blend((M)(mask), each(1.0), zero())
PRIVATE inline int none(M mask) {
  long long any = 0;
  for (int l = 0; l < W; ++l) any |= mask[l];
  return !any;
}
/* The first `count` of W numbers, or all of them. When reading, other lanes are 0. When writing, other entries of the array do
   not change. */
PRIVATE inline V some_of(const double *from, long count) {
  V a = zero();
  if (count >= W) memcpy(&a, from, sizeof a); else memcpy(&a, from, count * sizeof *from);
  return a;
}
PRIVATE inline void to_some(double *to, V a, long count) {
  if (count >= W) memcpy(to, &a, sizeof a); else memcpy(to, &a, count * sizeof *to);
}
PRIVATE inline V v_fabs(V a) { return (V)((M)a & 0x7fffffffffffffffLL); }

/* Elementary functions: the vector functions of the C library if they exist, otherwise calls lane by lane. */
#define BY_LANE_1(name, f) PRIVATE inline V name(V a) { for (int l = 0; l < W; ++l) a[l] = f(a[l]); return a; }
#define BY_LANE_2(name, f) PRIVATE inline V name(V a, V b) { for (int l = 0; l < W; ++l) a[l] = f(a[l], b[l]); return a; }
#if defined(LIBMVEC) && W == 8
#define FROM_LIBRARY_1(f) V _ZGVeN8v_##f(V); PRIVATE inline V v_##f(V a) { return _ZGVeN8v_##f(a); }
#define FROM_LIBRARY_2(f) V _ZGVeN8vv_##f(V, V); PRIVATE inline V v_##f(V a, V b) { return _ZGVeN8vv_##f(a, b); }
#elif defined(LIBMVEC) && W == 4
#define FROM_LIBRARY_1(f) V _ZGVdN4v_##f(V); PRIVATE inline V v_##f(V a) { return _ZGVdN4v_##f(a); }
#define FROM_LIBRARY_2(f) V _ZGVdN4vv_##f(V, V); PRIVATE inline V v_##f(V a, V b) { return _ZGVdN4vv_##f(a, b); }
#else
#define FROM_LIBRARY_1(f) BY_LANE_1(v_##f, f)
#define FROM_LIBRARY_2(f) BY_LANE_2(v_##f, f)
#endif
FROM_LIBRARY_1(exp)
FROM_LIBRARY_1(log)
FROM_LIBRARY_2(pow)

/* Single instructions by their names, because the compiler's header of intrinsics takes a sixth of the time of a small
   model. */
#define BY_INSTRUCTION_1(name, text) \
  PRIVATE inline V name(V a) { V b; __asm__(text " %1, %0" : "=v"(b) : "v"(a)); return b; }
#define BY_INSTRUCTION_2(T, name, text) /* with NaN in a or b, the result is b */ \
  PRIVATE inline T name(T a, T b) { T c; __asm__(text " %2, %1, %0" : "=v"(c) : "v"(a), "v"(b)); return c; }
#if W == 8
PRIVATE inline int all_below(V a, double b) { return __builtin_ia32_cmppd512_mask(a, each(b), 17, -1, 4) == 255; }
BY_INSTRUCTION_1(v_floor, "vrndscalepd $1,")
BY_INSTRUCTION_1(v_ceil, "vrndscalepd $2,")
#elif W == 4
PRIVATE inline int all_below(V a, double b) {
  return __builtin_ia32_movmskpd256(__builtin_ia32_cmppd256(a, each(b), 17)) == 15;
}
BY_INSTRUCTION_1(v_floor, "vroundpd $1,")
BY_INSTRUCTION_1(v_ceil, "vroundpd $2,")
#endif
#if W >= 4
BY_INSTRUCTION_1(v_sqrt, "vsqrtpd")
BY_INSTRUCTION_2(V, v_smaller, "vminpd")
BY_INSTRUCTION_2(V, v_larger, "vmaxpd")
#else
PRIVATE inline int all_below(V a, double b) { return (a[0] < b) & (a[W - 1] < b); }
BY_LANE_1(v_sqrt, sqrt)
BY_LANE_1(v_floor, floor)
BY_LANE_1(v_ceil, ceil)
PRIVATE inline V v_smaller(V a, V b) { return choose(a < b, a, b); }
PRIVATE inline V v_larger(V a, V b) { return choose(a > b, a, b); }
#endif
/* Like fmin and fmax: if one argument is NaN, the result is the other argument. */
PRIVATE inline V v_fmin(V a, V b) { return choose(b != b, a, v_smaller(a, b)); }
PRIVATE inline V v_fmax(V a, V b) { return choose(b != b, a, v_larger(a, b)); }

/* Sine and cosine together, with errors of an ulp. Angles are reduced by multiples of pi / 2 in parts with exact products (Cody
   and Waite 1980). Then the polynomials of FDLIBM (Sun Microsystems 1993) are used on [-pi/4, pi/4]. Lanes with large or
   infinite numbers use the library. */
PRIVATE NOINLINE void sincos_by_lane(V a, V *s, V *c) {
  for (int l = 0; l < W; ++l) {
    (*s)[l] = sin(a[l]);
    (*c)[l] = cos(a[l]);
  }
}

PRIVATE inline __attribute__((always_inline)) void sincos_inline(V a, V *s, V *c) {
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

/* A call in a large model, because compilers take minutes for many inline copies. */
#if defined(LARGE) && LARGE
PRIVATE NOINLINE
#else
PRIVATE inline
#endif
void v_sincos(V a, V *s, V *c) { sincos_inline(a, s, c); }
PRIVATE inline V v_sin(V a) { V s, c; v_sincos(a, &s, &c); return s; }
PRIVATE inline V v_cos(V a) { V s, c; v_sincos(a, &s, &c); return c; }

/* Replaces each of n angles, a[0], a[2], ..., by its sine, followed by its cosine. The computations are independent of each
   other. */
PRIVATE NOINLINE void sines(int n, V *a) {
  for (int i = 0; i < n; ++i) sincos_inline(a[2 * i], a + 2 * i, a + 2 * i + 1);
}

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

/* The smallest or largest lane of each of W vectors, in one vector, by a tree of shuffles. */
#if defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector) && W > 1
#define TREE
#define MIX __builtin_shufflevector
#if W == 8
#define TREE_OF(name, f) \
  PRIVATE inline V name(const V *y) { \
    V a[4], b[2]; \
    for (int k = 0; k < 4; ++k) \
      a[k] = f(MIX(y[2 * k], y[2 * k + 1], 0, 8, 2, 10, 4, 12, 6, 14), MIX(y[2 * k], y[2 * k + 1], 1, 9, 3, 11, 5, 13, 7, 15)); \
    for (int k = 0; k < 2; ++k) \
      b[k] = f(MIX(a[2 * k], a[2 * k + 1], 0, 1, 8, 9, 4, 5, 12, 13), MIX(a[2 * k], a[2 * k + 1], 2, 3, 10, 11, 6, 7, 14, 15)); \
    return f(MIX(b[0], b[1], 0, 1, 2, 3, 8, 9, 10, 11), MIX(b[0], b[1], 4, 5, 6, 7, 12, 13, 14, 15)); \
  }
#elif W == 4
#define TREE_OF(name, f) \
  PRIVATE inline V name(const V *y) { \
    V a = f(MIX(y[0], y[1], 0, 4, 2, 6), MIX(y[0], y[1], 1, 5, 3, 7)), b = f(MIX(y[2], y[3], 0, 4, 2, 6), MIX(y[2], y[3], 1, 5, 3, 7)); \
    return f(MIX(a, b, 0, 1, 4, 5), MIX(a, b, 2, 3, 6, 7)); \
  }
#else
#define TREE_OF(name, f) PRIVATE inline V name(const V *y) { return f(MIX(y[0], y[1], 0, 2), MIX(y[0], y[1], 1, 3)); }
#endif
TREE_OF(tree_smaller, v_smaller)
TREE_OF(tree_larger, v_larger)
#endif
#endif

/* The rows of pieces (symbolic/pieces.py) that contain the numbers `at`. The first column of the n rows has groups, and the
   second column has the start of each piece. */
PRIVATE NOINLINE V v_search(const double *rows, long n, V group, V at) {
  for (int l = 0; l < W; ++l) {
    long low = -1, high = n; /* rows up to low are not after (group, at), rows from high on are */
    while (high - low > 1) {
      long row = low + (high - low) / 2;
      if (rows[row] < group[l] || (rows[row] == group[l] && rows[n + row] <= at[l])) low = row;
      else high = row;
    }
    if (low < 0 || (low + 1 < n && rows[low] < group[l])) ++low; /* before the first row of the group */
    at[l] = low;
  }
  return at;
}
PRIVATE inline V v_entry(const double *column, V row) {
  for (int l = 0; l < W; ++l) row[l] = column[(long)row[l]];
  return row;
}

#endif
