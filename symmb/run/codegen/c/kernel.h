/* An ensemble on a graphics card. Each thread runs one sample after another, and has a block of one lane. Then other threads
   reduce the values of these samples. */
#ifndef KERNEL_H
#define KERNEL_H

#include "begin.h"

#define EACH_THREAD(number) const long number = (long)blockIdx.x * blockDim.x + threadIdx.x

/* Runs the samples of a study, and stores their values. */
extern "C" __global__ void run_samples(Study *s) {
  Block b;
  memset(&b, 0, sizeof b);
  EACH_THREAD(thread);
  for (b.number = thread; b.number < s->n; b.number += (long)gridDim.x * blockDim.x) {
    b.steps = 0;
    while (begin(&b, s) && !run(&b, s)) {}
    __atomic_fetch_add(&s->steps, b.steps, __ATOMIC_RELAXED);
  }
}

/* In a reduction, each thread has one place, and one of STRIPES stripes of samples: those with the numbers k, k + STRIPES, and
   so on. It adds the samples that did not fail in their order. So results depend neither on the number of threads, nor on the
   numbers of samples in a portion, if these are multiples of STRIPES. */
#define STRIPES 16
#define EACH_SAMPLE(j, stripe) for (long j = stripe; j < s->n; j += STRIPES) if (s->t_failed[j] != s->t_failed[j])

/* Extends summaries (7, STRIPES, n_t, N_Y): the extremes of values, the numbers of the samples that attain them, and moments,
   which are the number of values, their mean, and the sum of the squares of their distances from the mean, after Welford
   (1962). The first sample has the number `first`. */
extern "C" __global__ void summarize(const Study *s, long first, double *summaries) {
  EACH_THREAD(thread);
  const long n = s->n_t * N_Y, i = thread % n;
  if (thread >= STRIPES * n) return;
  double own[7];
  for (int k = 0; k < 7; ++k) own[k] = summaries[k * STRIPES * n + thread];
  EACH_SAMPLE(j, thread / n) {
    const double y = s->Y[j * n + i], d = y - own[5];
    if (y < own[0]) own[0] = y, own[2] = first + j;
    if (y > own[1]) own[1] = y, own[3] = first + j;
    own[4] += 1.0;
    own[5] += d / own[4];
    own[6] += d * (y - own[5]);
  }
  for (int k = 0; k < 7; ++k) summaries[k * STRIPES * n + thread] = own[k];
}

/* Counts the values of an output in n bins of equal width between two ends, at each time. Values beyond an end are counted in
   the bin at this end. counts is (n_t, n), and ends is (2, n_t). Integers have the same sum in any order. */
extern "C" __global__ void count_values(
    const Study *s, long, unsigned long long *counts, const double *ends, long output, long n) {
  EACH_THREAD(thread);
  const long i = thread % s->n_t;
  if (thread >= STRIPES * s->n_t) return;
  const double low = ends[i], width = ends[s->n_t + i] - low;
  EACH_SAMPLE(j, thread / s->n_t) {
    const double z = (s->Y[(j * s->n_t + i) * N_Y + output] - low) / width * n;
    const long bin = z < n ? (z > 0.0 ? (long)z : 0) : z >= n ? n - 1 : 0; /* 0 for NaN, if the width is 0 */
    atomicAdd(counts + i * n + bin, 1ULL);
  }
}

#endif
