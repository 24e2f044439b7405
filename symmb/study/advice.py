"""Text that recommends solvers, from trials of a scene and of harder variants such as stiffer springs."""

from collections.abc import Mapping, Sequence

import numpy as np

from symmb.run.integrate import STIFF, Stiffness
from symmb.study.ladders import FIXED
from symmb.study.standard import Standard
from symmb.study.trials import LEFT_OUT, Trial, by_family, by_reason, named

GOOD_ERROR, USABLE_ERROR = 1e-3, 0.1
"""Largest relative error of a run that is accurate for most purposes, and of a run that is usable."""

Standards = Mapping[str, Standard]
"""The reference of each scene, by the name of the variant; "" is the scene itself."""


def advice(
    trials: Sequence[Trial],
    stress: Sequence[Trial],
    standards: Standards,
    corners: Mapping[float, tuple[int, int]],
    fastest: Stiffness,
    span: float,
    doubts: Sequence[str],
) -> str:
    """The best solver, the largest steps of other solvers, and the best solver for each harder variant.

    If no solver is known to be good, the reason is given. The text ends with warnings, also about solvers that were not
    tried. Only settings with a small error and a small drift of energy are recommended. The error includes the
    uncertainty of the reference. Trials that were left out for lack of time are ignored.
    """
    tried, standard = trials, standards[""]
    trials = [t for t in trials if t.reason != LEFT_OUT]
    if not trials:
        return "No solver had time to run. Allow more processor time by seconds=."
    good = _good(trials, standard)
    lines = [
        _choice(good, standard),
        _stiffness(fastest, span),
        *(_steps(tried, standard) if not standard.fault else ()),
        *_drift(good),
        *_under_stress(stress, standards),
    ]
    broken = [f"{failed} of {of} at {width:.0%}" for width, (failed, of) in corners.items() if failed]
    if broken:
        lines.append(f"Corners of wider boxes fail: {', '.join(broken)}. Bounds of wider boxes use only other runs.")
    return "\n".join([*lines, *doubts])


def is_within(trial: Trial, standard: Standard, limit: float) -> bool:
    """Whether the error of a run is known to be below the limit, and energy is conserved."""
    error = standard.error(trial)
    return error is not None and error + standard.uncertainty <= limit and not trial.energy > GOOD_ERROR


def _good(trials: Sequence[Trial], standard: Standard) -> list[Trial]:
    """The runs that are accurate enough, with the fastest run first."""
    return sorted((t for t in trials if is_within(t, standard, GOOD_ERROR)), key=lambda t: t.seconds)


def _choice(good: Sequence[Trial], standard: Standard) -> str:
    if standard.fault:
        return f"No setting is known to be good, because there is no reference: {standard.fault}."
    if not good:
        return f"No setting reached an error of {GOOD_ERROR:g}. Use smaller steps or tolerances, or a shorter horizon."
    first = good[0]
    other = next((t for t in good if t.family != first.family), None)
    also = f", then {_timed(other)}" if other else ""
    text = f"For errors up to {GOOD_ERROR:g} of the motion, the fastest is {_timed(first)}{also}."
    return f"{text} Fine tolerances take too long: {_damped(standard)}." if standard.damped >= 0 else text


def _damped(standard: Standard) -> str:
    return f"fast oscillations with up to {standard.damped:.1g} of the largest velocity are left out"


def _timed(trial: Trial) -> str:
    seconds = f"{1e3 * trial.seconds:.2g} ms" if trial.seconds < 0.0995 else f"{trial.seconds:.2g} s"
    return f"{trial.solver} ({seconds})"


def _stiffness(fastest: Stiffness, span: float) -> str:
    text = f"the fastest decay is {fastest.decay:.1e} 1/s, "
    text += f"the fastest oscillation {fastest.frequency:.1e} rad/s"
    if fastest.is_stiff(span):
        return f"The motion is stiff: {text}.\nExplicit solvers must resolve the decay, implicit solvers need not."
    if fastest.rate * span > STIFF:
        return f"The motion has many oscillations: {text}.\nOnly solvers that damp them can take longer steps."
    return f"The motion is not stiff: {text}. Explicit solvers are suitable."


def _steps(trials: Sequence[Trial], standard: Standard) -> list[str]:
    """The largest usable step of each family with fixed steps, and the families without a usable step."""
    fixed = [trial for trial in trials if trial.family in FIXED]
    stable = by_family([trial for trial in fixed if is_within(trial, standard, USABLE_ERROR)])
    largest = {family: max(trial.setting for trial in some) for family, some in stable.items()}
    text = ", ".join(f"{family} {step:.2g} s" for family, step in sorted(largest.items(), key=lambda item: -item[1]))
    which = f"an error below {USABLE_ERROR:g} and a drift of energy below {GOOD_ERROR:g}"
    lines = [f"Largest tried steps with {which}: {text}."] if text else []
    return lines + _too_long(by_family([trial for trial in fixed if trial.family not in largest]))


def _too_long(families: Mapping[str, Sequence[Trial]]) -> list[str]:
    """Families for which no tried step is small enough, and families that had no time for smaller steps."""
    enough, cut = list[str](), list[str]()
    for family, trials in families.items():
        least = min((trial.setting for trial in trials if not trial.slow), default=np.inf)
        if any(trial.slow and trial.setting < least for trial in trials):
            cut.append(family)
        else:
            enough.append(f"{family} (down to {least:.2g} s)")
    lines = [f"No step of {', '.join(enough)} was small enough."] if enough else []
    if cut:
        lines.append(
            f"Runs of {', '.join(cut)} with smaller steps had no time to finish. These steps may be small enough."
        )
    return lines


def _drift(good: Sequence[Trial]) -> list[str]:
    worst = max(good, key=lambda t: t.position.max(initial=0.0), default=None)
    # The report mentions a violation of position constraints above this limit [m, -].
    if worst is None or not worst.position.max(initial=0.0) > 1e-5:
        return []
    remedy = "stabilization=Projection(), or use a solver that keeps positions, such as NSTIFFSI2 or StabilizedIndex2"
    if worst.family in ("NSTIFFSI2", "StabilizedIndex2"):
        remedy = "a smaller tolerance"
    return [f"{worst.solver} violates its position constraints by {worst.position.max():.1g}: set {remedy}."]


def _under_stress(stress: Sequence[Trial], standards: Standards) -> list[str]:
    """A heading and a line for each harder variant."""
    names = list(dict.fromkeys(trial.scene for trial in stress))
    if not names:
        return []
    width = max(map(len, names))
    lines = [f"  {name:{width}}  {_verdict([t for t in stress if t.scene == name], standards[name])}" for name in names]
    if not any(name.startswith("stiffness") for name in names):
        lines.append("  Stiffer springs were not tried: no element has a stiffness, and force laws were not changed.")
    return [f"For errors up to {GOOD_ERROR:g} of the motion, under stress:", *lines]


def _verdict(trials: Sequence[Trial], standard: Standard) -> str:
    """The fastest good setting, and families without a good setting; or why no setting is known to be good."""
    if standard.fault:
        return f"no setting is known to be good: {standard.fault}"
    good = _good(trials, standard)
    others = [t for t in trials if t.family not in {g.family for g in good}]
    finished = [t for t in others if not t.reason]
    failed = by_reason([t for t in others if t.family not in {f.family for f in finished}])
    without = _damped(standard) if standard.damped >= 0 else ""
    parts = filter(None, [without, f"inaccurate: {named(finished)}" if finished else "", failed])
    return "; ".join([_timed(good[0]) if good else "no tried setting is good", *parts])
