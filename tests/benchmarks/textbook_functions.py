"""Sobol indices and probabilities of textbook functions, and p-boxes of everyday machines, against NumPy sampling.

    PYTHONPATH=.:tests python tests/benchmarks/textbook_functions.py [sobol] [reliability] [p-boxes] [--seed 0]

Seed 0 is the function as published; others move and stretch the intervals of indices, and choose other closed forms
of probabilities. Indices are compared with those of Saltelli's and Jansen's estimators by 2^17 samples, probabilities
with closed forms or sampling, p-boxes with runs at corners and inside of the intervals for 900 samples of the others.
"""

import argparse
import time
import warnings

import numpy as np
import scipy.stats as st
from scipy.stats import qmc

import symmb as mb
from symmb.run.simulation import Subject

PI = np.pi


def ishigami(x1, x2, x3):
    return np.sin(x1) + 7 * np.sin(x2) ** 2 + 0.1 * x3**4 * np.sin(x1)


def borehole(rw, r, Tu, Hu, Tl, Hl, L, Kw):
    g = np.log(r / rw)
    return 2 * PI * Tu * (Hu - Hl) / (g * (1 + 2 * L * Tu / (g * rw**2 * Kw) + Tu / Tl))


def wing_weight(Sw, Wfw, A, Lam, q, lam, tc, Nz, Wdg, Wp):
    c = np.cos(np.radians(Lam))
    plate = 0.036 * Sw**0.758 * Wfw**0.0035 * (A / c**2) ** 0.6 * q**0.006 * lam**0.04 * (100 * tc / c) ** -0.3
    return plate * (Nz * Wdg) ** 0.49 + Sw * Wp


def otl_circuit(Rb1, Rb2, Rf, Rc1, Rc2, beta):
    V, D = 12 * Rb2 / (Rb1 + Rb2), beta * (Rc2 + 9) + Rf
    return (V + 0.74) * beta * (Rc2 + 9) / D + 11.35 * Rf / D + 0.74 * Rf * beta * (Rc2 + 9) / (D * Rc1)


def piston(M, S, V0, k, P0, Ta, T0):
    A = P0 * S + 19.62 * M - k * V0 / S
    V = S / (2 * k) * (np.sqrt(A**2 + 4 * k * P0 * V0 / T0 * Ta) - A)
    return 2 * PI * np.sqrt(M / (k + S**2 * P0 * V0 / T0 * Ta / V**2))


def flood(Q, Ks, Zv, Zm, Hd=8.0, Cb=55.5, L=5000.0, B=300.0):
    return Zv + (Q / (B * Ks * np.sqrt((Zm - Zv) / L))) ** 0.6 - Hd - Cb


def beam(L, b, h, E, F):
    return F * L**3 / (48 * E * b * h**3 / 12)


def sobol_g(**x):
    a = np.array([0, 1, 4.5, 9, 99, 99, 99, 99])
    return np.prod([(np.abs(4 * v - 2) + c) / (1 + c) for v, c in zip(x.values(), a, strict=True)], axis=0)


def one_way_clutch(hub, r1, r2, cage):
    return np.degrees(np.arccos((hub + (r1 + r2) / 2) / (cage - (r1 + r2) / 2)))


def friedman(x1, x2, x3, x4, x5):
    return 10 * np.sin(PI * x1 * x2) + 20 * (x3 - 0.5) ** 2 + 10 * x4 + 5 * x5


def robot_arm(**x):
    turns, lengths = np.array([*x.values()][:4]).cumsum(axis=0), np.array([*x.values()][4:])
    return np.hypot((lengths * np.cos(turns)).sum(axis=0), (lengths * np.sin(turns)).sum(axis=0))


