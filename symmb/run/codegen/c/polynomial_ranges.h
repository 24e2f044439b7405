/* Ranges of polynomials in Chebyshev form on [-1, 1]^d by branch and bound, one after the other, depth first.

   Ratschek and Rokne (1988), New Computer Methods for Global Optimization. On a box with coordinates z in [-1, 1]^d, the sum of
   the terms of degree one and two is minimised exactly if there are two parameters. With more parameters, it is bounded below
   by a sum of parabolas, one for each free parameter. A product m z_i z_j is bounded by the plane through its edges at a corner
   e, m (e_j z_i + e_i z_j - e_i e_j), if it is positive at e and both parameters tend to e. Otherwise it is bounded by -|m|
   (z_i^2 + z_j^2) / 2. All other terms are bounded by |T| <= 1. If a derivative cannot vanish, the box is discarded, or its
   parameter is fixed at the end of its range.

   Terms of degree three decrease with the cube of the size of a box. So do the errors of these bounds near an extreme, and few
   halvings are enough. Bounds by |T| <= 1 alone would have errors of the size of the quadratic terms. Values near a smooth
   extreme also differ by the quadratic terms. So such bounds would leave many boxes around the extreme, of any size. */
#ifndef POLYNOMIAL_RANGES_H
#define POLYNOMIAL_RANGES_H

#include <math.h>
#include <string.h>

#define W 8 /* doubles in a vector */
enum { PATIENCE = 10, FEW = 32, STARTS = 10, PART = 16 }; /* boxes before a descent; number of terms up to which no term
   is left out; further descents; polynomials that a thread takes at once */
#define LEFT_OUT 0.05 /* fraction of the tolerance for terms left out. They change both a bound and a value */
#define PRUNED 0.9    /* fraction of the tolerance for bounds: 0.9 + 2 * 0.05 is 1 */
#define STOPPED 1073741824 /* larger than the number of polynomials */
#define RELAXED 1e-3 /* tolerance of repeated searches: smaller tolerances take hardly more boxes */
typedef double V __attribute__((vector_size(8 * W), aligned(8)));
typedef long long M __attribute__((vector_size(8 * W), aligned(8)));

typedef struct {
  long d, n, n_low, padded, order, n_samples, n_sums; /* n_low products have a degree of at most 2 */
  const int *linear, *square; /* (d) numbers of T_1 and T_2 of each parameter */
  const int *pairs;           /* for each parameter and each earlier parameter, number of their product */
  const int *parent, *factor; /* (n) a product is its parent times a value of a single parameter */
  const int *fibres;          /* (..., order + 1) fibres longer than 1 of each parameter in turn; n ends them */
  const int *first;           /* (d + 1) start of the fibres of each parameter */
  const double *weights;      /* (padded, n_sums): of derivatives along each parameter, then of terms of higher degree */
  const double *halving;      /* (order + 1, order + 1) by columns */
  const double *samples;      /* (n_samples, order + 2): x and T_j(x) */
} Basis;

typedef struct {
  const Basis *basis;
  double tolerance;        /* largest distance of a bound from a value, over the range */
  long budget, depth, proves; /* without proofs, the best values are the result if the budget is used up */
  double *stack;           /* (depth, padded + 2 d + 2) of boxes: coefficients, centre, half widths, which are 0 where
                              fixed, how many coefficients are left, and the sum of those left out */
  double *values, *powers; /* (n), (d, order + 1): of all products, and of the T_j of each parameter */
  double *x, *z;           /* (d) */
  double *slope, *local;   /* (n_sums) and (4, d) of a box: variation of the derivatives, then their values and others */
  double *terms;           /* (2, order + 1) of a single parameter */
  double *changed;         /* (padded) coefficients after the change of basis */
  long *next;              /* polynomials that threads have taken; at least STOPPED if the search is stopped */
} Search;

typedef struct {
  double best, bound, *at; /* the smallest known value, its lower bound, and its point */
} Extreme;

/* Whether the search is stopped. A single search of many parameters may take seconds, and an interrupt must not wait so
   long. */
static int is_stopped(const Search *s) { return __atomic_load_n(s->next, __ATOMIC_RELAXED) >= STOPPED; }

static double total(V a) { return ((a[0] + a[4]) + (a[1] + a[5])) + ((a[2] + a[6]) + (a[3] + a[7])); }

/* Sums (n_sums) of the absolute values of coefficients, weighted by each column of weights. The bounds of all derivatives and
   of the terms of high degree are one product of a matrix and a vector, so that coefficients are read once. */
