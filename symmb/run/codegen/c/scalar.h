/* Vectors of one lane for C++, which has no vector types. The operators are those of vectors in C: comparisons give masks with
   all bits 0 or 1, and casts between numbers and masks keep the bits. So cards and processors compile the same sources. */
#ifndef SCALAR_H
#define SCALAR_H

#ifdef __CUDACC_RTC__ /* this compiler has the functions of C without headers */
#define INFINITY __longlong_as_double(0x7ff0000000000000LL)
#define NAN __longlong_as_double(0x7ff8000000000000LL)
#define NULL 0
#else
#include <math.h>
#include <string.h>
#endif
#define restrict __restrict__

struct M {
  long long bits;
  M() = default;
  constexpr M(long long bits) : bits(bits) {}
  explicit inline M(struct V a);
  long long &operator[](int) { return bits; }
  long long operator[](int) const { return bits; }
};

struct V {
  double number;
  V() = default;
  constexpr V(double number) : number(number) {}
  explicit V(M mask) { memcpy(&number, &mask, sizeof number); }
  double &operator[](int) { return number; }
  double operator[](int) const { return number; }
};

M::M(V a) { memcpy(&bits, &a, sizeof bits); }

#define SCALAR_OPERATOR(R, T, operation, value) \
  static inline R operator operation(T left, T right) { return R(value); }
#define SCALAR_OPERATORS(T, operation, field) \
  SCALAR_OPERATOR(T, T, operation, left.field operation right.field) \
  static inline T &operator operation##=(T &left, T right) { return left = left operation right; }
SCALAR_OPERATORS(V, +, number)
SCALAR_OPERATORS(V, -, number)
SCALAR_OPERATORS(V, *, number)
SCALAR_OPERATORS(V, /, number)
SCALAR_OPERATORS(M, &, bits)
SCALAR_OPERATORS(M, |, bits)
SCALAR_OPERATORS(M, ^, bits)
SCALAR_OPERATOR(M, V, <, -(long long)(left.number < right.number))
SCALAR_OPERATOR(M, V, <=, -(long long)(left.number <= right.number))
SCALAR_OPERATOR(M, V, >, -(long long)(left.number > right.number))
SCALAR_OPERATOR(M, V, >=, -(long long)(left.number >= right.number))
SCALAR_OPERATOR(M, V, ==, -(long long)(left.number == right.number))
SCALAR_OPERATOR(M, V, !=, -(long long)(left.number != right.number))
SCALAR_OPERATOR(M, M, ==, -(long long)(left.bits == right.bits))
SCALAR_OPERATOR(M, M, -, left.bits - right.bits)
SCALAR_OPERATOR(M, M, +, left.bits + right.bits)
static inline V operator-(V a) { return V(-a.number); }
static inline M operator-(M a) { return M(-a.bits); }
static inline M operator~(M a) { return M(~a.bits); }
static inline M operator<<(M a, int places) { return M((long long)((unsigned long long)a.bits << places)); }

#ifdef __CUDACC__
#define __ATOMIC_RELAXED 0
#define __atomic_fetch_add(number, added, order) \
  ((long)atomicAdd((unsigned long long *)(number), (unsigned long long)(added)))
#endif

#endif