FUNCTIONS = {
    ishigami: {"x1": (-PI, PI), "x2": (-PI, PI), "x3": (-PI, PI)},
    borehole: {
        "rw": (0.05, 0.15), "r": (100, 50000), "Tu": (63070, 115600), "Hu": (990, 1110), "Tl": (63.1, 116),
        "Hl": (700, 820), "L": (1120, 1680), "Kw": (9855, 12045),
    },
    wing_weight: {
        "Sw": (150, 200), "Wfw": (220, 300), "A": (6, 10), "Lam": (-10, 10), "q": (16, 45), "lam": (0.5, 1),
        "tc": (0.08, 0.18), "Nz": (2.5, 6), "Wdg": (1700, 2500), "Wp": (0.025, 0.08),
    },
    otl_circuit: {
        "Rb1": (50, 150), "Rb2": (25, 70), "Rf": (0.5, 3), "Rc1": (1.2, 2.5), "Rc2": (0.25, 1.2), "beta": (50, 300),
    },
    piston: {
        "M": (30, 60), "S": (0.005, 0.02), "V0": (0.002, 0.01), "k": (1000, 5000), "P0": (90000, 110000),
        "Ta": (290, 296), "T0": (340, 360),
    },
    flood: {
        "Q": (500, 3000), "Ks": (15, 50), "Zv": (49, 51), "Zm": (54, 56), "Hd": (7, 9), "Cb": (55, 56),
        "L": (4990, 5010), "B": (295, 305),
    },
    beam: {"L": (4.7, 5.3), "b": (0.17, 0.232), "h": (0.34, 0.465), "E": (2e4, 4.3e4), "F": (0.053, 0.18)},
    sobol_g: {f"x{i}": (0.0, 1.0) for i in range(8)},
    one_way_clutch: {
        "hub": (55.163, 55.417), "r1": (22.8498, 22.8702), "r2": (22.8498, 22.8702), "cage": (101.473, 101.727),
    },
    friedman: {f"x{i}": (0.0, 1.0) for i in range(1, 6)},
    robot_arm: {**{f"t{i}": (0, 2 * PI) for i in range(4)}, **{f"l{i}": (0, 1) for i in range(4)}},
}  # fmt: skip


def bounds_of(f, box):
    nominal = {name: (low + high) / 2 for name, (low, high) in box.items()}
    simulator = mb.FunctionSimulator(lambda **p: np.atleast_1d(f(**p)), nominal, [0.0], ["y"])
    return mb.propagate(simulator, mb.PolynomialChaos(), mb.Box(**box))


def true_indices(f, box):
    """First and total, (d,) each."""
    low, high = np.array([*box.values()], dtype=float).T
    A, B = np.split(qmc.Sobol(2 * len(box), seed=3).random(2**17), 2, axis=1)

    def values(u):
        return f(**dict(zip(box, (low + u * (high - low)).T, strict=True)))

    at_a, at_b = values(A), values(B)
    variance, first, total = np.var([at_a, at_b]), [], []
    for i in range(len(box)):
        mixed = A.copy()
        mixed[:, i] = B[:, i]
        at_mixed = values(mixed)
        first.append(((at_b - at_a.mean()) * (at_mixed - at_a)).mean() / variance)
        total.append(np.square(at_a - at_mixed).mean() / 2 / variance)
    return np.array(first), np.array(total)


def indices(rng):
    for f, box in FUNCTIONS.items():
        own = dict(box)
        if rng is not None:
            own = {k: sorted(a + (b - a) * rng.uniform([0, 0.7], [0.3, 1.0])) for k, (a, b) in box.items()}
            own = {k: (float(a), float(b)) for k, (a, b) in own.items()}
        begin = time.process_time()
        bounds = bounds_of(f, own)
        found = bounds.contributions()
        seconds = time.process_time() - begin
        first, total = true_indices(f, own)
        error = max(np.abs(found.first[0, 0] - first).max(), np.abs(found.total[0, 0] - total).max())
        told = found.share_estimate[0, 0]
        runs = f"{bounds.evaluations} + {found.runs} runs, {seconds:.1f} s"
        print(f"{f.__name__:15s} error {error:.4f} told {told:.4f} {runs} {'' if error <= told <= 0.05 else 'WRONG'}")


def four_branches(x0, x1, more=0.0):
    a, b = 3 + 0.1 * (x0 - x1) ** 2, 7 / 2**0.5
    sides = (a - (x0 + x1) / 2**0.5, a + (x0 + x1) / 2**0.5, x0 - x1 + b, x1 - x0 + b)
    return np.min(sides, axis=0) + more


def cantilever(w, t, R, X, Y):
    return 1 - (600 / (w * t**2) * Y + 600 / (w**2 * t) * X) / R


def roof_truss(q, length, As, Ac, Es, Ec):
    return q * length**2 / 2 * (3.81 / (Ac * Ec) + 1.13 / (As * Es))


def wide(laws):
    return {name: (float(law.ppf(1e-10)), float(law.isf(1e-10))) for name, law in laws.items()}