static void weighted(const Basis *b, const double *c, long n, double *sums) {
  for (long k = 0; k < b->n_sums; k += W) {
    const double *w = b->weights + k;
    V even = {0}, odd = {0};
    for (long i = 0; i < n; i += 2, w += 2 * b->n_sums) {
      even += *(const V *)w * fabs(c[i]);
      odd += *(const V *)(w + b->n_sums) * fabs(c[i + 1]);
    }
    *(V *)(sums + k) = even + odd;
  }
}

static void chebyshev(double x, double *T, long order) {
  T[0] = 1.0;
  if (order) T[1] = x;
  for (long j = 2; j <= order; ++j) T[j] = 2.0 * x * T[j - 1] - T[j - 2];
}

static double value(const Search *s, const double *c, const double *x, long n) {
  const Basis *b = s->basis;
  for (long k = 0; k < b->d; ++k) chebyshev(x[k], s->powers + k * (b->order + 1), b->order);
  s->values[0] = 1.0;
  for (long i = 1; i < n; ++i) s->values[i] = s->values[b->parent[i]] * s->powers[b->factor[i]];
  V sum = {0};
  for (long i = 0; i < n; i += W) sum += *(const V *)(c + i) * *(const V *)(s->values + i);
  return total(sum);
}

/* The smallest value of g x + h x^2 on [-1, 1], and its x. */
static double parabola(double g, double h, double *x) {
  if (fabs(g) < 2.0 * h) {
    *x = -0.5 * g / h;
    return 0.5 * g * *x;
  }
  *x = g > 0.0 ? -1.0 : 1.0;
  return h - fabs(g);
}

/* The smallest value of g.z + h.z^2 + m z_0 z_1 on the square [-1, 1]^2, and its z. */
static double paraboloid(const double *g, const double *h, double m, double *z) {
  const double det = 4.0 * h[0] * h[1] - m * m;
  if (h[0] > 0.0 && det > 0.0) {
    const double x = m * g[1] - 2.0 * h[1] * g[0], y = m * g[0] - 2.0 * h[0] * g[1];
    if (fabs(x) < det && fabs(y) < det) {
      z[0] = x / det;
      z[1] = y / det;
      return 0.5 * (g[0] * z[0] + g[1] * z[1]);
    }
  }
  double best = INFINITY;
  for (int k = 0; k < 2; ++k)
    for (double end = -1.0; end < 2.0; end += 2.0) {
      double x;
      const double y = end * g[k] + h[k] + parabola(g[1 - k] + end * m, h[1 - k], &x);
      if (y < best) best = y, z[k] = end, z[1 - k] = x;
    }
  return best;
}

/* Leave out coefficients of high degree within the allowed error, and return the padded number of the remaining coefficients. A
   term of degree j decreases by 2^-j in each halving, so small boxes need only low degrees. */
static long trim(const Basis *b, double *c, double *left, double allowed) {
  long n = (long)left[0];
  if (b->n <= FEW) return b->padded;
  for (; n > b->n_low && left[1] + fabs(c[n - 1]) <= allowed; --n) left[1] += fabs(c[n - 1]);
  left[0] = (double)n;
  for (; n % W; ++n) c[n] = 0.0;
  return n;
}

/* Fix a parameter at the end of its range, where T_j is 1 or (-1)^j. */
static void fix(const Basis *b, double *c, long k, double end, long n) {
  for (long f = b->first[k]; f < b->first[k + 1]; ++f) {
    const int *at = b->fibres + f * (b->order + 1);
    if (at[1] >= n) continue;
    double sum = c[at[0]];
    for (long j = 1; j <= b->order && at[j] < n; ++j) {
      sum += j % 2 ? end * c[at[j]] : c[at[j]];
      c[at[j]] = 0.0;
    }
    c[at[0]] = sum;
  }
}

/* Coefficients on the half at `end`, in `near`, and on the other half, in place. The halves are mirror images of each other, so
   sums of even and odd degrees give both halves with the operations of one half. */
static void halve(const Search *s, double *c, double *near, long k, double end, long n) {
  const Basis *b = s->basis;
  const long size = b->order + 1;
  double *restrict own = s->terms;
  memcpy(near, c, (n + W - 1) / W * W * sizeof *c);
  for (long f = b->first[k]; f < b->first[k + 1]; ++f) {
    const int *at = b->fibres + f * size;
    if (at[1] >= n) continue;
    long m = 0;
    for (; m < size && at[m] < n; ++m) own[m] = c[at[m]];
    for (long i = 0; i < m; ++i) {
      const double *row = b->halving + i * size;
      double even = 0.0, odd = 0.0;
      for (long j = i; j < m; j += 2) even += row[j] * own[j];
      for (long j = i + 1; j < m; j += 2) odd += row[j] * own[j];
      near[at[i]] = even + end * odd;
      c[at[i]] = even - end * odd;
    }
  }
}

