"""Contributions, worst cases, quantiles and probabilities against many samples, and tolerances against closed forms.

    python tests/benchmarks/answers.py [FIRST_SEED] [NUMBER]

Ten functions and five mechanisms, with random coefficients, boxes and laws of each seed. A figure counts as right if it
differs from that of samples by no more than its printed error and three standard errors of the samples.
"""

import sys
import warnings
from collections import Counter

import numpy as np
import scipy.stats as st

import symmb as mb
from models import double_pendulum, four_bar, half_car, slider_crank, spherical_pendulum

SAMPLES, RUNS = 2_000_000, 20_000
"""Samples of functions, and of mechanisms."""
T = np.array([0.0])


def functions(rng):
    """Name, function of parameters (N, d), number of parameters, and whether it is monotone."""
    c = rng.uniform(0.3, 1.5, 16)
    yield "linear", lambda x: x @ c[:4], 4
    yield "monotone", lambda x: np.exp(0.5 * x @ c[:3]) + c[3] * x[:, 0] ** 3, 3
    yield "interior extreme", lambda x: (x[:, 0] - 0.6 * c[0]) ** 2 + c[1] * np.cos(3 * x[:, 1]), 2
    yield "product", lambda x: np.prod(1 + 0.5 * c[:4] * x[:, :4], axis=1), 4
    yield "acts with another only", lambda x: c[0] * x[:, 0] * x[:, 1] + 0.2 * x[:, 2], 3
    yield "many parameters", lambda x: x @ c[:12] + 0.3 * x[:, 0] * x[:, 1] + 0.2 * x[:, 2] ** 2, 12
    yield "kink", lambda x: np.abs(x[:, 0] - 0.4 * c[0]) + c[1] * x[:, 1], 2
    yield "wave", lambda x: np.sin(2.5 * c[0] * x[:, 0] + x[:, 1]) + 0.1 * x[:, 1], 2
    yield "ratio", lambda x: (2 + x[:, 0]) / (3 + c[0] * x[:, 1] + 0.3 * x[:, 2]), 3
    yield "root", lambda x: np.sqrt(4 + c[0] * x[:, 0] + x[:, 1] ** 2 + 0.5 * x[:, 2] * x[:, 0]), 3


def mechanisms(rng):
    """Scene, output, samples at 20 times."""
    spread = rng.uniform(0.01, 0.04)
    for module in (double_pendulum, four_bar, slider_crank, half_car, spherical_pendulum):
        scene, output = module.scene(), {double_pendulum: "x2", four_bar: "coupler_angle"}.get(module)
        names = [*scene.box.names][:3]
        nominal = {name: scene.system.parameters[name] for name in names}
        if all(nominal.values()):
            yield module.__name__.split(".")[-1], scene, output or scene.output_names[0], mb.Box.around(nominal, spread)


def laws_of(rng, box):
    laws = {}
    for name, (low, high) in zip(box.names, box.bounds, strict=True):
        middle, half = (low + high) / 2, (high - low) / 2
        kind = rng.integers(3)
        laws[name] = (
            st.norm(middle + 0.3 * half * rng.uniform(-1, 1), half * rng.uniform(0.3, 1.0)),
            st.uniform(low, high - low),
            st.triang(rng.uniform(0.2, 0.8), low, high - low),
        )[kind]
    return laws


def drawn(rng, laws, box, n):
    """Samples (n, d) by rejection, in the place of the inverse of a cut distribution."""
    columns = []
    for name, (low, high) in zip(box.names, box.bounds, strict=True):
        x = np.empty(0)
        while len(x) < n:
            more = laws[name].rvs(2 * n, random_state=rng)
            x = np.concatenate([x, more[(more >= low) & (more <= high)]])
        columns.append(x[:n])
    return np.stack(columns, axis=1)


class Score:
    def __init__(self):
        self.right, self.all, self.wrong = Counter(), Counter(), []

    def add(self, case, kind, found, true, error, sampling=0.0):
        found, true, error = (np.atleast_1d(np.asarray(x, dtype=float)) for x in (found, true, error))
        ok = np.abs(found - true) <= error + sampling + 1e-9 * np.abs(true)
        self.right[kind] += int(ok.sum())
        self.all[kind] += ok.size
        if not ok.all():
            k = int(np.argmax(np.abs(found - true) - error))
            told = np.broadcast_to(error, found.shape)[k]
            self.wrong.append(f"{case}: {kind} {found[k]:.5g} instead of {true[k]:.5g}, error told {told:.2g}")