def normals(**numbers):
    return {name: st.norm(mean, deviation) for name, (mean, deviation) in numbers.items()}


STANDARD = normals(x0=(0, 1), x1=(0, 1))
CANTILEVER = normals(w=(2.4484, 0.05), t=(3.8884, 0.05), R=(40000, 2000), X=(500, 100), Y=(1000, 100))
ROOF = normals(
    q=(20000, 1400), length=(12, 0.12), As=(9.82e-4, 5.982e-5), Ac=(0.04, 0.0048), Es=(1e11, 6e9), Ec=(2e10, 1.2e9)
)
OTL = {name: st.norm((a + b) / 2, (b - a) / 8) for name, (a, b) in FUNCTIONS[otl_circuit].items()}
FLOOD = {"Q": st.gumbel_r(1013, 558), "Ks": st.norm(30, 7.5), "Zv": st.triang(0.5, 49, 2), "Zm": st.triang(0.5, 54, 2)}
FLOOD_BOX = {"Q": (500, 6000), "Ks": (15, 60), "Zv": (49, 51), "Zm": (54, 56)}
PUBLISHED = {
    "four branches": (four_branches, wide(STANDARD), STANDARD, {"below": 0.0}),
    "four rare branches": (lambda **x: four_branches(**x, more=1.2), wide(STANDARD), STANDARD, {"below": 0.0}),
    "cantilever": (cantilever, wide(CANTILEVER), CANTILEVER, {"below": 0.0}),
    "rare cantilever": (cantilever, wide(CANTILEVER), CANTILEVER, {"below": -0.12}),
    "roof truss": (roof_truss, wide(ROOF), ROOF, {"above": 0.03}),
    "rare roof truss": (roof_truss, wide(ROOF), ROOF, {"above": 0.036}),
    "OTL circuit": (otl_circuit, FUNCTIONS[otl_circuit], OTL, {"above": 6.9}),
    "rare OTL circuit": (otl_circuit, FUNCTIONS[otl_circuit], OTL, {"above": 7.6}),
    "flood": (flood, FLOOD_BOX, FLOOD, {"above": -5.0}),
}


def closed_forms(rng, count):
    """Events of 2 to 8 parameters, of probabilities from 1e-7 to 0.1."""
    for _ in range(count):
        kind, d, p = rng.integers(5), int(rng.integers(2, 9)), 10 ** rng.uniform(-7, -1)
        if kind == 1:
            d = min(d, 4)
        names = [f"x{i}" for i in range(d)]
        c = rng.uniform(0.2, 1, d) * rng.choice([-1, 1], d)
        f, law, ends, above = [
            (lambda x, c=c: c @ x, st.norm(), (-7, 7), st.norm.isf(p) * np.linalg.norm(c)),
            (lambda x: np.square(x).sum(axis=0), st.norm(), (-7, 7), st.chi2(d).isf(p)),
            (lambda x: x.sum(axis=0), st.expon(), (0, 35), st.gamma(d).isf(p)),
            (lambda x: x.prod(axis=0), st.lognorm(0.1), (0.495, 2.02), st.lognorm(0.1 * d**0.5).isf(p)),
            (lambda x: x.max(axis=0), st.norm(), (-7, 7), st.norm.isf(-np.expm1(np.log1p(-p) / d))),
        ][kind]
        what = "sum squares exponentials product series".split()[kind]

        def response(f=f, **x):
            return f(np.array([*x.values()]))

        yield (
            f"{what} of {d}",
            response,
            dict.fromkeys(names, ends),
            dict.fromkeys(names, law),
            {"above": float(above)},
            p,
        )


