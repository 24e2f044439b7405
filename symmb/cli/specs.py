"""Methods and solvers as the command line writes them: the one table, for reading and for `--help`."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from symmb._errors import DeclarationError
from symmb._names import did_you_mean
from symmb.bounds import (
    IntervalArithmetic,
    Method,
    MonteCarlo,
    Optimization,
    PolynomialChaos,
    Scanning,
    Swarm,
    Taylor,
    Vertex,
)
from symmb.integrate import (
    BDFI3,
    CVODES,
    HHT,
    IDAS,
    NSTIFFSI2,
    Collocation,
    DormandPrince,
    EventDriven,
    GeneralizedAlpha,
    Newmark,
    Rosenbrock,
    RungeKutta,
    StabilizedIndex2,
    StateSpace,
)

_WHOLE = {"ORDER", "SAMPLES", "POINTS", "RUNS", "PARTS", "PARTICLES"}
"""The numbers of the forms that are whole; any other is a real one."""


@dataclass(frozen=True)
class Spec:
    """One way to write a method or a solver.

    Attributes
    ----------
    form : str      words and, in capitals, numbers, between colons; what stands in brackets may be left out
    text : str      the constructor that it stands for
    build           makes the object from the numbers given, by position
    """

    form: str
    text: str
    build: Callable[..., Any]

    @property
    def word(self) -> str:
        """What stands before the first colon."""
        return re.split(r"[:\[]", self.form)[0]

    def matches(self, written: str) -> re.Match[str] | None:
        """Whether the text has this form, its numbers not yet read."""
        pattern = self.form.replace("[", "(?:").replace("]", ")?")
        return re.fullmatch(re.sub(r"[A-Z]+", "([^:=]*)", pattern), written)

    def read(self, match: re.Match[str]) -> Any:
        """The object that a matching text stands for."""
        names = re.findall(r"[A-Z]+", self.form)
        given = [(name, text) for name, text in zip(names, match.groups(), strict=True) if text is not None]
        return self.build(*(_number(name, text, match.string) for name, text in given))


METHODS = (
    Spec("pce", "PolynomialChaos(), adaptive", PolynomialChaos),
    Spec(
        "pce:tol=TOL",
        "PolynomialChaos(tolerance=TOL)",
        lambda tolerance: PolynomialChaos(tolerance=tolerance),
    ),
    Spec("pce:budget=RUNS", "PolynomialChaos(budget=RUNS)", lambda budget: PolynomialChaos(budget=budget)),
    Spec("pce:ORDER:paper", "PolynomialChaos.paper(order=ORDER)", PolynomialChaos.paper),
    Spec("pce:ORDER", "PolynomialChaos(order=ORDER)", lambda order: PolynomialChaos(order=order)),
    Spec("taylor[:ORDER]", "Taylor(order=ORDER)", Taylor),
    Spec("taylor:ORDER:PARTS", "Taylor(order=ORDER, subintervals=PARTS)", Taylor),
    Spec("mc[:SAMPLES]", "MonteCarlo(SAMPLES)", MonteCarlo),
    Spec("scan[:POINTS]", "Scanning(POINTS)", Scanning),
    Spec("vertex", "Vertex()", Vertex),
    Spec("opt[:RUNS]", "Optimization(budget=RUNS)", Optimization),
    Spec("swarm[:PARTICLES]", "Swarm(particles=PARTICLES)", Swarm),
    Spec("interval", "IntervalArithmetic()", IntervalArithmetic),
)
SOLVERS = (
    Spec("dopri[:RTOL]", "DormandPrince(rtol=RTOL)", DormandPrince),
    Spec("idas", "IDAS()", IDAS),
    Spec("idas:RTOL", "IDAS(rtol=RTOL)", lambda rtol: IDAS(rtol=rtol)),
    Spec("cvodes", "CVODES()", CVODES),
    Spec("cvodes:RTOL", "CVODES(rtol=RTOL)", lambda rtol: CVODES(rtol=rtol)),
    Spec("collocation", "Collocation()", Collocation),
    Spec("rk", "RungeKutta()", RungeKutta),
    Spec("rosenbrock[:RTOL]", "Rosenbrock(rtol=RTOL)", Rosenbrock),
    Spec("si2", "StabilizedIndex2()", StabilizedIndex2),
    Spec("si2:RTOL", "StabilizedIndex2(rtol=RTOL)", lambda rtol: StabilizedIndex2(rtol=rtol)),
    Spec("state-space[:RTOL]", "StateSpace(rtol=RTOL)", StateSpace),
    Spec("events[:RTOL]", "EventDriven(rtol=RTOL)", EventDriven),
    Spec("nstiff-si2[:STEP]", "NSTIFFSI2(step=STEP)", NSTIFFSI2),
    Spec("nstiff-si2:tol=RTOL", "NSTIFFSI2(step=1.0, rtol=RTOL)", lambda rtol: NSTIFFSI2(step=1.0, rtol=rtol)),
    Spec("gen-alpha[:STEP]", "GeneralizedAlpha(step=STEP)", GeneralizedAlpha),
    Spec("hht[:STEP]", "HHT(step=STEP)", HHT),
    Spec("newmark[:STEP]", "Newmark(step=STEP)", Newmark),
    Spec("bdf-i3[:STEP]", "BDFI3(step=STEP)", BDFI3),
)


def method(written: str) -> Method:
    """The method that a text such as "pce:2:paper" stands for.

    Raises
    ------
    DeclarationError    if the text has no known form, or its numbers are out of range

    Examples
    --------
    >>> method("pce:2:paper"), method("mc:100")
    (PolynomialChaos.paper(order=2), MonteCarlo(100))
    """
    return _read(written, METHODS, "method")


def solver(written: str) -> Any:
    """The solver that a text such as "cvodes:1e-8" stands for; raises as `method` does."""
    return _read(written, SOLVERS, "solver")


def table(title: str, specs: Sequence[Spec]) -> str:
    """The forms and what they stand for, as `--help` prints them."""
    width = max(len(spec.form) for spec in specs) + 2
    return "\n".join([f"{title}:", *(f"  {spec.form.ljust(width)}{spec.text}" for spec in specs)])


def _number(name: str, text: str, written: str) -> float:
    whole = name in _WHOLE
    try:
        return int(text) if whole else float(text)
    except ValueError:
        kind = "a whole number" if whole else "a number"
        raise DeclarationError(f"{written}: {name} must be {kind}, got {text!r}.") from None


def _read(written: str, specs: Sequence[Spec], what: str) -> Any:
    for spec in specs:
        match = spec.matches(written)
        if match is not None:
            return spec.read(match)
    word = written.split(":")[0]
    forms = [spec.form for spec in specs if spec.word == word]
    if forms:
        raise DeclarationError(f"The {what} {written!r} is written as none of: {', '.join(forms)}.")
    known = dict.fromkeys(spec.word for spec in specs)
    raise DeclarationError(f"There is no {what} {word!r}.{did_you_mean(word, known)}")
