/* Runs of a scene and its scalar outputs. scene.c is a part of this file, because a run is copied before each panel: a panel that
   is too long for its polynomials runs again from the copy. */
#include "scene.c"

/* A scalar output. `expression` and `margin` are numbers of its curves, of which it may have only one. */
typedef struct {
  enum { MAXIMUM, MINIMUM, FINAL, MEAN, FIRST_TIME, VALUE_AT } kind;
  int expression, margin, is_strict;
  long column;                    /* of the outputs */
  double begin, end, per_second;  /* window [s], and units of time per second */
} Rule;

#include "rules.h"

#define EXPORT(name) __attribute__((export_name(#name)))
#define EXACT 1e-6     /* largest fourth difference of a curve in a panel, over the size of the curve */
#define TOUCHED 1e-9   /* largest margin that counts as zero, over its size */
#define SHORTEST_PANEL 1e-10 /* over the length of the run. Jumps and kinks are in panels of this length */
enum { PANELS = 64, MOST_PANELS = 50000 }; /* panels of a smooth run; a run with more panels has noise instead of curves */

static Scene *scene;
static const char *why = "there is not enough memory";
static long row; /* number of the next output time */

/* Continues the run to time t, and stores the first n outputs at each output time until then. Times that differ by rounding are
   equal, because no step fits between them. */
static int go_to(double t, long n, double *out) {
  const double rounding = 1e-12 * (scene_times[SCENE_N_T - 1] - scene_times[0]);
  while (row < SCENE_N_T && scene_times[row] <= t + rounding) {
    const double due = scene_times[row];
    if (!scene_step(scene, due)) return 0;
    memcpy(out + row++ * n, scene_outputs(scene), n * sizeof *out);
    if (due >= t - rounding) return 1;
  }
  return scene_step(scene, t);
}

#if N_RULES
static double values[N_CURVES][5], sizes[N_CURVES]; /* of the curves of scalar outputs, at five times of a panel */
static struct {
  double value;
  int has_held, is_above; /* the condition so far, and its margin at the end of the panel before */
} found[N_RULES];

/* The polynomial of degree 4 through values at s = 0, 1, 2, 3 and 4. */
static double polynomial(const double *y, double s) {
  double d[5], sum = 0.0, product = 1.0;
  memcpy(d, y, sizeof d);
  for (int i = 0; i < 5; ++i) {
    sum += product * d[0];
    product *= (s - i) / (i + 1);
    for (int j = 0; j < 4 - i; ++j) d[j] = d[j + 1] - d[j];
  }
  return sum;
}

/* Where sign times the polynomial is highest; for a curve that may jump, where it is highest at its five times. */
static double highest(const double *y, double sign, int may_jump) {
  int best = 0;
  for (int j = 1; j < 5; ++j)
    if (sign * y[j] > sign * y[best]) best = j;
  if (may_jump) return best;
  double low = best ? best - 1 : 0, high = best < 4 ? best + 1 : 4;
  for (int i = 0; i < 60; ++i) {
    const double a = (2.0 * low + high) / 3.0, b = (low + 2.0 * high) / 3.0;
    if (sign * polynomial(y, a) < sign * polynomial(y, b)) low = a;
    else high = b;
  }
  const double middle = 0.5 * (low + high);
  return sign * polynomial(y, middle) > sign * y[best] ? middle : best;
}

/* Where a margin first falls to zero, or -1. A margin that has stayed at zero must fall below zero. */
static double passage(const double *y, double tolerance) {
  double low = 0.0, high = -1.0;
  for (int j = 0; j < 4 && high < 0.0; ++j)
    if ((y[j] > tolerance && y[j + 1] <= tolerance) || (y[j] >= -tolerance && y[j + 1] < -tolerance)) low = j, high = j + 1;
  if (high < 0.0 && y[0] > tolerance) { /* between two nodes */
    const double s = highest(y, -1.0, 0);
    if (polynomial(y, s) > tolerance) return -1.0;
    low = floor(s), high = s;
  }
  if (high < 0.0) return -1.0;
  const double level = polynomial(y, low) > tolerance ? 0.0 : -tolerance;
  if (polynomial(y, high) > level) return high;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    if (polynomial(y, middle) > level) low = middle;
    else high = middle;
  }
  return high;
}

