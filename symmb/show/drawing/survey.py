"""The numbers of a run that a drawing needs. Requests are collected, and all numbers are computed together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import NOTHING, ROUNDING, SAME
from symmb._types import Array, Expr
from symmb.declare.mechanics import AbstractBody, Element, FlexibleBody, Ground, JointEvent, Latch, Point, row_gates
from symmb.declare.symbolic import vector
from symmb.equations.model import Scene
from symmb.run.simulation import Trajectory
from symmb.show.drawing.shapes import FramePoint, MovingFrame, Shape


@dataclass(eq=False)
class Asked:
    """Values of an expression along the run, available after `evaluate`: (1, n) if constant, otherwise (n_f, n).

    Values that are given as numbers have no expression.
    """

    values: Array | None = None
    expression: ca.SX | None = None

    def __call__(self) -> Array:
        if self.values is None:
            raise RuntimeError("the survey is not evaluated yet")
        return self.values

    @property
    def first(self) -> Array:
        """The values at the first time, (n,)."""
        return self()[0]


@dataclass(frozen=True, eq=False)
class Driven:
    """Numbers of a drawing that a live page computes for other parameters.

    Attributes
    ----------
    part : ("frames", i, "pose"), ("places", i, "base"), ("places", i, "shift"), ("shapes", i, "direction") ...
    expression : the numbers of a picture
    moves : whether each picture has numbers of its own
    """

    part: tuple[str, int, str]
    expression: ca.SX
    moves: bool


class Survey:
    """Places, directions and expressions of a scene. `evaluate` computes their numbers along a run.

    `draw` then sets the direction `down` and the length `span` [m]. `span` is the diagonal of the box around attached
    points and centres of mass at the start.
    """

    def __init__(self, run: Trajectory, scene: Scene) -> None:
        self.run, self.scene = run, scene
        self.bind = self.scene.system.bind
        self.bodies: list[AbstractBody] = [Ground(), *self.scene.system.bodies]
        self._asked: list[Asked] = []
        self._seen: list[Asked] = []
        self._places: list[tuple[int, Asked, Asked | None]] = []
        self._known: dict[tuple[int, int], int] = {}
        self._keep: list[Point] = []
        self.down = np.array([0.0, 0.0, -1.0])
        self.span = 0.0
        events = [e for e in scene.system.elements if isinstance(e, JointEvent)]
        self._gates = {name: self.ask(gate) for name, gate in row_gates(events).items()}
        self._grips = {e.joint.name: e.grip for e in events if isinstance(e, Latch)}
        self._poses = [self.ask(ca.horzcat(body.frame.R, body.frame.r)) for body in self.bodies]

    def ask(self, expression: Expr) -> Asked:
        """The values of an expression along the run. The run must contain the values of all symbols."""
        bound = ca.vec(self.scene.expression(expression))
        known = {state.sx.element_hash() for state in self.scene.system.collected.states}
        if any(state.sx.element_hash() not in known for state in self.bind.states(bound)):
            raise DeclarationError("a state is missing")
        asked = Asked(expression=ca.densify(bound))
        self._asked.append(asked)
        return asked

    def acting(self, element: Element) -> Element:
        """The element itself. If a joint closes in the run, the joint that then holds the bodies is returned."""
        return self._grips.get(element.name, element)

    def closed(self, joint: Element) -> Array | None:
        """1 in pictures in which a joint is closed, otherwise 0, (n_f, 1) or (1, 1); None if the joint cannot open."""
        gate = self._gates.get(joint.name)
        return None if gate is None else gate()

    def frame(self, body: AbstractBody) -> int:
        """Index of the frame that carries a point or a node. The body of the frame must be in the scene."""
        owner = body.owner
        number = 0 if isinstance(owner, Ground) else next((i for i, b in enumerate(self.bodies) if b is owner), None)
        if number is None:
            raise DeclarationError(f"Body {owner.name!r} is not in this scene.")
        return number

    def place(self, point: Point) -> int:
        """Index of the place of a point."""
        key = id(point.body), id(point.s)
        if key not in self._known:
            self._keep.append(point)  # no other object can then have the same id
            number, owner = self.frame(point.body), point.body.owner
            if owner is point.body:
                base, now = self.ask(point.s), None
            else:
                local = owner.frame.R.T @ (point.r - owner.frame.r)
                eta = owner.eta if isinstance(owner, FlexibleBody) else ca.SX(0, 1)
                base, now = self.ask(ca.substitute(local, eta, ca.SX.zeros(eta.shape))), self.ask(local)
            self._known[key] = self._add(number, base, now)
        return self._known[key]

    def fixed(self, frame: int, local: Array) -> int:
        """Add a place that is fixed in a frame, at (3,) [m] in its axes, and return the index of the place."""
        return self._add(frame, Asked(np.asarray(local, dtype=float)[None]), None)

    def moving(self, frame: int, base: Array, now: Asked) -> int:
        """Add the place of an elastic point, (3,) undeformed and (n_f, 3) along the run [m], and return its index."""
        return self._add(frame, Asked(base[None]), now)

    def tracked(self, world: Asked) -> int:
        """Add a place given by world positions, (1, 3) if constant, otherwise (n_f, 3) [m], and return its index."""
        return self._add(0, world, None)

    def shifted(self, place: int, by: Array) -> int:
        """Add a place at a distance (3,) or (n_f, 3) [m] from another place of the same frame, and return its index."""
        frame, base, now = self._places[place]
        own = None if base.expression is None or len(by.reshape(-1, 3)) > 1 else base.expression + by.ravel()
        return self._add(frame, Asked(base() + by, own), None if now is None else Asked(now() + by))

    def _add(self, frame: int, base: Asked, now: Asked | None) -> int:
        self._places.append((frame, base, now))
        return len(self._places) - 1

    def direction(self, body: AbstractBody, axis: Expr) -> Asked:
        """A vector that is fixed in a body, in the axes of the frame that carries it, (1, 3) or (n_f, 3)."""
        local = axis if isinstance(axis, ca.SX) else vector(axis)
        owner = body.owner
        return self.ask(local if owner is body else owner.frame.R.T @ body.frame.R @ local)

    def evaluate(self) -> None:
        """Compute all requested numbers."""
        if not self._asked:
            return
        values = np.atleast_2d(
            self.run(ca.vertcat(*[asked.expression for asked in self._asked if asked.expression is not None]))
        )
        values = values.reshape(len(self.run.t), -1)
        end = 0
        for asked in self._asked:
            assert asked.expression is not None
            begin, end = end, end + asked.expression.numel()
            part = values[:, begin:end]
            at_rest = np.ptp(part, axis=0).max(initial=0.0) <= ROUNDING * np.abs(part).max(initial=0.0)
            asked.values = part[:1] if at_rest else part
        self._seen += self._asked
        self._asked = []

    def track(self, place: int) -> Array:
        """World positions of a place along the run, (n_f, 3) or (1, 3) [m]."""
        frame, base, now = self._places[place]
        pose, local = self.pose(frame), (base if now is None else now)()
        return (pose[:, :, :3] @ local[:, :, None])[:, :, 0] + pose[:, :, 3]

    @property
    def count(self) -> int:
        """Number of places."""
        return len(self._places)

    def base(self, place: int) -> Array:
        """Position of an undeformed place at the start, in the axes of its frame, (3,) [m]."""
        return self._places[place][1]()[0]

    def pose(self, frame: int) -> Array:
        """[R | r] of a frame, (n_f, 3, 4) or (1, 3, 4)."""
        return self._poses[frame]().reshape(-1, 4, 3).transpose(0, 2, 1)

    def away(self, place: int) -> Array:
        """The direction from a place at the start to its support, (1, 3): down, or up if bodies hang below the
        place."""
        centers = np.mean([self.pose(i)[0, :, 3] for i in range(1, len(self.bodies))], axis=0)
        return (self.down if self.down @ (centers - self.track(place)[0]) <= 0 else -self.down)[None]

    def attached(self, frame: int) -> list[int]:
        """The places in a frame at which elements are attached."""
        return [place for place in self._known.values() if self._places[place][0] == frame]

    def frames(self) -> tuple[MovingFrame, ...]:
        """The frame of the ground and the frames of the bodies."""
        return tuple(MovingFrame(body.name, self.pose(i)) for i, body in enumerate(self.bodies))

    def places(self) -> tuple[FramePoint, ...]:
        """All requested places, in the order of their indices."""
        return tuple(_place(frame, base(), None if now is None else now()) for frame, base, now in self._places)

    def driven(self, shapes: Sequence[Shape]) -> Iterator[Driven]:
        """The numbers of the drawing that depend on the state, on the time or on parameters."""
        for i, pose in enumerate(self._poses):
            assert pose.expression is not None
            rows = ca.vec(ca.reshape(pose.expression, 3, 4).T)
            if ca.symvar(rows):
                yield Driven(("frames", i, "pose"), rows, True)
        for i, (frame, base, now) in enumerate(self._places):
            own, shifted = base.expression, None if now is None else now.expression
            if own is not None and ca.symvar(own):
                if now is None and self._moves(own):
                    yield Driven(("places", i, "shift"), own - base.first, True)
                else:
                    yield Driven(("places", i, "base"), own, False)
            elif own is None and now is None and (alike := self._alike(frame, base.first)) is not None:
                yield Driven(("places", i, "base"), alike, False)
            if shifted is not None:
                yield Driven(("places", i, "shift"), shifted - (base.first if own is None else own), True)
        for i, shape in enumerate(shapes):
            for name, values in (("direction", shape.direction), ("present", shape.present)):
                source = None if values is None or len(values) == 1 or shape.form == "mesh" else self._source(values)
                if source is not None:
                    yield Driven(("shapes", i, name), source, True)

    def _alike(self, frame: int, at: Array) -> ca.SX | None:
        """The position of an attached point that is equal to a fixed position, or mirrored: the end of a body's bar."""
        for other, base, now in self._places:
            own = base.expression
            if other == frame and now is None and own is not None and ca.symvar(own) and not self._moves(own):
                for sign in (1.0, -1.0):
                    if np.allclose(sign * base.first, at, rtol=SAME, atol=SAME * self.span):
                        return sign * own
        return None

    def _moves(self, expression: ca.SX) -> bool:
        """Whether an expression depends on the state or on the time, and not only on parameters."""
        fixed = {symbol.element_hash() for symbol in ca.symvar(self.scene.system.p)}
        return any(symbol.element_hash() not in fixed for symbol in ca.symvar(expression))

    def _source(self, values: Array) -> ca.SX | None:
        """The expression of values along the run, which may be scaled, normalised, or taken from 1; None if unknown."""
        for asked in self._seen:
            own, y = asked.expression, asked()
            if own is None or y.shape != values.shape:
                continue
            most = np.unravel_index(np.abs(y).argmax(), y.shape)
            scale = float(values[most] / y[most]) if y[most] else 0.0
            size = np.maximum(np.linalg.norm(y, axis=1, keepdims=True), NOTHING)
            for expression, now in (
                (scale * own, scale * y),
                (own / ca.fmax(ca.norm_2(own), NOTHING), y / size),
                (1 - own, 1 - y),
            ):
                if np.allclose(now, values, rtol=SAME, atol=SAME):
                    return expression
        return None


def _place(frame: int, base: Array, now: Array | None) -> FramePoint:
    if now is not None:
        return FramePoint(frame, base[0], now - base[0], elastic=True)
    if len(base) > 1:
        return FramePoint(frame, base[0], base - base[0])
    return FramePoint(frame, base[0])
