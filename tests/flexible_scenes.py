"""Flexible beams: the elastica, and random assemblies in the plane with all their finite elements."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_bvp
from scipy.linalg import eigh, null_space

import symmb as mb
from symmb.declare.mechanics import Point

GROUND = mb.Ground()
IN_PLANE = [0, 1, 5]


@dataclass
class Structure:
    """Beams in world axes, joined and loaded: K u = f, C u = 0 for displacements (x, y, angle) of all nodes."""

    K: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    M: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    rows: list[dict[int, float]] = field(default_factory=list)
    loads: dict[int, float] = field(default_factory=dict)

    def add(self, mesh: mb.FiniteElements) -> int:
        """The number of the first degree of freedom of a mesh."""
        some = np.flatnonzero(np.isin(np.arange(mesh.K.shape[0]) % 6, IN_PLANE))
        first = len(self.K)
        for name in "KM":
            own, part = getattr(self, name), getattr(mesh, name).tocsr()[some][:, some].toarray()
            zero = np.zeros((first, len(part)))
            setattr(self, name, np.block([[own, zero], [zero.T, part]]))
        return first

    def deflections(self, gravity: float) -> np.ndarray:
        """Of all degrees of freedom, at rest."""
        f = np.zeros(len(self.K))
        f[list(self.loads)] = list(self.loads.values())
        f -= gravity * self.M @ np.tile([0.0, 1.0, 0.0], len(f) // 3)
        Z = self._free
        return Z @ np.linalg.solve(Z.T @ self.K @ Z, Z.T @ f)

    def frequencies(self) -> np.ndarray:
        """All [Hz], rising."""
        Z = self._free
        return np.sqrt(eigh(Z.T @ self.K @ Z, Z.T @ self.M @ Z, eigvals_only=True)) / (2 * np.pi)

    @property
    def _free(self) -> np.ndarray:
        C = np.zeros((len(self.rows), len(self.K)))
        for row, values in zip(C, self.rows, strict=True):
            row[list(values)] = list(values.values())
        return null_space(C)


@dataclass(frozen=True)
class Assembly:
    """A scene at rest, what its output must be [m], and its frequencies [Hz]."""

    name: str
    scene: mb.Scene
    deflection: float
    frequencies: np.ndarray


class Builder:
    """Beams of random sections and modes in a scene and in a structure."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.structure, self.elements, self.guess = rng, Structure(), [], {}
        self.words: list[str] = []
        self.gravity, self.force = np.inf, np.inf  # those that bend the beams a little [m/s^2], [N]
        self.material = mb.Material(E=10 ** rng.uniform(10, 11.5), density=rng.uniform(1000, 8000), nu=0.3)

    def beam(self, at: ArrayLike, to: ArrayLike, used: Sequence[int], n: int) -> "Beam":
        """A beam of n elements between two places, whose `used` nodes carry joints and forces."""
        rng, name = self.rng, f"beam{len(self.words)}"
        at = np.asarray(at, dtype=float)
        along = np.subtract(to, at)
        length = float(np.linalg.norm(along))
        section = mb.Section.circle(length * rng.uniform(0.005, 0.02))
        mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (*along, 0)], section, self.material, elements=n))
        word, modes = self._modes(mesh, sorted(set(used)), n)
        self.words.append(word)
        body = mb.FlexibleBody(name, modes, mb.Planar())
        self.elements.append(body)
        self.guess |= {f"{name}.x": at[0] + modes.origin[0], f"{name}.y": at[1] + modes.origin[1]}
        EI = self.material.E * section.Iz
        self.gravity = min(self.gravity, 2e-3 * EI / (self.material.density * section.area * length**3))
        self.force = min(self.force, 1e-3 * EI / length**2)
        return Beam(body, self.structure.add(mesh), at, along, n)

    def _modes(self, mesh: mb.FiniteElements, used: list[int], n: int) -> tuple[str, mb.Modes]:
        rng, kind = self.rng, int(self.rng.integers(6))
        if kind in (0, 2):
            count, ends = int(rng.integers(3, 3 * n - 2)), [0, n] if kind else []
            return f"{'interfaces at ends, ' if kind else 'free, '}{count}", mesh.modes(ends, count=count, planar=True)
        if kind == 1:
            return "interfaces at ends", mesh.modes([0, n], planar=True)
        if kind == 3:
            count = max(min(3 * len(used) - 3 + int(rng.integers(0, 4)), 3 * n), 3)
            return f"interfaces where used, {count}", mesh.modes(used, count=count, planar=True)
        if kind == 4:
            count = int(rng.integers(1, 3 * n))
            return f"{count} clamped", mesh.modes(clamped=0, count=count, planar=True)
        others = [k for k in used if k] or [n]
        count = min(3 * len(others) + int(rng.integers(0, 4)), 3 * n)
        return f"clamped, interfaces where used, {count}", mesh.modes(others, clamped=0, count=count, planar=True)

    def hold(self, beam: "Beam", node: int, joint: type) -> None:
        """A joint of a node with the ground."""
        self._joint(joint, GROUND.point(*beam.place(node)), beam.point(node), {beam.first + 3 * node: 1.0})

    def join(self, one: "Beam", i: int, other: "Beam", j: int, joint: type) -> None:
        """A joint between nodes of two beams."""
        row = {one.first + 3 * i: 1.0, other.first + 3 * j: -1.0}
        self._joint(joint, one.point(i), other.point(j), row)

    def _joint(self, joint: type, a: Point, b: Point, row: dict[int, float]) -> None:
        self.elements.append(joint(f"joint{len(self.elements)}", a, b))
        for k in range(3 if joint is mb.Weld else 2):
            self.structure.rows.append({first + k: value for first, value in row.items()})

    def strut(self, beam: "Beam", node: int, foot: np.ndarray) -> None:
        """A rigid rod from the ground to a node."""
        line = beam.place(node) - foot
        length = float(np.linalg.norm(line))
        self.elements.append(mb.Distance("strut", GROUND.point(*foot), beam.point(node), length))
        self.structure.rows.append({beam.first + 3 * node + k: line[k] / length for k in range(2)})

    def push(self, beam: "Beam", node: int, direction: Sequence[float]) -> None:
        """A force that bends the beam a little."""
        size = self.force
        self.elements.append(mb.Force("push", beam.point(node), (size * direction[0], size * direction[1])))
        self.structure.loads |= {beam.first + 3 * node + k: size * direction[k] for k in range(2)}

    def built(self, name: str, beam: "Beam", node: int, direction: Sequence[float], gravity: bool) -> Assembly:
        """The assembly whose output is the displacement of a node along a direction."""
        place, point = beam.place(node), beam.point(node)
        output = sum(c * (r - x) for c, r, x in zip(direction, (point.x, point.y), place, strict=True))
        g = self.gravity if gravity else 0.0
        elements = [*self.elements, *([mb.Gravity(0, -g)] if gravity else [])]
        times = np.array([0.0, 1e-6])
        scene = mb.Scene(mb.System(*elements), times=times, outputs={"d": output}, guess=self.guess, equilibrium=True)
        u = self.structure.deflections(g)[beam.first + 3 * node :][:2]
        words = "; ".join(self.words) + (", gravity" if gravity else "")
        return Assembly(f"{name}: {words}", scene, float(np.dot(u, direction)), self.structure.frequencies())