/* What the panel from a to b adds to a scalar output. */
static void add_panel(int number, double a, double b, int is_shortest) {
  const Rule *r = rules + number;
  const double *y = values[r->expression], *g = values[r->margin], width = b - a;
  if (a + 0.5 * width < r->begin || a + 0.5 * width > r->end) return;
  const int is_first = a <= r->begin;
  double *value = &found[number].value, s;
  switch (r->kind) {
    case FINAL: *value = y[4]; return;
    case MEAN: *value += width / (r->end - r->begin) * (7.0 * (y[0] + y[4]) + 32.0 * (y[1] + y[3]) + 12.0 * y[2]) / 90.0; return;
    case MAXIMUM:
    case MINIMUM:
      s = polynomial(y, highest(y, r->kind == MAXIMUM ? 1.0 : -1.0, is_shortest));
      if (is_first || (r->kind == MAXIMUM ? s > *value : s < *value)) *value = s;
      return;
  }
  if (found[number].has_held) return;
  double low = g[0], high = g[0], tolerance = TOUCHED * sizes[r->margin];
  for (int j = 1; j < 5; ++j) low = fmin(low, g[j]), high = fmax(high, g[j]);
  if (is_shortest) tolerance += high - low;
  const int falls = 1e3 * (polynomial(g, 1e-3) - g[0]) < -tolerance; /* a strict condition holds immediately after the start */
  const int holds_at_start = is_first && (g[0] < -tolerance || (g[0] <= tolerance && (!r->is_strict || falls)));
  s = holds_at_start || (!is_first && found[number].is_above && g[0] <= tolerance) ? 0.0 : passage(g, tolerance);
  found[number].is_above = g[4] > tolerance;
  if (s < 0.0) return;
  found[number].has_held = 1;
  *value = r->kind == VALUE_AT ? polynomial(y, is_shortest ? 0.0 : s) : (a + 0.25 * s * width) * r->per_second;
}

/* The run in panels, which are as long as polynomials of degree 4 allow. */
static int run_panels(long n, double *out) {
  static Scene *copy;
  const double begin = scene_times[0], end = scene_times[SCENE_N_T - 1], *now = scene_outputs(scene) + FIRST_CURVE;
  double a = begin, length = (end - begin) / PANELS;
  if (!copy && !(copy = scene_new())) return why = "there is not enough memory", 0;
  memset(found, 0, sizeof found);
  for (int c = 0; c < N_CURVES; ++c) sizes[c] = least_sizes[c], values[c][4] = now[c];
  for (long count = 0; a < end; ++count) {
    const long first_row = row;
    double b = a + 1.001 * length < end ? a + length : end, misfit = 0.0;
    for (int k = 0; k < N_RULES; ++k) {
      if (a < rules[k].begin && rules[k].begin < b) b = rules[k].begin;
      if (a < rules[k].end && rules[k].end < b) b = rules[k].end;
    }
    *copy = *scene;
    for (int c = 0; c < N_CURVES; ++c) values[c][0] = values[c][4];
    for (int j = 1; j < 5; ++j) {
      if (!go_to(j < 4 ? a + 0.25 * j * (b - a) : b, n, out)) return 0;
      for (int c = 0; c < N_CURVES; ++c) values[c][j] = now[c];
    }
    for (int c = 0; c < N_CURVES; ++c) {
      const double *y = values[c];
      for (int j = 0; j < 5; ++j) sizes[c] = fmax(sizes[c], fabs(y[j]));
      misfit = fmax(misfit, fabs(y[0] - 4.0 * y[1] + 6.0 * y[2] - 4.0 * y[3] + y[4]) / (EXACT * sizes[c]));
    }
    const int is_shortest = b - a <= SHORTEST_PANEL * (end - begin);
    if (misfit > 1.0 && !is_shortest && count < MOST_PANELS) {
      *scene = *copy;
      row = first_row;
      for (int c = 0; c < N_CURVES; ++c) values[c][4] = values[c][0];
      length = 0.5 * (b - a);
      continue;
    }
    for (int k = 0; k < N_RULES; ++k) add_panel(k, a, b, is_shortest);
    a = b;
    if (misfit < 0.03 || count >= MOST_PANELS) length = fmin(2.0 * length, (end - begin) / PANELS);
  }
  for (int k = 0; k < N_RULES; ++k) {
    if (rules[k].kind >= FIRST_TIME && !found[k].has_held) return why = missing[k], 0;
    if (rules[k].column < n)
      for (long i = 0; i < SCENE_N_T; ++i) out[i * n + rules[k].column] = found[k].value;
  }
  return 1;
}
#endif

/* The first n outputs at each time (n_t, n) of a run with parameters p. Returns the number of times that the run reaches. */
long EXPORT(run) run_scene(const double *p, long n, double *out) {
  if (!scene && !(scene = scene_new())) return 0;
  why = NULL;
  row = 0;
  memcpy(scene_parameters(scene), p, SCENE_N_P * sizeof *p);
  if (!scene_start(scene, scene_times[SCENE_N_T - 1], 0.0)) return 0;
#if N_RULES
  const int is_done = run_panels(n, out);
#else
  const int is_done = go_to(scene_times[SCENE_N_T - 1], n, out);
#endif
  return is_done ? SCENE_N_T : row < SCENE_N_T ? row : SCENE_N_T - 1;
}

/* Why the last run has ended. */
const char *EXPORT(fault) fault_of_run(void) { return why ? why : scene_fault(scene); }