/* A lower bound of the polynomial on a box, and the point z of this bound; infinite if the box has no minimum. Parameters along
   which the polynomial is monotone are fixed. */
static double lower_bound(const Search *s, double *box, long *widest, double allowed) {
  const Basis *b = s->basis;
  const long d = b->d;
  double *c = box, *centre = box + b->padded, *half = centre + d, *left = half + d;
  double *restrict g = s->local, *restrict h = g + d, *restrict ends = h + d, *restrict near = ends + d;
  double *restrict slope = s->slope, *restrict z = s->z;
  long n = 0;
  /* A fixed parameter no longer has terms that affect the slopes of the other parameters. So the polynomial may become monotone
     along these. */
  for (int again = 1; again;) {
    again = 0;
    n = trim(b, c, left, allowed);
    weighted(b, c, n, slope);
    for (long k = 0; k < d; ++k) g[k] = c[b->linear[k]], ends[k] = g[k] > 0.0 ? -1.0 : 1.0;
    for (long k = 0; k < d; ++k) {
      if (half[k] == 0.0 || fabs(g[k]) < slope[k]) continue;
      /* The polynomial decreases through this face. If there is another box on the other side of the face, the polynomial is
         smaller there, and this box has no minimum. Terms that were left out must not change this; |T_j'| is at most j^2. */
      const double face = centre[k] + ends[k] * half[k];
      if (fabs(face) < 1.0 && fabs(g[k]) > slope[k] + b->order * b->order * left[1]) return INFINITY;
      fix(b, c, k, ends[k], n);
      centre[k] = face;
      half[k] = 0.0;
      again = 1;
    }
  }
  /* T_2 = 2 z^2 - 1 gives the squares. The parameter with the largest variation of its derivative is halved next, because its
     variation is the main reason for a wide bound. */
  double bound = c[0] - left[1] - slope[d], most = -1.0;
  for (long k = 0; k < d; ++k) {
    h[k] = 2.0 * c[b->square[k]];
    bound -= 0.5 * h[k];
    if (half[k] > 0.0 && slope[k] > most) most = slope[k], *widest = k;
  }
  if (d == 2 && half[0] > 0.0 && half[1] > 0.0) return bound + paraboloid(g, h, c[b->pairs[0]], z);
  for (long k = 0; k < d; ++k) near[k] = fabs(g[k]) >= h[k] ? ends[k] : 0.0;
  const int *pair = b->pairs;
  for (long i = 1; i < d; ++i) {
    const double ni = near[i];
    double gi = 0.0, hi = 0.0;
    for (long j = 0; j < i; ++j) {
      const double m = c[*pair++], corner = ni * near[j], push = m * corner;
      const double plane = 0.5 * (push + fabs(push)); /* without a branch, which would often be predicted wrongly */
      const double bend = 0.5 * fabs(m - plane * corner);
      gi += plane * ni;
      g[j] += plane * near[j];
      hi += bend;
      h[j] -= bend;
      bound -= plane;
    }
    g[i] += gi;
    h[i] -= hi;
  }
  for (long k = 0; k < d; ++k) {
    z[k] = 0.0;
    if (half[k] > 0.0) bound += parabola(g[k], h[k], z + k);
  }
  return bound;
}

/* A series of n Chebyshev polynomials at x, with its first two derivatives. */
static double series(const double *g, long n, double x, double *first, double *second) {
  double t = 1.0, t1 = 0.0, t2 = 0.0, u = x, u1 = 1.0, u2 = 0.0, y = g[0];
  *first = *second = 0.0;
  for (long j = 1; j < n; ++j) {
    y += g[j] * u, *first += g[j] * u1, *second += g[j] * u2;
    const double v = 2.0 * x * u - t, v1 = 2.0 * (u + x * u1) - t1, v2 = 2.0 * (2.0 * u1 + x * u2) - t2;
    t = u, t1 = u1, t2 = u2, u = v, u1 = v1, u2 = v2;
  }
  return y;
}

/* The point x at which a series is smallest on [-1, 1], and the difference from its value at the given x. The search uses the
   best of the samples, then Newton's steps. */