@dataclass(frozen=True)
class Beam:
    """A beam of an assembly: its body, its first degree of freedom, and its place."""

    body: mb.FlexibleBody
    first: int
    at: np.ndarray
    along: np.ndarray
    n: int

    def place(self, node: int) -> np.ndarray:
        return self.at + self.along * node / self.n

    def point(self, node: int) -> Point:
        return self.body.node(node)


def random_assembly(seed: int) -> Assembly:
    """A cantilever, a beam on two supports, a strutted beam, an angle or a portal."""
    rng = np.random.default_rng(seed)
    b, n, L = Builder(rng), int(rng.integers(4, 11)), rng.uniform(0.3, 3)
    kind = str(rng.choice(["cantilever", "two hinges", "two welds", "weld and hinge", "strut", "angle", "portal"]))
    gravity, down = bool(rng.random() < 0.4), (0.0, -1.0)
    if kind == "angle":
        turn = rng.uniform(0.4, 2.5)
        corner = np.array([L, 0.0])
        end = corner + rng.uniform(0.5, 1.5) * L * np.array([np.cos(turn), np.sin(turn)])
        one, two = b.beam((0, 0), corner, [0, n], n), b.beam(corner, end, [0, n], n)
        b.hold(one, 0, mb.Weld)
        b.join(one, n, two, 0, mb.Weld)
        b.push(two, n, down)
        return b.built(kind, two, n, down, gravity)
    if kind == "portal":
        H = L * rng.uniform(0.5, 1.5)
        left, right = (b.beam((x, 0), (x, H), [0, n], n) for x in (0.0, L))
        top = b.beam((0, H), (L, H), [0, n], n)
        b.hold(left, 0, mb.Weld)
        b.hold(right, 0, mb.Weld)
        b.join(left, n, top, 0, mb.Weld)
        b.join(right, n, top, n, mb.Weld if rng.random() < 0.5 else mb.Revolute)
        b.push(left, n, (1.0, 0.0))
        return b.built(kind, left, n, (1.0, 0.0), gravity)
    at = n if kind == "cantilever" else int(rng.integers(1, n)) if kind != "strut" else n
    inner = int(rng.integers(1, n))
    used = [0, at, *([inner] if kind == "strut" else []), *([] if kind in ("cantilever", "strut") else [n])]
    beam = b.beam((0, 0), (L, 0), used, n)
    b.hold(beam, 0, mb.Revolute if kind in ("two hinges", "strut") else mb.Weld)
    if kind in ("two hinges", "two welds", "weld and hinge"):
        b.hold(beam, n, mb.Weld if kind == "two welds" else mb.Revolute)
    if kind == "strut":
        b.strut(beam, inner, np.array([rng.uniform(-0.3, 0.5) * L, -rng.uniform(0.3, 1) * L]))
    b.push(beam, at, down)
    return b.built(kind, beam, at, down, gravity)


def elastica(load: float) -> np.ndarray:
    """Tip (x, y) over the length of a cantilever under P L^2 / EI at its end."""
    rates = lambda s, y: [y[1], load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]  # noqa: E731
    ends = lambda a, b: [a[0], b[1], a[2], a[3]]  # noqa: E731
    return solve_bvp(rates, ends, np.linspace(0, 1, 101), np.zeros((4, 101)), tol=1e-8).y[2:, -1]
