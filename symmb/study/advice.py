"""Advice on solvers from the trials of a scene."""

import textwrap
from collections.abc import Mapping, Sequence

from symmb.integrate import STIFF, Stiffness
from symmb.study.trials import LEFT_OUT, Trial

GOOD, STABLE = 1e-3, 0.1
"""Relative errors below which a run is accurate enough for most purposes, and below which it is not useless."""
_FAR = 1e-5
"""Violation of position rows above which the report mentions it [m, -]."""


def advice(
    trials: Sequence[Trial],
    stress: Sequence[Trial],
    errors: Mapping[str, float],
    corners: Mapping[float, tuple[int, int]],
    fastest: Stiffness,
    span: float,
) -> str:
    """The best solver, the largest steps of the others, and variants that fail; errors by the key of a trial.

    Trials without time are left out.
    """
    trials, stress = ([t for t in some if t.reason != LEFT_OUT] for some in (trials, stress))
    good = sorted((t for t in trials if errors.get(t.key, 1.0) <= GOOD), key=lambda t: t.seconds)
    sentences = [
        _choice(good),
        _stiffness(fastest, span),
        *_steps(trials, errors),
        *_drift(good),
        *_stress(stress, errors),
    ]
    broken = [f"{failed} of {of} at {width:.0%}" for width, (failed, of) in corners.items() if failed]
    if broken:
        sentences.append(f"Corners of wider boxes fail: {', '.join(broken)}; bounds there rest on the other runs.")
    return textwrap.fill(" ".join(filter(None, sentences)), 110)


def _choice(good: Sequence[Trial]) -> str:
    if not good:
        return f"No setting reached an error of {GOOD:g}: take finer ones, or a shorter horizon."
    first = good[0]
    other = next((t for t in good if t.family != first.family), None)
    also = f", then {other.solver} ({1e3 * other.seconds:.2g} ms)" if other else ""
    return f"To {GOOD:g} of the motion the fastest is {first.solver} ({1e3 * first.seconds:.2g} ms){also}."


def _stiffness(fastest: Stiffness, span: float) -> str:
    text = f"what dies away fastest does so at {fastest.decay:.1e} 1/s, "
    text += f"what swings fastest at {fastest.frequency:.1e} rad/s"
    if fastest.is_stiff(span):
        return f"It is stiff: {text}. Explicit steps have to follow the first, implicit ones need not."
    if fastest.rate * span > STIFF:
        return f"It swings fast for long: {text}. Only methods that damp it can take steps longer than that."
    return f"It is not stiff: {text}. Explicit steps do."


def _steps(trials: Sequence[Trial], errors: Mapping[str, float]) -> list[str]:
    largest: dict[str, float] = {}
    for trial in trials:
        if "step" in trial.solver and errors.get(trial.key, 1.0) <= STABLE:
            largest[trial.family] = max(trial.setting, largest.get(trial.family, 0.0))
    text = ", ".join(f"{family} {step:.2g} s" for family, step in sorted(largest.items(), key=lambda item: -item[1]))
    without = dict.fromkeys(t.family for t in trials if "step" in t.solver and t.family not in largest)
    sentences = [f"Largest steps tried that keep to the motion (error below {STABLE:g}): {text}."] if text else []
    return [*sentences, f"None of {', '.join(without)} was small enough."] if without else sentences


def _drift(good: Sequence[Trial]) -> list[str]:
    worst = max(good, key=lambda t: t.position.max(initial=0.0), default=None)
    if worst is None or not worst.position.max(initial=0.0) > _FAR:
        return []
    remedy = "stabilization=Projection(), or take one that keeps them, such as NSTIFFSI2 or StabilizedIndex2"
    if worst.family in ("NSTIFFSI2", "StabilizedIndex2"):
        remedy = "a smaller tolerance"
    return [f"{worst.solver} leaves its position constraints by {worst.position.max():.1g}: give it {remedy}."]


def _stress(stress: Sequence[Trial], errors: Mapping[str, float]) -> list[str]:
    sentences = []
    for name in dict.fromkeys(trial.scene for trial in stress):
        some = [t for t in stress if t.scene == name]
        # The reference has no error, and is the tightest.
        done = sorted((t for t in some if not t.reason and errors.get(t.key, 0.0) <= GOOD), key=lambda t: t.seconds)
        bad = dict.fromkeys(t.family for t in some if t not in done)
        if not done:
            sentences.append(f"With {name} no setting tried is good.")
        elif bad:
            fastest = f"{done[0].solver} ({1e3 * done[0].seconds:.2g} ms)"
            sentences.append(f"With {name} {', '.join(bad)} at these settings are not good enough; {fastest} is.")
    return sentences
