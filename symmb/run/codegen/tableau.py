"""C code of the sums over slopes in a step, from the tableau of the method.

Slopes k are stored for the last N_OWN states v. The first N_INTEGRALS = N_X - N_OWN states x are the integrals of the
first states v, x' = v, and are mostly positions. The slope of x in stage s is the v of this stage,
v + h sum_j a_sj k_j. Therefore x is a sum of the slopes of v with the weights A A, as in Nystrom's methods for
second-order equations (Hairer, Norsett, Wanner 1993, section II.14). Only half of all slopes are computed, stored and
loaded. If N_INTEGRALS is 0, the code for states x is left out, because compilers would need time to read it.
"""

from collections.abc import Iterable, Mapping, Sequence

from symmb.run.schemes import ROUNDED_STEP, STEP_CONTROL, Tableau, dop853

Weights = Mapping[int, float]


def explicit_stages(tableau: Tableau, integrals: bool) -> str:
    """C code of the stages of an explicit Runge-Kutta method. The method has at most 12 stages, see `_place`.

    `integrals`: whether N_INTEGRALS is above 0.
    """
    return "\n".join(_stages(range(1, len(tableau.A)), tableau.A, tableau.C, tableau.B, integrals))


def pair(integrals: bool) -> str:
    """C code of the stages, error estimates and interpolant of the pair of Dormand and Prince.

    `integrals`: whether N_INTEGRALS is above 0.
    """
    A, C = dop853.A, dop853.C
    of_order_3, of_order_5 = dop853.E
    return "\n".join(
        [
            f"#define END {_place(12)}",
            *(f"#define {name} {value!r}" for name, value in vars(STEP_CONTROL).items()),
            f"#define ROUNDED_STEP {ROUNDED_STEP!r}",
            f"#define LAST_STAGE {C[15]!r}",
            *_stages(range(1, 12), A, C, dop853.B, integrals),
            "PRIVATE void errors(const Part *a, double h, V *e5, V *e3) {",
            "  const V *k = a->k;",
            *_only_if(not integrals, "  (void)h;"),
            "  for (int m = 0; m < N_OWN; ++m) {",
            f"    e5[N_INTEGRALS + m] = {_sum(of_order_5)};",
            f"    e3[N_INTEGRALS + m] = {_sum(of_order_3)};",
            "  }",
            *_only_if(
                integrals,
                "  for (int m = 0; m < N_INTEGRALS; ++m) {",
                f"    e5[m] = h * ({_sum(_through(of_order_5, A))});",
                f"    e3[m] = h * ({_sum(_through(of_order_3, A))});",
                "  }",
            ),
            "}",
            "PRIVATE void interpolant(Block *b) {",
            "  const double h = b->h;",
            *(line for s in range(13, 16) for line in _stage(s, A, C, integrals)),
            "  EACH_PART(b) {",
            "    const V *k = a->k;",
            "    for (int u = 0; u < N_USED; ++u) {",
            "      const int i = used[u], own = i >= N_INTEGRALS, m = own ? i - N_INTEGRALS : i;",
            "      V *f = a->F + 7 * u, d = a->x_new[i] - a->x[i];",
            "      const V first = slope(a->x, k, i), last = slope(a->x_new, k + END * N_OWN, i);",
            "      f[0] = d;",
            "      f[1] = h * first - d;",
            "      f[2] = 2 * d - h * (last + first);",
            "      if (own) {",
            *(f"        f[{3 + r}] = h * ({_sum(row)});" for r, row in enumerate(dop853.D)),
            *_only_if(
                integrals,
                "      } else {",
                *(
                    f"        f[{3 + r}] = h * ({sum(row.values())!r} * first + h * ({_sum(_through(row, A))}));"
                    for r, row in enumerate(dop853.D)
                ),
            ),
            "      }",
            "    }",
            "  }",
            "}",
        ]
    )


def _only_if(needed: bool, *lines: str) -> tuple[str, ...]:
    return lines if needed else ()


def _stages(stages: Iterable[int], A: Sequence[Weights], C: Sequence[float], B: Weights, integrals: bool) -> list[str]:
    return [
        "PRIVATE void stages(Block *b) {",
        "  const double h = b->h;",
        *(line for s in stages for line in _stage(s, A, C, integrals)),
        *_each_part(_advance("x_new", B, 1.0, A, integrals)),
        "}",
    ]


def _stage(s: int, A: Sequence[Weights], C: Sequence[float], integrals: bool) -> list[str]:
    rates = f"rates(a->x_at, a->c, each(between_stops(b, b->t + {C[s]!r} * h)), k + {_place(s)} * N_OWN);"
    return _each_part([*_advance("x_at", A[s], C[s], A, integrals), rates])


def _each_part(lines: Iterable[str]) -> list[str]:
    return ["  EACH_PART(b) {", "    V *k = a->k;", *(f"    {line}" for line in lines), "  }"]


def _advance(to: str, weights: Weights, fraction: float, A: Sequence[Weights], integrals: bool) -> list[str]:
    """Statements that write the states after a fraction of the step to `to`."""
    return [
        *_only_if(
            integrals,
            "for (int m = 0; m < N_INTEGRALS; ++m) {",
            f"  const V once = {_sum(weights)}, twice = {_sum(_through(weights, A))};",
            f"  a->{to}[m] = a->x[m] + {fraction!r} * h * a->x[N_INTEGRALS + m] + h * h * twice;",
            f"  a->{to}[N_INTEGRALS + m] = a->x[N_INTEGRALS + m] + h * once;",
            "}",
        ),
        "for (int i = 2 * N_INTEGRALS, m = N_INTEGRALS; i < N_X; ++i, ++m)",
        f"  a->{to}[i] = a->x[i] + h * ({_sum(weights)});",
    ]


def _through(weights: Weights, A: Sequence[Weights]) -> Weights:
    """Weights of the slopes in a weighted sum of the velocities of stages."""
    total: dict[int, float] = {}
    for stage, weight in weights.items():
        for j, a in A[stage].items():
            total[j] = total.get(j, 0.0) + weight * a
    return total


def _sum(weights: Weights) -> str:
    """A weighted sum of slopes in C. It is split into two sums, because each addition waits for the previous one."""
    terms = [f"{value!r} * k[{_place(j)} * N_OWN + m]" for j, value in weights.items()]
    if len(terms) < 5:
        return " + ".join(terms) or "zero()"
    half = len(terms) // 2
    return f"({' + '.join(terms[:half])}) + ({' + '.join(terms[half:])})"


def _place(stage: int) -> int:
    """Place of a slope in k. 12 and 13 have the places of 1 and 2, which are no longer needed; 14 and 15 follow 11."""
    return {12: 1, 13: 2, 14: 12, 15: 13}.get(stage, stage)


PAIR_STAGES = len({_place(stage) for stage in range(len(dop853.A))})
"""Number of places in k for the slopes of the pair of Dormand and Prince."""
