/* Fixed steps of an explicit Runge-Kutta method: every interval between two output times is cut into equal ones.

   Given before: study.h, and from the tableau stages(b) for x_new. */

static int run(Block *b, Study *s) {
  for (; b->next < s->n_t; ++b->next) {
    const double begin = s->times[b->next - 1], span = s->times[b->next] - begin;
    const long count = (long)fmax(ceil(span / s->longest - 1e-9), 1.0);
    b->h = span / count;
    for (long i = 0; i < count; ++i) {
      b->t = begin + i * b->h;
      rates(b->x, b->c, each(b->t), b->k);
      stages(b);
      memcpy(b->x, b->x_new, sizeof b->x);
    }
    b->t = s->times[b->next];
#if PROJECTED
    project(b->x, b->c, each(b->t), b->x_new);
    memcpy(b->x, b->x_new, sizeof b->x);
#endif
    outputs(b->x, b->c, each(b->t), b->y);
    if (!keep(b, s, b->next, 1)) return 0;
  }
  return 1;
}
