"""Root loci and Campbell diagrams: eigenvalues against one parameter, with bands over the box of other parameters."""

from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, WithWarnings
from symmb._interrupts import kept_interrupts
from symmb._labelled import Counted
from symmb._names import did_you_mean
from symmb._options import require_instance, whole
from symmb._table import aligned
from symmb._types import Array, Figure
from symmb._units import label, units_of_parameters
from symmb.bound.answers import box_entries, box_of
from symmb.bound.methods import Method, PolynomialChaos, method_of
from symmb.bound.propagation import propagate
from symmb.bound.responses import parameter_samples
from symmb.equations.model import Box, Scene
from symmb.results import plot
from symmb.results.files import NOT_KEPT, Record, Saved, attributes, entries, entry
from symmb.run.linear import QUANTITIES, LinearFamily, LocusSimulator, nominal_locus, require_range
from symmb.run.simulation import scene_of

_CORNERS = 6
"""Up to this number of parameters, all corners of the box are checked for oscillations that vanish in the box."""
_HEAD = ("mode", "from", "to", "frequency [Hz]", "", "smallest damping [-]", "at")


@dataclass(frozen=True, eq=False, repr=False)
class RootLocus(plot.ThreeDiagrams, Counted, WithWarnings, Saved):
    """Eigenvalues against one parameter. `print` lists the oscillations. `save` and `load` write and read files.

    `plot` draws the eigenvalues in the complex plane, and frequency and damping (Campbell diagram).

    Attributes
    ----------
    name, parameter : str
    values : (n,)
        values of the parameter
    eigenvalues : (n, m) complex
        all eigenvalues, sorted by magnitude [1/s]
    modes : (n, k) complex
        eigenvalues of oscillations, with positive imaginary part. Each column belongs to one mode shape; nan without an
        oscillation
    bands : dict
        "f" [Hz], "zeta" [-], "re", "im" [1/s] -> lower and upper bounds over the box, each (n, k). Bounds are nan if
        the oscillation vanishes inside the box. The dictionary is empty without a box
    box : Box
        intervals of the other parameters, or None
    method, evaluations, runs : str, int, int
        method of the bands, and number of runs
    remarks : tuple of str
        sentences about frequencies that cross, and about an exchange of mode shapes
    doubts : tuple of str
        warnings in sentences
    unit : str
        unit of the parameter, '' if it has none

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> locus = mb.root_locus(mb.Scene(system), "k", (1.0, 9.0), count=3)
    >>> locus.eigenvalues.imag.max(axis=1).round(4)
    array([1.    , 2.2361, 3.    ])
    """

    name: str = field(metadata=entry(name="scene"))
    parameter: str
    values: Array = field(metadata=entry(Record.array, None))
    eigenvalues: Array = field(metadata=NOT_KEPT)
    modes: Array = field(metadata=NOT_KEPT)
    bands: dict[str, tuple[Array, Array]] = field(metadata=NOT_KEPT)
    box: Box | None = field(metadata=entry(box_of))
    method: str
    evaluations: int
    remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    unit: str = ""

    @property
    def frequencies(self) -> Array:
        """(n, k) frequencies of the oscillations, nan if the oscillation does not exist [Hz]."""
        return np.abs(self.modes) / (2 * np.pi)

    @property
    def damping(self) -> Array:
        """(n, k) damping ratios of the oscillations, nan if the oscillation does not exist [-]."""
        with np.errstate(invalid="ignore"):  # an eigenvalue of 0 has no damping ratio
            return (0.0 - self.modes.real) / np.abs(self.modes)

    def __str__(self) -> str:
        table = aligned(self._rows()) if self.modes.size else []
        return "\n".join([self._head(), *table, *self._foot()])

    def _repr_html_(self) -> str:
        table = html.table(self._rows()) if self.modes.size else ""
        foot = html.text("\n".join(self._foot()))
        return html.page(html.text(self._head()), table, foot, html.picture(plot.png(self.plot())))

    def _head(self) -> str:
        span = f"{self.parameter} = {self.values[0]:g} to {self.values[-1]:g} {self.unit}".rstrip()
        count = self.modes.shape[1]
        return f"{self.name}: {count} oscillation{'s' * (count != 1)} over {len(self.values)} values, {span}"

    def _rows(self) -> list[list[str]]:
        rows = [[*_HEAD]]
        for k, (f, zeta) in enumerate(zip(self.frequencies.T, self.damping.T, strict=True), 1):
            known = np.flatnonzero(~np.isnan(f))
            first, last, least = known[0], known[-1], known[zeta[known].argmin()]
            numbers = self.values[first], self.values[last], f[first], f[last], zeta[least], self.values[least]
            rows.append([str(k), *(f"{number:.4g}" for number in numbers)])
        return rows

    def _foot(self) -> list[str]:
        bands = []
        if self.box is not None:
            bands = [f"bands over {self.box} by {self.method}, {self.evaluations} evaluations"]
        return [*bands, *self.remarks, *(f"warning: {doubt}" for doubt in self.doubts)]

    def _figure(self, style: plot.Style) -> Figure:
        curves = {"f": self.frequencies, "zeta": self.damping, "re": self.modes.real, "im": self.modes.imag}
        parameter = label(self.parameter, self.unit)
        return plot.plot_root_locus(
            self.values, self.eigenvalues, curves, self.bands, parameter=parameter, title=self.name, style=style
        )

    def _record(self) -> dict[str, Any]:
        parts = {"eigenvalues": self.eigenvalues, "modes": self.modes}
        return {
            **entries(self),
            **{name: {"re": part.real, "im": part.imag} for name, part in parts.items()},
            "bands": {name: {"lower": lower, "upper": upper} for name, (lower, upper) in self.bands.items()},
            **box_entries(self.box),
        }

    @classmethod
    def _of_record(cls, record: Record) -> "RootLocus":
        own, parts = attributes(cls, record), {}
        for name in ("eigenvalues", "modes"):
            real, imaginary = (record.record(name).with_nan(part, len(own["values"]), None) for part in ("re", "im"))
            parts[name] = real + 1j * imaginary
        if np.isnan(parts["modes"]).all(axis=0).any():
            raise DeclarationError("modes must have a number for at least one value.")
        bands = record.record("bands")
        return cls(
            **own, **parts, bands={name: _ends(bands.record(name), *parts["modes"].shape) for name in bands.plain}
        )


