/* An ensemble on a graphics card. Each thread runs one sample after another, and has a block of one lane. */
#ifndef KERNEL_H
#define KERNEL_H

#include "begin.h"

/* Runs the samples of a study that did not fail before. Without values, their outputs extend extremes (N_PARTIAL, n_t, N_Y),
   which groups of threads share. Few threads then wait for each other, and the extremes stay in the cache. */
extern "C" __global__ void run_samples(Study *s, double *lower, double *upper, long n_partial) {
  Block b;
  memset(&b, 0, sizeof b);
  const long n = s->n_t * N_Y, threads = (long)gridDim.x * blockDim.x;
  b.lower = lower + (s->Y ? 0 : blockIdx.x % n_partial * n);
  b.upper = upper + (s->Y ? 0 : blockIdx.x % n_partial * n);
  for (b.number = (long)blockIdx.x * blockDim.x + threadIdx.x; b.number < s->n; b.number += threads) {
    b.steps = 0;
    while (begin(&b, s) && !run(&b, s)) {}
    __atomic_fetch_add(&s->steps, b.steps, __ATOMIC_RELAXED);
  }
}

#endif