static double least(const Basis *b, const double *g, double *x) {
  const long n = b->order + 1;
  double first, second, to = *x, y;
  const double now = series(g, n, to, &first, &second);
  double best = now;
  for (long i = 0; i < b->n_samples; ++i) {
    const double *sample = b->samples + i * (n + 1);
    y = 0.0;
    for (long j = 0; j < n; ++j) y += g[j] * sample[1 + j];
    if (y < best) best = y, *x = to = sample[0];
  }
  for (int step = 0; step < 4; ++step) {
    y = series(g, n, to, &first, &second);
    if (y < best) best = y, *x = to;
    if (!(second > 0.0)) break;
    to = fmin(fmax(to - first / second, -1.0), 1.0);
  }
  return now - best;
}

/* Descend from s->x along one parameter after another, as long as the value decreases. Each line search is global, so it leaves
   local minima at which a descent along the gradient would end. */
static void descend(const Search *s, const double *c, Extreme *e, double enough) {
  const Basis *b = s->basis;
  const long size = b->order + 1;
  double *T = s->terms, *g = T + size, gain = INFINITY;
  value(s, c, s->x, b->n);
  for (int sweep = 0; sweep < 20 && gain > enough && !is_stopped(s); ++sweep) {
    gain = 0.0;
    for (long k = 0; k < b->d; ++k) {
      memset(g, 0, size * sizeof *g);
      for (long f = b->first[k]; f < b->first[k + 1]; ++f) {
        const int *at = b->fibres + f * size;
        for (long j = 0; j < size && at[j] < b->n; ++j) g[j] += s->values[at[0]] * c[at[j]];
      }
      const double gained = least(b, g, s->x + k);
      if (!(gained > 0.0)) continue;
      gain += gained;
      chebyshev(s->x[k], T, b->order);
      for (long f = b->first[k]; f < b->first[k + 1]; ++f) {
        const int *at = b->fibres + f * size;
        for (long j = 1; j < size && at[j] < b->n; ++j) s->values[at[j]] = s->values[at[0]] * T[j];
      }
    }
  }
  const double y = value(s, c, s->x, b->n);
  if (y < e->best) {
    e->best = y;
    memcpy(e->at, s->x, b->d * sizeof *s->x);
  }
}

/* Descend repeatedly from the best point, with a quarter of the parameters moved to the other end. With many parameters, most
   extremes are at corners, and a search by boxes cannot visit all corners. */
static void explore(const Search *s, const double *c, Extreme *e, double enough) {
  unsigned long long random = 88172645463325252ULL; /* Marsaglia's xorshift (2003) */
  for (int start = 0; start < STARTS; ++start) {
    for (long k = 0; k < s->basis->d; ++k) {
      random ^= random << 13, random ^= random >> 7, random ^= random << 17;
      s->x[k] = random % 4 ? e->at[k] : e->at[k] > 0.0 ? -1.0 : 1.0;
    }
    descend(s, c, e, enough);
  }
}

/* Searches the smallest value, with an error of `share` times the range up to `top`, and of `floor` by rounding. Returns 0 if
   the budget is used up. */
static int search(const Search *s, const double *c, Extreme *e, double top, double share, double floor) {
  const Basis *b = s->basis;
  const long own = 2 * b->d + 2, stride = b->padded + own;
  long used = 1, widest = 0, count = 0;
  memcpy(s->stack, c, b->padded * sizeof *c);
  for (long k = 0; k < b->d; ++k) s->stack[b->padded + k] = 0.0, s->stack[b->padded + b->d + k] = 1.0;
  s->stack[stride - 2] = (double)b->n;
  s->stack[stride - 1] = 0.0;
  e->bound = INFINITY;
  /* Depth first: the stack has at most one box for each halving, while the list of a best-first search would grow without
     limit. A disadvantage is that some boxes are examined that a better value would have excluded. It is small, because good
     values are found early: at corners, at the points of bounds, and by descents. */
  while (used && !is_stopped(s)) {
    double *box = s->stack + --used * stride, *centre = box + b->padded, *half = centre + b->d;
    if (++count > s->budget || used + 2 > s->depth) return 0;
    /* The tolerance is relative to the range between the best known values. It grows with each better value. */
    double slack = share * (top - e->best) + floor;
    const double bound = lower_bound(s, box, &widest, LEFT_OUT * slack);
    if (bound < e->best - PRUNED * slack) {
      const long n = (long)half[b->d];
      const double y = value(s, box, s->z, n);
      if (y < e->best) {
        e->best = y;
        for (long k = 0; k < b->d; ++k) e->at[k] = centre[k] + half[k] * s->z[k];
        if (count > PATIENCE) { /* easy searches end before this: a descent costs as much as many boxes */
          memcpy(s->x, e->at, b->d * sizeof *s->x);
          descend(s, c, e, 0.1 * slack);
        }
        slack = share * (top - e->best) + floor;
      }
      if (bound < e->best - PRUNED * slack) {
        double *near = box + stride;
        /* The half with the point of the bound is put on top and is searched next, because it has the better values. */
        const double end = s->z[widest] > 0.0 ? 1.0 : -1.0;
        halve(s, box, near, widest, end, n);
        half[widest] *= 0.5;
        memcpy(near + b->padded, centre, own * sizeof *c);
        near[b->padded + widest] += end * half[widest];
        centre[widest] -= end * half[widest];
        used += 2;
        continue;
      }
    }
    if (!(bound >= e->bound)) e->bound = bound;
  }
  if (!(e->best >= e->bound)) e->bound = e->best;
  return 1;
}