def check(score, case, bounds, k, values, rng, n, range_of):
    """Figures of output number k against values(P) (N, n_t) of parameters in the box."""
    box, name = bounds.box, bounds.names[k]
    nominal = np.array([bounds.nominal_parameters[p] for p in box.names])
    rows = np.unique(np.linspace(0, len(bounds.t) - 1, 7).astype(int))
    c = bounds.contributions()
    whole = range_of(values)[rows]
    for i in range(len(box)):
        line = np.tile(nominal, (4001, 1))
        line[:, i] = np.linspace(*box.bounds[i], 4001)
        y = values(line)[:, rows]
        score.add(case, "alone", c.alone[rows, k, i], np.ptp(y, axis=0), c.estimate[rows, k], 1e-6 * np.ptp(y))
        y = values(face_points(rng, box, i, nominal[i], n))[:, rows]
        slack = exact_slack(len(box)) * whole
        score.add(case, "saved", c.saved[rows, k, i], whole - np.ptp(y, axis=0), c.saved_estimate[rows, k], slack)
    A, B = (rng.uniform(box.lower, box.upper, (n, len(box))) for _ in range(2))
    ya, yb = values(A)[:, rows], values(B)[:, rows]
    variance = np.concatenate([ya, yb]).var(axis=0)
    for i in range(len(box)):
        mixed = A.copy()
        mixed[:, i] = B[:, i]
        ym = values(mixed)[:, rows]
        first, total = yb * (ym - ya), np.square(ya - ym) / 2
        with np.errstate(all="ignore"):
            own = np.isfinite(c.first[rows, k, i]) & (variance > 1e-20)
            errors = [3 * x.std(axis=0) / n**0.5 / variance for x in (first - yb.mean(axis=0) * (ym - ya), total)]
            centred = first - yb.mean(axis=0) * (ym - ya)
            for index, x, kind, e in ((c.first, centred, "first", errors[0]), (c.total, total, "total", errors[1])):
                true = x.mean(axis=0) / variance
                score.add(case, kind, index[rows, k, i][own], true[own], c.share_estimate[rows, k][own], e[own])
    laws = laws_of(rng, box)
    y = values(drawn(rng, laws, box, n))
    q = np.array([0.01, 0.3, 0.5, 0.95, 0.99])
    found = bounds.quantiles(name, q, laws)
    truth = np.quantile(y[:, rows], q, axis=0)
    h = np.maximum(3 * np.sqrt(q * (1 - q) / n), 1e-9)
    band = [np.quantile(y[:, rows], np.clip(q + s * h, 0, 1), axis=0) for s in (-1, 1)]
    band = [b[np.arange(len(q)), :] if b.ndim == 2 else b for b in band]
    score.add(
        case,
        "quantile",
        found.lower[:, rows].ravel(),
        truth.ravel(),
        found.estimate[:, rows].ravel(),
        (band[1] - band[0]).ravel(),
    )
    level = float(np.quantile(y[:, rows[-1]], rng.choice([0.5, 0.9, 0.99])))
    p = bounds.probability(name, above=level, laws=laws)
    true = (y > level).mean(axis=0)
    score.add(
        case,
        "probability",
        p.lower[rows],
        true[rows],
        p.estimate[rows],
        3 * np.sqrt(true * (1 - true) / n + 1e-12)[rows],
    )
    true = (y > level).any(axis=1).mean()
    score.add(case, "probability ever", p.ever[0], true, p.ever[2], 3 * np.sqrt(true * (1 - true) / n + 1e-12))
    worst = bounds.worst(name)
    for side in (worst.lower, worst.upper):
        sign = 1 if side.side == "upper" else -1
        point = np.array([[side.parameters[p] for p in box.names]])
        i = int(np.abs(bounds.t - side.time).argmin())
        score.add(case, "worst attained", side.attained, values(point)[0, i], 0.0, 1e-6 * abs(side.value) + 1e-9)
        best = (sign * y).max()
        estimate = bounds.estimate[i, k]
        score.add(case, "worst", max(best - sign * side.value, 0.0), 0.0, estimate)


def face_points(rng, box, i, value, n):
    """Samples of a face, and its corners and edges."""
    d = len(box)
    P = rng.uniform(box.lower, box.upper, (n, d))
    sides = rng.choice([-1, 0, 1], (n, d))
    P = np.where(sides < 0, box.lower, np.where(sides > 0, box.upper, P))
    P[:, i] = value
    return P


