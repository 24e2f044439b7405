"""The numbers of a run that a drawing needs. They are requested one by one, and evaluated together."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import ROUNDING
from symmb._types import Array, Expr
from symmb.declare.mechanics import AbstractBody, Element, FlexibleBody, Ground, JointEvent, Latch, Point, row_gates
from symmb.declare.symbolic import vector
from symmb.equations.model import Scene
from symmb.run.simulation import Trajectory
from symmb.show.drawing.shapes import FramePoint, MovingFrame


@dataclass(eq=False)
class Asked:
    """Values of an expression along the run, available after `evaluate`: (1, n) if constant, otherwise (n_f, n)."""

    values: Array | None = None

    def __call__(self) -> Array:
        if self.values is None:
            raise RuntimeError("the survey is not evaluated yet")
        return self.values

    @property
    def first(self) -> Array:
        """The values at the first time, (n,)."""
        return self()[0]


class Survey:
    """Places, directions and expressions of a scene. `evaluate` computes their numbers along a run.

    `draw` then sets the direction `down` and the length `span` [m]. `span` is the diagonal of the box around attached
    points and centres of mass at the start.
    """

    def __init__(self, run: Trajectory, scene: Scene) -> None:
        self.run, self.scene = run, scene
        self.bind = self.scene.system.bind
        self.bodies: list[AbstractBody] = [Ground(), *self.scene.system.bodies]
        self._asked: list[tuple[ca.SX, Asked]] = []
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
        asked = Asked()
        self._asked.append((ca.densify(bound), asked))
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

    def moving(self, frame: int, base: Array, now: Array) -> int:
        """Add the place of an elastic point, (3,) undeformed and (n_f, 3) along the run [m], and return its index."""
        return self._add(frame, Asked(base[None]), Asked(now))

    def tracked(self, world: Asked) -> int:
        """Add a place given by world positions, (1, 3) if constant, otherwise (n_f, 3) [m], and return its index."""
        return self._add(0, world, None)

    def shifted(self, place: int, by: Array) -> int:
        """Add a place at a distance (3,) or (n_f, 3) [m] from another place of the same frame, and return its index."""
        frame, base, now = self._places[place]
        return self._add(frame, Asked(base() + by), None if now is None else Asked(now() + by))

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
        values = np.atleast_2d(self.run(ca.vertcat(*[expression for expression, _ in self._asked])))
        values = values.reshape(len(self.run.t), -1)
        end = 0
        for expression, asked in self._asked:
            begin, end = end, end + expression.numel()
            part = values[:, begin:end]
            at_rest = np.ptp(part, axis=0).max(initial=0.0) <= ROUNDING * np.abs(part).max(initial=0.0)
            asked.values = part[:1] if at_rest else part
        self._asked.clear()

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


def _place(frame: int, base: Array, now: Array | None) -> FramePoint:
    if now is not None:
        return FramePoint(frame, base[0], now - base[0], elastic=True)
    if len(base) > 1:
        return FramePoint(frame, base[0], base - base[0])
    return FramePoint(frame, base[0])