def sampled_probability(f, box, laws, event):
    """By sampling, and where that has few events by subset simulation with 3 sets of 60,000 samples."""
    rng, d = np.random.default_rng(5), len(box)
    ends = np.array([laws[name].cdf(box[name]) for name in box])

    def margin(z):
        u = ends[:, 0] + np.diff(ends)[:, 0] * st.norm.cdf(z)
        y = f(**{name: laws[name].ppf(u[:, i]) for i, name in enumerate(box)})
        return y - event["above"] if "above" in event else event["below"] - y

    events = sum((margin(rng.standard_normal((500_000, d))) > 0).sum() for _ in range(8))
    if events > 2000:
        return events / 4e6
    found = []
    for _ in range(3):
        z, p = rng.standard_normal((60_000, d)), 1.0
        y = margin(z)
        while (level := np.quantile(y, 0.8)) < 0 and p > 1e-12:
            rows = np.flatnonzero(y >= level)
            p *= len(rows) / len(z)
            rows = rng.choice(rows, len(z))
            z, y = z[rows], y[rows]
            for step in (0.8, 0.5, 0.35, 0.25) * 2:
                new = np.sqrt(1 - step**2) * z + step * rng.standard_normal(z.shape)
                of_new = margin(new)
                kept = of_new >= level
                z[kept], y[kept] = new[kept], of_new[kept]
        found.append(p * (y > 0).mean())
    return float(np.mean(found))


def reliability(rng):
    problems = [(name, *own, sampled_probability(*own)) for name, own in PUBLISHED.items()] if rng is None else []
    for name, f, box, laws, event, true in problems or closed_forms(rng, 40):
        begin = time.process_time()
        bounds = bounds_of(f, box)
        found = bounds.probability("y", **event, laws=laws)
        seconds = time.process_time() - begin
        error, told = abs(found.ever[0] - true) / true, found.ever[2] / true
        runs = f"{bounds.evaluations} + {found.runs} runs, {seconds:.1f} s"
        fault = f"{'WRONG ' if error > told + 0.03 else ''}{'FAR' if error > 0.2 else ''}"  # sampling is off by 3 %
        print(f"{name:20s} {true:.2e} error {error:.1%} told {told:.1%} {runs} {fault}", flush=True)


def p_boxes(rng):
    """Errors over the width, and the share of times at which the true quantiles are beyond what is told and 2 %."""
    from _machines_a import MACHINES as A
    from _machines_b import MACHINES as B

    for name in ("door closer", "windshield wiper", "toggle latch", "seat rail", "valve train", "gear train", "crane",
                 "elevator buffer", "impact tester"):  # fmt: skip
        scene = (A | B)[name](rng)
        bounds, ends = mb.propagate(scene, mb.PolynomialChaos()), dict(scene.box)
        names, free = [*ends][:-2], [*ends][-2:]
        laws = {n: st.norm(sum(ends[n]) / 2, (ends[n][1] - ends[n][0]) / 6) for n in names}
        simulator, n, inside = Subject.of(scene).simulator, 900, 12
        own = np.random.default_rng(3)
        P = np.tile(np.array([*simulator.parameters.values()], dtype=float), (n, inside, 1))
        for p in names:
            drawn = st.truncnorm(-3, 3, *(getattr(laws[p], m)() for m in ("mean", "std"))).rvs(n, random_state=own)
            P[:, :, [*simulator.parameters].index(p)] = drawn[:, None]
        corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
        shares = np.concatenate([corners, own.uniform(size=(inside - 4, 2))])
        for p, share in zip(free, shares.T, strict=True):
            P[:, :, [*simulator.parameters].index(p)] = ends[p][0] + share * (ends[p][1] - ends[p][0])
        flat = P.reshape(n * inside, -1)
        Y = np.concatenate([simulator.run(part).Y[:, :, :2] for part in np.array_split(flat, 24)]).reshape(
            n, inside, len(bounds.t), -1
        )
        for k in range(2):
            found = bounds.quantiles(bounds.names[k], [0.1, 0.5, 0.9], laws)
            low, high = (
                np.quantile(extreme(Y[..., k], axis=1), [0.1, 0.5, 0.9], axis=0) for extreme in (np.min, np.max)
            )
            error = np.maximum(np.abs(found.lower - low), np.abs(found.upper - high))
            width = np.sqrt(np.square(bounds.upper[:, k] - bounds.lower[:, k]).mean())
            sizes = (f"{np.sqrt(np.square(each).mean()) / width:.1%}" for each in (error, found.estimate))
            beyond = (error > found.estimate + 0.02 * width).mean()
            print(f"{name} {bounds.names[k]}: error {' told '.join(sizes)}, beyond {beyond:.1%}", end=" ")
            print(f"{bounds.evaluations} + {found.runs} runs", flush=True)


if __name__ == "__main__":
    parts = {"sobol": indices, "reliability": reliability, "p-boxes": p_boxes}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(parts))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    for part in options.parts or parts:
        parts[part](np.random.default_rng(options.seed) if options.seed else None)