/* Bounds of a polynomial, and points with values close to the bounds. `gaps` are the distances of the bounds from these values
   if the budget was used up, otherwise 0. The coefficients are overwritten. */
static void range(const Search *s, double *c, double *found, double *const *at, double *gaps) {
  const Basis *b = s->basis;
  double floor = 0.0;
  Extreme two[] = {{0.0, 0.0, at[0]}, {0.0, 0.0, at[1]}};
  for (long j = 0; j < b->n; ++j) floor = fabs(c[j]) > floor ? fabs(c[j]) : floor;
  floor *= 1e-13;
  for (long k = 0; k < b->d; ++k) {
    two[0].at[k] = c[b->linear[k]] > 0.0 ? -1.0 : 1.0;
    two[1].at[k] = -two[0].at[k];
  }
  double y[] = {value(s, c, two[0].at, b->n), value(s, c, two[1].at, b->n)};
  if (y[0] > y[1]) {
    for (long k = 0; k < b->d; ++k) two[0].at[k] *= -1.0, two[1].at[k] *= -1.0;
    const double other = y[0];
    y[0] = y[1], y[1] = other;
  }
  two[0].best = y[0];
  two[1].best = -y[1];
  long steady = 0;
  weighted(b, c, b->padded, s->slope);
  for (long k = 0; k < b->d; ++k) steady += fabs(c[b->linear[k]]) >= s->slope[k];
  if (steady == b->d) { /* monotone: both extremes are at corners */
    found[0] = y[0], found[1] = y[1];
    gaps[0] = gaps[1] = 0.0;
    return;
  }
  /* The maximum is the minimum of the negative polynomial. */
  for (int side = 0; side < 2; ++side) {
    Extreme *e = two + side, *other = two + 1 - side;
    double loose = 1.0;
    /* An unfinished search proves nothing, because boxes on its stack have no bounds yet. It is repeated with a tolerance of at
       least RELAXED, because smaller tolerances would use up the budget again. */
    while (!search(s, c, e, -other->best, loose * s->tolerance, loose * floor)) {
      if (loose == 1.0) explore(s, c, e, RELAXED * (-other->best - e->best));
      if (!s->proves) {
        e->bound = e->best;
        break;
      }
      loose = fmax(4.0 * loose, RELAXED / s->tolerance);
    }
    gaps[side] = loose > 1.0 ? value(s, c, e->at, b->n) - e->bound : 0.0;
    for (long j = 0; j < b->n; ++j) c[j] = -c[j];
  }
  found[0] = two[0].bound;
  found[1] = -two[1].bound;
}

/* Coefficients C (m, padded) -> bounds (2, m), points (2, m, d) and gaps (2, m). With a change of basis (n_given, padded), the
   given coefficients have another basis, (n_given, m). Without it, C is overwritten. */
void ranges(const Search *s, long m, double *C, const double *change, long n_given, double *found, double *points,
            double *gaps);
void ranges(const Search *s, long m, double *C, const double *change, long n_given, double *found, double *points,
            double *gaps) {
  const Basis *b = s->basis;
  for (long i; (i = __atomic_fetch_add(s->next, PART, __ATOMIC_RELAXED)) < m;)
    for (const long end = i + PART < m ? i + PART : m; i < end; ++i) {
      double y[2], gap[2], *at[] = {points + i * b->d, points + (m + i) * b->d};
      for (long k = 0; change && k < b->padded; k += W) {
        V sum = {0};
        for (long j = 0; j < n_given; ++j) sum += C[j * m + i] * *(const V *)(change + j * b->padded + k);
        *(V *)(s->changed + k) = sum;
      }
      range(s, change ? s->changed : C + i * b->padded, y, at, gap);
      for (int side = 0; side < 2; ++side) found[side * m + i] = y[side], gaps[side * m + i] = gap[side];
    }
}

#endif