def _ends(record: Record, n: int, k: int) -> tuple[Array, Array]:
    return record.with_nan("lower", n, k), record.with_nan("upper", n, k)


@kept_interrupts()
def root_locus(
    scene: Scene,
    parameter: str,
    range: tuple[float, float],
    method: Method | str | None = None,
    box: Box | None = None,
    *,
    count: int = 41,
) -> RootLocus:
    """The eigenvalues of a scene at its start against one parameter, with bands over the box of the other parameters.

    The mode shape identifies each oscillation along the parameter, and in each sample of the box.

    Parameters
    ----------
    scene : Scene
        must start in equilibrium, or in a steady motion, for every value in the range
    parameter : str
        parameter that varies, for example a speed
    range : (lower, upper)
        range of the values, in the unit of the parameter, or in another unit as in (40, 400, "rpm")
    method : optional
        method of the bands; default: PolynomialChaos()
    box : Box, optional
        intervals of the other parameters; default: the box of the scene
    count : int
        number of evenly spaced values

    Raises
    ------
    DeclarationError
        If the parameter does not exist, or the range is empty
    SimulationError
        If the scene does not start at one of the values
    PropagationError
        If too many samples of the box fail

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=9.0, c=0.0)
    >>> mass = mb.Body("mass", mass=1.0, pose=mb.Particle())
    >>> law = mb.Force("law", mass.point(0, 0, 0), (-p.k * mass.x - p.c * mass.vx, 0, 0))
    >>> scene = mb.Scene(mb.System(mass, law, parameters=p), box=mb.Box(k=(4.0, 16.0)))
    >>> locus = mb.root_locus(scene, "c", (0.0, 2.0), mb.Vertex(), count=3)
    >>> locus.damping[:, 0].round(6)
    array([0.      , 0.166667, 0.333333])
    >>> locus.bands["zeta"][1][:, 0].round(6)
    array([0.  , 0.25, 0.5 ])
    """
    scene = scene_of(scene)
    lower, upper = require_range("root_locus", scene, parameter, range)
    # Largest number of values of the parameter. The modes at each value take a millisecond.
    count = whole("root_locus", "count", count, 2, 10_000)
    box = _others(scene, parameter, box)
    family = LinearFamily(scene)
    locus = nominal_locus(family, parameter, np.linspace(lower, upper, count))
    bands, evaluations, doubts, text = {}, 0, family.doubts, ""
    if box is not None and locus.count:
        method = PolynomialChaos() if method is None else method_of("root_locus", method)
        simulator = LocusSimulator(family, parameter, locus)
        simulator.restrict(parameter_samples(simulator, box, _corners(len(box))))
        bounds = propagate(simulator, method, box)
        ends = [np.split(end, len(QUANTITIES), axis=1) for end in (bounds.lower, bounds.upper)]
        known = simulator.known
        bands = {
            name: (np.where(known, least, np.nan), np.where(known, most, np.nan))
            for name, least, most in zip(QUANTITIES, *ends, strict=True)
        }
        text, evaluations, doubts = bounds.method, bounds.evaluations, (*doubts, *bounds.doubts)
    return RootLocus(
        name=scene.name,
        parameter=parameter,
        values=locus.values,
        eigenvalues=np.array([eigen.values for eigen, _ in locus.points]),
        modes=locus.modes,
        bands=bands,
        box=box if bands else None,
        method=text,
        evaluations=evaluations,
        remarks=locus.remarks,
        doubts=doubts,
        unit=units_of_parameters(scene.system.parameters).get(parameter, ""),
    )


def _others(scene: Scene, parameter: str, box: Box | None) -> Box | None:
    """The box without the parameter; None if no parameter is left."""
    box = scene.box if box is None else box
    if box is None:
        return None
    require_instance("root_locus: box", box, Box, "a Box")
    for name in box.names:
        if name not in scene.system.parameters:
            known = did_you_mean(name, scene.system.parameters)
            raise DeclarationError(f"root_locus: the box has {name!r}, which is not a parameter.{known}")
    return box.with_units(units_of_parameters(scene.system.parameters)).without(parameter)


def _corners(d: int) -> Array:
    """Corners (N, d) of the unit box. With more than six parameters, 64 random corners."""
    if d <= _CORNERS:
        return np.array(list(product((-1.0, 1.0), repeat=d)))
    return np.random.default_rng(0).choice([-1.0, 1.0], (2**_CORNERS, d))
