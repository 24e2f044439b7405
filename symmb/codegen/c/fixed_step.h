/* Fixed steps of an explicit Runge-Kutta method: every interval between two output times is cut into equal ones.

   Given before: study.h, and from the tableau stages(b) for x_new. */

static int run(Block *b, Study *s) {
  for (; b->next < s->n_t; ++b->next) {
    const double begin = s->times[b->next - 1], span = s->times[b->next] - begin;
    const long count = (long)fmax(ceil(span / s->longest - 1e-9), 1.0);
    b->h = span / count;
    for (long i = 0; i < count; ++i) {
      b->t = begin + i * b->h;
      EACH_PART(b) rates(a->x, a->c, each(b->t), a->k);
      stages(b);
      EACH_PART(b) memcpy(a->x, a->x_new, sizeof a->x);
    }
    b->t = s->times[b->next];
    observe(b);
    if (!keep(b, s, b->next, 1)) return 0;
  }
  return 1;
}
