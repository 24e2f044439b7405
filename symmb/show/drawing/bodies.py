"""Bodies as shapes: attached points joined by bars, and solids if the points do not show the size.

A body with at most one point is drawn as a homogeneous rod, disc or solid with its mass and inertia.
"""

from collections.abc import Iterator
from itertools import pairwise

import casadi as ca
import numpy as np

from symmb._magnitudes import NOTHING, SLIGHT, SMALL
from symmb._types import Array
from symmb.declare.mechanics import (
    AxisJoint,
    Body,
    Cylindrical,
    FlexibleBody,
    Link,
    Particle,
    Planar,
    PlanarJoint,
    PointOnLine,
    Prismatic,
    Screw,
    as_matrix,
    inertia_matrix,
)
from symmb.show.drawing.geometry import BodyShapes
from symmb.show.drawing.shapes import Shape
from symmb.show.drawing.survey import Asked, Survey

SOLID = "solid of the same inertia"
"""Kind of the solid of a body, if points also show the size of the body."""
_ROUND = 0.03
"""A solid is drawn as round if the relative difference of its second moments of mass is smaller than this."""


class BodySketch:
    """A body for a drawing. After the numbers are computed, `reach` is its size."""

    def __init__(self, body: Body, colour: str, survey: Survey, own: BodyShapes | None) -> None:
        self.body, self.colour, self.survey = body, colour, survey
        self.frame = survey.frame(body)
        self.mass: Asked | None = None
        if isinstance(body, FlexibleBody):
            self.eta = survey.ask(body.eta)
        else:
            self.mass = survey.ask(survey.bind(body.mass, "mass"))
            self.inertia = survey.ask(inertia_matrix(body, as_matrix(body.inertia, "inertia", survey.bind)))
        self.slides = any(
            isinstance(e, Prismatic | Cylindrical | PointOnLine | PlanarJoint | Screw) and e.point_b.body.owner is body
            for e in survey.scene.system.elements
            if isinstance(e, AxisJoint)
        )
        self.own = own

    @property
    def points(self) -> Array:
        """Attached points in the body's axes, (n, 3) [m]."""
        return np.array([self.survey.base(place) for place in self.survey.attached(self.frame)]).reshape(-1, 3)

    @property
    def second_moments(self) -> tuple[Array, Array]:
        """Variances of the mass along its principal axes, (3,) [m^2], and these axes as columns, (3, 3).

        For a link of a robot, a minimum density and the size of the robot limit the variances.
        """
        m, J = (0.0, np.zeros((3, 3))) if self.mass is None else (self.mass.first[0], self.inertia.first.reshape(3, 3))
        if m <= 0:
            return np.zeros(3), np.eye(3)
        if isinstance(self.body.pose, Planar):
            return np.array([J[2, 2] / m, 0.0, 0.0]), np.eye(3)
        values, axes = np.linalg.eigh(J)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        variances = np.maximum(values.sum() / 2 - values, 0.0) / m
        if isinstance(self.body, Link) and variances.max() and self.survey.span:
            # The density is at least 500 kg/m^3, and the half length at most twice the robot's span per link. Inertias
            # in files are often placeholders, such as 1 kg m^2 for a finger.
            half, most = np.sqrt(3 * variances), m / 500.0
            links = sum(isinstance(body, Link) for body in self.survey.bodies)
            longest = 2.0 * self.survey.span / links
            variances *= min(np.cbrt(most / max(8 * half.prod(), most)), longest / half.max(), 1.0) ** 2
        return variances, axes

    @property
    def reach(self) -> float:
        """The longest extent of the body [m]."""
        if isinstance(self.body, FlexibleBody):
            return float(np.ptp(self.body.modes.positions, axis=0).max())
        if self.own:
            return max(self.own.reach, float(np.ptp(np.vstack([self.points, np.zeros(3)]), axis=0).max()))
        extent = np.ptp(np.vstack([self.points, np.zeros(3)]), axis=0).max()
        return float(max(extent, 0.0 if self.slides else np.sqrt(12 * self.second_moments[0].max())))

    def shapes(self, u: float) -> Iterator[Shape]:
        """The shapes of the body, for the unit of length u [m]."""
        if isinstance(self.body, FlexibleBody):
            yield from self._net(u)
            return
        if self.own and not self.own.unread:
            return
        points = _distinct(self.points, SLIGHT * u)
        far = [p for p in points if np.linalg.norm(p) > SLIGHT * u]
        if isinstance(self.body.pose, Particle):
            yield self._shape("ball", (self._at(np.zeros(3)),), (2.2 * u,))
            return
        if isinstance(self.body.pose, Planar):
            if len(points) < 2 and not self.slides:
                yield from self._rod_or_disc(far, u)
        else:
            yield from self._solid(u, alone=len(points) < 2 and not self.slides)
            if len(far) == 1 == len(points):
                yield self._bar(np.zeros(3), far[0], u)
        yield from self._joined(points, u)
        yield self._shape("ball", (self._at(np.zeros(3)),), (1.15 * u,), kind="centre of mass")

    def _shape(self, form: str, places: tuple[int, ...], size: tuple[float, ...], kind: str = "", **more) -> Shape:
        return Shape(form, self.body.name, kind or type(self.body).__name__, self.colour, places, size, **more)

    def _at(self, local: Array) -> int:
        return self.survey.fixed(self.frame, local)

    def _bar(self, a: Array, b: Array, u: float) -> Shape:
        return self._shape("bar", (self._at(a), self._at(b)), (u,))

    def _rod_or_disc(self, far: list[Array], u: float) -> Iterator[Shape]:
        """A planar body with at most one point: a homogeneous rod through the point, a bob, or a disc around it."""
        radius = float(np.sqrt(self.second_moments[0].max()))
        if not far:
            if radius:
                half = np.diag([np.sqrt(2) * radius, np.sqrt(2) * radius, 0.4 * u])
                yield self._shape("solid", (self._at(np.zeros(3)),), (1,), direction=half, faint=True)
                yield self._bar(np.zeros(3), np.array([np.sqrt(2) * radius, 0.0, 0.0]), 0.5 * u)
            return
        end = -far[0] / np.linalg.norm(far[0]) * np.sqrt(3) * radius
        if np.linalg.norm(end) < 0.2 * np.linalg.norm(far[0]):
            yield self._shape("ball", (self._at(np.zeros(3)),), (2.2 * u,))
            end = np.zeros(3)
        yield self._bar(far[0], end, u)

    def _solid(self, u: float, *, alone: bool) -> Iterator[Shape]:
        """The homogeneous box, cylinder or ball of the same inertia."""
        variances, axes = self.second_moments
        if not variances.max():
            return
        order = np.argsort(variances)
        low, middle, high = variances[order]
        if high - low < _ROUND * high:
            form, half = 2, np.sqrt(5 * variances)
        elif middle - low < _ROUND * middle or high - middle < _ROUND * high:
            form = 1
            axial = order[2] if middle - low < _ROUND * middle else order[0]
            axes = np.roll(axes, 2 - axial, axis=1)
            variances = np.roll(variances, 2 - axial)
            half = np.array([2, 2, np.sqrt(3)]) * np.sqrt(variances)
        else:
            form, half = 0, np.sqrt(3 * variances)
        half = np.maximum(half, 0.3 * u)
        kind = "" if alone else SOLID
        yield self._shape("solid", (self._at(np.zeros(3)),), (form,), kind, direction=axes * half, faint=True)
        if alone:  # a spoke shows the rotation
            yield self._bar(np.zeros(3), axes[:, 0] * half[0], 0.6 * u)

    def _joined(self, points: list[Array], u: float) -> Iterator[Shape]:
        """A bar between two points, the edges of a plate for points in a plane, or the edges of their convex hull."""
        if len(points) < 2:
            return
        cloud = np.array(points)
        middle = cloud.mean(axis=0)
        _, spread, axes = np.linalg.svd(cloud - middle)
        rank = int((spread > SMALL * spread[0]).sum())
        if rank == 1:
            center = np.zeros(3)
            is_beside = np.linalg.norm(np.cross(cloud[0], cloud[1])) > 2 * u * np.linalg.norm(cloud[1] - cloud[0])
            if not is_beside:  # the bar reaches the centre of mass, which may be beyond the points
                cloud = np.vstack([cloud, center])
            along = (cloud - middle) @ axes[0]
            a, b = cloud[along.argmin()], cloud[along.argmax()]
            yield self._bar(a, b, u)
            if is_beside:
                yield self._shape("plate", (self._at(a), self._at(b), self._at(center)), (u,), faint=True)
                for end in (a, b):
                    yield self._bar(center, end, 0.45 * u)
            return
        from scipy.spatial import ConvexHull

        hull = ConvexHull((cloud - middle) @ axes[:rank].T)
        if rank == 2:
            corners = [self._at(cloud[k]) for k in hull.vertices]
            yield self._shape("plate", tuple(corners), (0.8 * u,), faint=True)
            edges = set(pairwise([*hull.vertices.tolist(), int(hull.vertices[0])]))
        else:
            edges = _edges(hull)
        for i, k in sorted(edges):
            yield self._bar(cloud[i], cloud[k], 0.8 * u)
        inner = set(range(len(cloud))) - {i for edge in edges for i in edge}
        for i in sorted(inner):
            corner = min(hull.vertices, key=lambda k: np.linalg.norm(cloud[k] - cloud[i]))
            yield self._bar(cloud[i], cloud[corner], 0.6 * u)

    def _net(self, u: float) -> Iterator[Shape]:
        """The mesh of a flexible body. Its nodes move."""
        assert isinstance(self.body, FlexibleBody)
        modes, eta, symbols = self.body.modes, self.eta(), self.eta.expression
        assert symbols is not None
        moved = np.einsum("kin,tn->tki", modes.shapes, eta) + modes.positions
        if modes.shapes2.any():
            moved = moved + np.einsum("kinm,tn,tm->tki", modes.shapes2, eta, eta)
        nodes = []
        for k, position in enumerate(modes.positions):
            of_motion = position + ca.DM(modes.shapes[k]) @ symbols
            if modes.shapes2.any():
                of_motion += ca.vertcat(*(symbols.T @ ca.DM(square) @ symbols for square in modes.shapes2[k]))
            nodes.append(self.survey.moving(self.frame, position, Asked(moved[:, k], of_motion)))
        for i, k in mesh_edges(modes.positions):
            yield self._shape("bar", (nodes[i], nodes[k]), (u,))


