"""Distributions of parameters, cut to the box, with correlations by a Gaussian copula."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import SAME, SLIGHT
from symmb._names import did_you_mean, normal_keys
from symmb._options import numbers_of, shown
from symmb._types import Array, Indices
from symmb.equations.model import Box

Correlation = Sequence[Sequence[float]] | Array


def given_once(owner: str, laws: object, distributions: object) -> Any:
    """The distributions, given as `laws` or as `distributions`."""
    if laws is not None and distributions is not None:
        raise DeclarationError(f"{owner}: laws and distributions are two names of one argument. Give one of them.")
    return distributions if laws is None else laws


@dataclass(frozen=True, eq=False)
class Laws:
    """Distributions of some parameters of a box.

    Attributes
    ----------
    names : n_l names
    columns : (n_l,)           indices of the parameters in the box
    distributions : n_l        objects with `cdf` and `ppf`, such as frozen distributions of SciPy
    masses : (n_l, 2)          distribution functions at the ends of the intervals
    factor : (n_l, n_l)        F with F Fᵀ = correlations of the copula; None for independent parameters
    """

    names: tuple[str, ...]
    columns: Indices
    distributions: tuple[Any, ...]
    masses: Array
    factor: Array | None

    @classmethod
    def of(cls, owner: str, laws: object, correlation: object, box: Box) -> "Laws":
        """Laws from distributions by name, and from a matrix of correlations in the same order."""
        if not isinstance(laws, Mapping) or not laws:
            raise DeclarationError(
                f'{owner}: distributions must be given by name, such as {{"k": scipy.stats.norm(40, 1.3)}}, '
                f"got {shown(laws)}."
            )
        laws, masses = normal_keys(owner, laws), []
        for name, law in laws.items():
            if name not in box.names:
                raise DeclarationError(
                    f"{owner}: {name!r} is not a parameter of the box.{did_you_mean(str(name), box.names)}"
                )
            masses.append(_masses(owner, name, law, box))
        names = tuple(laws)
        columns = np.array([box.names.index(name) for name in names], dtype=np.intp)
        factor = None if correlation is None else _factor(owner, correlation, names)
        return cls(names, columns, tuple(laws.values()), np.array(masses), factor)

    @property
    def remarks(self) -> tuple[str, ...]:
        """A sentence about distributions with a part outside of the box; empty if there are none."""
        outside = 1.0 - (self.masses[:, 1] - self.masses[:, 0])
        # A remark reports a probability outside of the box if it is larger than this.
        cut = {name: mass for name, mass in zip(self.names, outside.tolist(), strict=True) if mass > 1e-4}
        if not cut:
            return ()
        one, more = "distribution of {} is cut to its interval", "distributions of {} are cut to their intervals"
        words = one if len(cut) == 1 else more
        parts = ", ".join(f"{mass:.2g} for {name}" if len(cut) > 1 else f"{mass:.2g}" for name, mass in cut.items())
        return (
            f"The {words.format(', '.join(cut))}. The part outside has a probability of {parts}. Bounds over wider "
            "intervals include this part.",
        )

    def unit_points(self, uniform: Array, box: Box) -> Array:
        """Values (N, n_l) in the unit box from independent numbers (N, n_l) with a uniform distribution on [0, 1]."""
        u = uniform
        if self.factor is not None:
            from scipy.special import ndtr, ndtri

            tiny = np.finfo(float).tiny
            u = ndtr(ndtri(np.clip(u, tiny, 1.0 - 2.0**-53)) @ self.factor.T)
        low, high = self.masses.T
        P = np.tile(box.center, (len(u), 1))
        for k, (column, law) in enumerate(zip(self.columns, self.distributions, strict=True)):
            P[:, column] = np.clip(law.ppf(low[k] + u[:, k] * (high[k] - low[k])), *box.bounds[column])
        return np.clip(box.to_unit(P)[:, self.columns], -1.0, 1.0)

    def __repr__(self) -> str:
        return laws_text(dict(zip(self.names, self.distributions, strict=True)))


def laws_text(laws: Mapping[str, Any]) -> str:
    """Distributions by name, written as the calls that made them."""
    return "{" + ", ".join(f"{name!r}: {_law_text(law)}" for name, law in laws.items()) + "}"


def _law_text(law: Any) -> str:
    name = getattr(getattr(law, "dist", None), "name", type(law).__name__)
    arguments = [f"{value:g}" for value in getattr(law, "args", ())]
    arguments += [f"{key}={value:g}" for key, value in getattr(law, "kwds", {}).items()]
    return f"{name}({', '.join(arguments)})"


def _masses(owner: str, name: str, law: Any, box: Box) -> tuple[float, float]:
    import scipy.stats

    if getattr(scipy.stats, str(getattr(law, "name", "")), None) is law:  # a family; rv_histogram is a distribution
        raise DeclarationError(
            f"{owner}: give numbers to the distribution of {name!r}, as in scipy.stats.norm(40, 1.3)."
        )
    if not all(callable(getattr(law, part, None)) for part in ("cdf", "ppf")):
        raise DeclarationError(
            f"{owner}: the distribution of {name!r} must have cdf and ppf, such as scipy.stats.norm(40, 1.3), "
            f"got {shown(law)}."
        )
    low, high = box.bounds[box.names.index(name)]
    try:
        below, above = float(law.cdf(np.nextafter(low, -np.inf))), float(law.cdf(high))  # an end may have a mass
        middle = np.shape(law.ppf(np.array([below, above])))
    except Exception as error:  # raised by the user's class
        raise DeclarationError(f"{owner}: the distribution of {name!r} cannot be evaluated: {error}.") from error
    if middle != (2,):
        raise DeclarationError(f"{owner}: ppf of the distribution of {name!r} must return one number per probability.")
    # A distribution with a smaller probability in the box is rejected, because its quantiles there have few digits.
    if not above - below >= SLIGHT:
        raise DeclarationError(
            f"{owner}: the distribution of {name!r} has a probability of {above - below:.1g} in its interval "
            f"from {low:g} to {high:g}. Give another interval or distribution."
        )
    return below, above


def _factor(owner: str, correlation: object, names: tuple[str, ...]) -> Array:
    matrix, n = numbers_of(correlation), len(names)
    if matrix is None or matrix.shape != (n, n):
        raise DeclarationError(
            f"{owner}: correlation must be a {n} x {n} matrix in the order of the distributions ({', '.join(names)}), "
            f"got {shown(correlation)}."
        )
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T) or not np.allclose(np.diag(matrix), 1.0):
        raise DeclarationError(
            f"{owner}: correlation must be symmetric with 1 on its diagonal, got {shown(correlation)}."
        )
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=float)
    except np.linalg.LinAlgError:  # one parameter may follow from others, as with a correlation of 1
        sizes, directions = np.linalg.eigh(matrix)
    if sizes[0] < -SAME:
        raise DeclarationError(f"{owner}: correlation is not positive semidefinite: {shown(correlation)}.")
    return np.asarray(directions * np.sqrt(np.maximum(sizes, 0.0)), dtype=float)
