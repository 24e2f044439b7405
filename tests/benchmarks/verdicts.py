"""Sentences of reports on random scenes, boxes, limits and methods: those that are wrong, needless or missing.

    PYTHONPATH=.:tests python tests/benchmarks/verdicts.py [--number 200] [--seed 0]

Responses have closed forms, of which thousands of samples are known, and some parameters have no influence. Each
sentence must agree with `check` of the same bounds and with the samples. Tolerances that are advised must keep limits.
"""

import argparse
import re
import warnings
from collections import Counter

import casadi as ca
import numpy as np
from small_scenes import formulas, particle

import symmb as mb
from symmb.show.report.verdict import next_steps, verdict

T = np.linspace(0.0, 1.0, 9)
SAMPLES, SLACK = 4000, 1e-6
"""Samples of a box, and what rounding, solvers and printed digits change, over the width."""
METHODS = ("pce", "pce:2", "vertex", "mc:40", "taylor:2", "tm:2", "swarm")


class Case:
    """A subject with nominal values, a box, and responses (N, n_t, n_y) in closed form of samples (N, d)."""

    def __init__(self, rng):
        self.kind = str(rng.choice(["formulas", "black box", "oscillator"]))
        self.names = ["k", "a", "idle"] if self.kind == "oscillator" else [f"p{i}" for i in range(rng.integers(2, 6))]
        d = len(self.names)
        self.nominal = rng.uniform(0.8, 1.2, d) * (2.0 if self.kind == "oscillator" else 1.0)
        below, above = rng.uniform(0.02, 0.2, (2, d))
        self.is_even = rng.random() < 0.7
        if self.is_even:
            below = above
        self.low, self.high = self.nominal - below, self.nominal + above
        if rng.random() < 0.15:  # the box leaves out a nominal value
            i, shift = rng.integers(d), rng.uniform(1.5, 3)
            self.low[i], self.high[i] = self.nominal[i] + shift * below[i], self.nominal[i] + (2 + shift) * below[i]
        self.acts = rng.random((2, d)) < 0.6
        self.acts[:, 0] = True
        self.acts[1] |= ~self.acts[0]  # what is in the box without any effect has a warning
        self.c = rng.uniform(0.5, 2.0, (2, d)) * rng.choice([-1, 1], (2, d)) * self.acts
        self.q, self.pair = 0.3 * rng.uniform(-1, 1, (2, d)) * self.acts, rng.uniform(-1, 1, 2)
        if self.kind == "oscillator":
            self.acts = np.array([[True, True, False]] * 2 + [[False, False, True]])
        self.outputs = ["x", "vx", "z"] if self.kind == "oscillator" else ["y0", "y1"]

    def of(self, p, t, j, cos=np.cos):
        """Output number j."""
        first = sum(self.c[j, i] * (p[i] - 1) * cos(i * t) for i in range(len(p)))
        last = max(np.flatnonzero(self.acts[j]))
        second = sum(self.q[j, i] * (p[i] - 1) ** 2 for i in range(len(p)))
        return 1 + first + second + self.pair[j] * (p[0] - 1) * (p[int(last)] - 1) * t

    def values(self, P):
        if self.kind == "oscillator":
            k, a = P[:, 0, None], P[:, 1, None]
            speed = -a * np.sqrt(k) * np.sin(np.sqrt(k) * T)
            return np.stack([a * np.cos(np.sqrt(k) * T), speed, P[:, 2, None] * (1 + T)], axis=2)
        p = P.T[:, :, None]
        return np.stack([self.of(p, T, j) * np.ones((len(P), len(T))) for j in range(2)], axis=2)

    def subject(self):
        box = {n: (float(a), float(b)) for n, a, b in zip(self.names, self.low, self.high, strict=True)}
        nominal = dict(zip(self.names, self.nominal.tolist(), strict=True))
        if self.kind == "black box":
            run = lambda **p: self.values(np.array([[p[n] for n in self.names]]))[0]  # noqa: E731
            return mb.FunctionSimulator(run, nominal, T, self.outputs), mb.Box(**box)
        if self.kind == "oscillator":
            law, start = (lambda p, mass: -p.k * mass.x), {"mass.x": 0.0}
            scene = particle(law, T, start, ("x", "vx"), **box)
            p = scene.system.parameters
            outputs = scene.outputs | {"z": p.idle * (1 + mb.t)}
            scene = mb.Scene(scene.system, {"mass.x": p.a}, T, outputs, scene.box)
        else:

            def make(p):
                values = [getattr(p, n) for n in self.names]
                return {y: self.of(values, mb.t, j, ca.cos) for j, y in enumerate(self.outputs)}

            scene = formulas(make, T, **box)
        return scene.with_nominal(nominal), mb.Box(**box)

    def sampled(self, rng, low, high):
        """Responses of random samples and corners of a box."""
        unit = rng.uniform(-1, 1, (SAMPLES, len(low)))
        unit[: SAMPLES // 2] = np.sign(unit[: SAMPLES // 2])
        return self.values((low + high) / 2 + unit * (high - low) / 2)


def faults(case, bounds, limits, rng, counted):
    """What is wrong in the sentences about a case, in words; sentences with advice are counted."""
    check = bounds.check(limits)
    bounds = bounds if check.kept else bounds._with_nominal()
    shares = bounds._known_contributions() if bounds.range_of else None
    ((_, head), *sentences), steps = verdict(bounds, check), next_steps(bounds, check, shares)
    Y, nominal = case.sampled(rng, case.low, case.high), case.values(case.nominal[None])[0]
    is_left_out = bool(((case.nominal < case.low) | (case.nominal > case.high)).any())
    told = [text for _, text in sentences]
    if any("are outside of the box" in text for text in told) != is_left_out:
        yield "the remark about nominal values is needless or missing"
    if any("are outside of the box" in text for text in check.remarks) != is_left_out:
        yield "the remark of check is needless or missing"
    results = {state: sum(limit.kept is state for limit in check.limits) for state in (True, False, None)}
    for state, words in ((True, "satisfied"), (False, "violated"), (None, "not decided")):
        if (words in head) != bool(results[state]):
            yield f"headline: {head}"
    for limit in check.limits:
        k = case.outputs.index(limit.output)
        y, width = Y[:, :, k], np.ptp(Y[:, :, k])
        beyond = np.maximum(limit.low - y, y - limit.high)
        excess, at_once = beyond.max(axis=1), beyond.min(axis=0).max()  # of each sample, and of all at the same time
        own = max((limit.low - nominal[:, k]).max(), (nominal[:, k] - limit.high).max())
        (text,) = (text for text in told if re.match(rf"(It is not decided whether )?{limit.output} ", text))
        slack = SLACK * max(width, np.abs(y).max())
        if limit.kept and excess.max() > slack:
            yield f"satisfied, but a sample is beyond: {text}"
        if (
            limit.kept is False
            and bounds.kind != "estimate"
            and max(excess.max(), -np.inf if is_left_out else own) < -slack
        ):
            yield f"violated, but no sample is beyond: {text}"
        if limit.kept is not False and not is_left_out and own > slack:
            yield f"the nominal run is beyond, and the limit is {limit.kept}"
        if ("in all cases" in text) != (limit.kept is True or "in all cases, by" in text):
            yield f"all cases: {text}"
        if match := re.search(r"in all cases, by (?:at least )?(\S+?),? ", text):
            if excess.min() < 0.99 * float(match[1]) - slack:
                yield f"not all cases are beyond by that: {text}"
            if "violated in all cases" not in head and results[False] == 1:
                yield f"headline beside all cases: {head}"
        elif limit.kept is False and bounds.estimate is not None and at_once > 0.1 * width and not bounds.doubts:
            yield f"missing: all cases are beyond: {text}"
        if match := re.search(r"by (\S+) at the nominal values", text):
            if abs(float(match[1]) - own) > 0.01 * abs(own) + slack or is_left_out:
                yield f"excess of the nominal values: {text}"
        named = [n for n, _ in re.findall(r"(\w+) is (high|low) \(", text)]
        if idle := [n for n in named if not case.acts[k, case.names.index(n)]]:
            yield f"names {idle}, without influence: {text}"
        varies = np.ptp(Y[:, limit.row, k]) > slack
        if not named and varies and bounds.attaining is not None and "reaches its limit" not in text:
            yield f"missing: no parameter is named: {text}"
        why_open = [step for step in steps if step.startswith(f"{limit.output}: ")]
        if bool(why_open) != (limit.kept is None):
            yield "a step about an undecided limit is needless or missing"
    for step in steps:
        named = [n for n, _ in re.findall(r"(\w+) from (\S+ [±+])", step)]
        acting = case.acts[[case.outputs.index(limit.output) for limit in check.limits]].any(axis=0)
        if idle := [n for n in named if not acting[case.names.index(n)]]:
            yield f"advises {idle}, without influence: {step}"
        if check.kept and re.search("ighten .*:|multiply|change them", step):
            yield f"needless: {step}"
        if named:
            counted["tolerances advised"] += 1
            yield from narrowed(case, check, step, rng)


def narrowed(case, check, step, rng):
    """What is wrong in the advice to narrow tolerances."""
    ends = re.findall(
        r"(\w+) from \S+ (?:± \S+|\+\S+ −\S+) to (\S+) (?:± (\S+?)|\+(\S+) −(\S+?))(?:,|\.$| or| and|\.)", step
    )
    whole = float(match[1]) if (match := re.search(r"multiply all tolerances by ([\d.]+),", step)) else None
    boxes = [ends] if whole else [[each] for each in ends]
    low, high = case.low.copy(), case.high.copy()
    if whole:
        low, high = (case.nominal + (whole - 0.005) * (end - case.nominal) for end in (low, high))
    for box in boxes:
        a, b = low.copy(), high.copy()
        for name, x, both, above, below in box:
            i = case.names.index(name)
            a[i], b[i] = float(x) - float(both or below), float(x) + float(both or above)
        Y = case.sampled(rng, a, b)
        for limit in check.limits:
            y = Y[:, :, case.outputs.index(limit.output)]
            beyond = max(limit.low - y.min(), y.max() - limit.high)
            if f"{limit.output} is" in step.replace("keep ", "") and beyond > 2e-3 * np.ptp(y):
                yield f"the advised tolerances do not keep {limit.text}, by {beyond:.2g}: {step}"


def limits_of(case, rng):
    """Random limits of one output or both, around their true ranges."""
    Y = case.sampled(rng, case.low, case.high)
    for k in rng.permutation(len(case.outputs))[: rng.integers(1, 3)]:
        low, high = Y[:, :, k].min(), Y[:, :, k].max()
        shift = rng.uniform(-1.0, 0.4) * (high - low) * (0.2 if rng.random() < 0.5 else 1.0)
        yield case.outputs[k], (None, float(high + shift)) if rng.random() < 0.5 else (float(low - shift), None)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    counts = Counter()
    for number in range(options.number):
        rng = np.random.default_rng([options.seed, number])
        case, method = Case(rng), str(rng.choice(METHODS))
        subject, box = case.subject()
        if case.kind == "black box" and method in ("taylor:2", "tm:2"):
            method = "pce"
        limits = dict(limits_of(case, rng))
        bounds = mb.propagate(subject, method, box)
        found = [*faults(case, bounds, limits, rng, counts)]
        counts.update([method, *("faulty sentences" for _ in found)])
        counts.update(limit.why.split(" ")[0] + f" {limit.kept}" for limit in bounds.check(limits).limits)
        for text in found:
            print(f"{options.seed} {number} {case.kind} {method} {limits}: {text}", flush=True)
    print(dict(counts))