def _distinct(points: Array, distance: float) -> list[Array]:
    distinct: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > distance for other in distinct):
            distinct.append(point)
    return distinct


def _edges(hull) -> set[tuple[int, int]]:
    """Edges of a convex hull in space between facets in different planes."""
    normals: dict[tuple[int, int], list[Array]] = {}
    for corners, equation in zip(hull.simplices.tolist(), hull.equations, strict=True):
        for i, k in ((0, 1), (1, 2), (0, 2)):
            normals.setdefault((min(corners[i], corners[k]), max(corners[i], corners[k])), []).append(equation[:3])
    return {edge for edge, (a, b) in normals.items() if a @ b < 1 - SLIGHT}


def mesh_edges(positions: Array, nearest: int = 12, reach: float = 1.6) -> list[tuple[int, int]]:
    """Pairs of nodes to join, because modes have nodes but no elements.

    All edges of the minimum spanning tree are joined. A pair is also joined if it is not much longer than nearby edges
    of the tree, and if no third node is in the ball with the pair as its diameter. (This Gabriel graph reproduces
    chains and grids.) Pairs are searched among the `nearest` nodes, up to a `reach` relative to edges of the tree.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree
    from scipy.spatial import KDTree

    count = len(positions)
    if count < 2:
        return []
    near = min(nearest, count - 1)
    distances, neighbours = map(np.asarray, KDTree(positions).query(positions, near + 1))
    rows = np.repeat(np.arange(count), near)
    columns, lengths = neighbours[:, 1:].ravel(), distances[:, 1:].ravel()
    tree = minimum_spanning_tree(coo_array((np.maximum(lengths, NOTHING), (rows, columns)), (count, count))).tocoo()
    edges = {(min(i, k), max(i, k)) for i, k in zip(tree.row.tolist(), tree.col.tolist(), strict=True)}
    longest = np.zeros(count)  # longest edge of the tree at each node
    np.maximum.at(longest, tree.row, tree.data)
    np.maximum.at(longest, tree.col, tree.data)
    for i, k, length in zip(rows.tolist(), columns.tolist(), lengths, strict=True):
        if length > reach * min(longest[i], longest[k]):
            continue
        middle = (positions[i] + positions[k]) / 2
        others = np.delete(positions[neighbours[i]], [0, int(np.flatnonzero(neighbours[i] == k)[0])], axis=0)
        if (np.linalg.norm(others - middle, axis=1) > length / 2 * (1 + SLIGHT)).all():
            edges.add((min(i, k), max(i, k)))
    return sorted(edges)