def exact_slack(d):
    """What samples with points on edges and corners leave of a range, over the width."""
    return 3e-3 if d <= 4 else 2e-2


def functions_of(seed, score):
    rng = np.random.default_rng(seed)
    for name, f, d in functions(rng):
        names = [f"p{i}" for i in range(d)]
        centre, half = rng.uniform(-0.2, 0.2, d), rng.uniform(0.5, 1.0, d)
        box = mb.Box(**dict(zip(names, zip(centre - half, centre + half, strict=True), strict=True)))
        nominal = dict(zip(names, centre + 0.3 * half * rng.uniform(-1, 1, d), strict=True))
        simulator = mb.FunctionSimulator(
            lambda f=f, names=names, **p: f(np.array([[p[n] for n in names]]))[:, None], nominal, T, ["y"]
        )

        def values(P, f=f):
            return f(P)[:, None]

        def width(values, box=box, rng=rng, d=d):
            P = np.concatenate([face_points(rng, box, i, v, 100_000) for i in range(d) for v in box.bounds[i]])
            P = np.concatenate([P, rng.uniform(box.lower, box.upper, (500_000, d))])
            return np.ptp(values(P), axis=0)

        bounds = mb.propagate(simulator, mb.PolynomialChaos(), box)
        check(score, f"{name} {seed}", bounds, 0, values, rng, SAMPLES // (1 if d < 5 else 4), width)


def mechanisms_of(seed, score):
    rng = np.random.default_rng(seed)
    for name, scene, output, box in mechanisms(rng):
        bounds = mb.propagate(scene, mb.PolynomialChaos(), box)
        simulator, k = mb.DAESimulator(scene), bounds.names.index(output)
        columns = [[*simulator.parameters].index(p) for p in box.names]

        def values(P, simulator=simulator, columns=columns, k=k):
            whole = np.tile(np.array([*simulator.parameters.values()], dtype=float), (len(P), 1))
            whole[:, columns] = P
            return np.concatenate(
                [simulator.run(part).Y[:, :, k] for part in np.array_split(whole, -(-len(P) // 4000))]
            )

        def width(values, box=box, rng=rng):
            faces = [face_points(rng, box, i, v, 4000) for i in range(len(box)) for v in box.bounds[i]]
            return np.ptp(values(np.concatenate([*faces, rng.uniform(box.lower, box.upper, (8000, len(box)))])), axis=0)

        check(score, f"{name} {seed}", bounds, k, values, rng, RUNS, width)


def tolerances_of(seed):
    """Largest relative errors of factors and costs of linear chains, whose answers are closed forms."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 7))
    names, c = [f"l{i}" for i in range(d)], rng.choice([-1.0, 1.0], d) * rng.uniform(0.3, 2.0, d)
    p, h = rng.uniform(1, 3, d), rng.uniform(0.01, 0.1, d)
    gap = float(c @ p)
    allowed = float(rng.uniform(0.4, 3.0) * np.abs(c) @ h)
    limits = {"gap": (None, gap + allowed)} if rng.random() < 0.5 else {"gap": (gap - allowed, gap + 2 * allowed)}
    chain = mb.FunctionSimulator(
        lambda **q: [[sum(a * q[n] for a, n in zip(c, names, strict=True))]],
        dict(zip(names, p, strict=True)),
        T,
        ["gap"],
    )
    box = mb.Box(**dict(zip(names, zip(p - h, p + h, strict=True), strict=True)))
    found = mb.tolerances(chain, limits, box)
    factor = allowed / (np.abs(c) @ h)
    cheap = mb.tolerances(chain, limits, box, costs={})
    w = np.abs(c) * h  # least sum of 1 / s with w s = allowed
    cost = np.sqrt(w).sum() ** 2 / allowed
    return abs(found.factor / factor - 1), cheap.cost / cost - 1


if __name__ == "__main__":
    first, number = (int(x) for x in [*sys.argv[1:], 1, 3][:2])
    warnings.simplefilter("ignore")
    score = Score()
    for seed in range(first, first + number):
        functions_of(seed, score)
        mechanisms_of(seed, score)
        print(seed, {kind: f"{score.right[kind]}/{score.all[kind]}" for kind in score.all}, flush=True)
    for text in score.wrong:
        print(" ", text)
    right, every = sum(score.right.values()), sum(score.all.values())
    print(f"{right} of {every} figures inside of their errors: {right / every:.2%}")
    errors = np.array([tolerances_of(seed) for seed in range(first, first + 10)])
    print("tolerances of ten chains: largest errors of factor and cost", errors.max(axis=0))
