"""The contents of a drawing: frames that move, places in frames, and shapes at places, as numbers only.

Pages, stills and films are made from a `Drawing`, without bodies or joints.
"""

from dataclasses import dataclass, field

import numpy as np

from symmb._types import Array


@dataclass(frozen=True, eq=False)
class MovingFrame:
    """A moving frame: `pose` (n_f, 3, 4) is [R | r], body to world [-, m]. A fixed frame has `pose` (1, 3, 4)."""

    name: str
    pose: Array


@dataclass(frozen=True, eq=False)
class FramePoint:
    """A point in the axes of a frame [m]: `base`, plus `shift` (1, 3) or (n_f, 3) if the point moves in the frame.

    In a flexible body (`elastic`), the shift is the deformation at the point. Viewers may enlarge deformations.
    """

    frame: int
    base: Array
    shift: Array | None = None
    elastic: bool = False


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape at places, with the name and the kind of its body or element.

    form     places       direction, in the frame of the first place        size [m]
    bar      a, b         -                                                 radius
    curve    a, b, c ...  -                                                 radius
    ball     a            -                                                 radius
    pin      a            axis, (1, 3) or (n_f, 3), a unit vector           radius, length: centred at a
    block    a            axis of the first side                            sides
    ring     a            axis                                              radius, radius of the tube
    solid    a            half axes as columns, (3, 3)                      0: box, 1: cylinder along the third, 2: ball
    mesh     a            corners of triangles, (3 m, 3), from the frame     radius about a; 1: a closed surface
    plate    a, b, c ...  -                                                 thickness; a convex polygon in order
    coil     a, b         -                                                 radius, offset across
    dashpot  a, b         -                                                 radius, offset across
    dashes   a, b         -                                                 radius
    spiral   a            axis                                              radius
    arrow    a            vector in world axes, length as drawn             radius
    twist    a            torque in world axes, length as drawn             radius
    plane    a            normal                                            side
    support  a            -                                                 size: fixed to the ground
    path     a            -                                                 radius: the path of the place over the run

    `present` (n_f, 1) or (1, 1) is 1 in pictures with the shape, and 0 in others. None: all pictures have the shape.
    """

    form: str
    name: str
    kind: str
    colour: str
    places: tuple[int, ...]
    size: tuple[float, ...]
    direction: Array | None = None
    faint: bool = False
    present: Array | None = None


@dataclass(frozen=True, eq=False)
class Drawing:
    """A drawn run: all contents of pages, stills and films.

    Attributes
    ----------
    name : str
    t : (n_f,)                 times of the pictures [s]: output times of the run, all or every n-th
    frames, places, shapes     frame 0 is the ground
    camera : (3, 3)            rows: directions to the right, up and to the viewer, in world axes
    planar : bool              whether all motion is in the xy plane
    up : (3,)                  direction against gravity, in world axes
    size, unit : float         size of the mechanism, and radius of its bars [m]
    gravity : (3,)             acceleration of gravity [m/s^2]
    outputs, values            labels, and values (n_f, n_y)
    notes : tuple of str       elements that are not drawn, because they have no place
    """

    name: str
    t: Array
    frames: tuple[MovingFrame, ...]
    places: tuple[FramePoint, ...]
    shapes: tuple[Shape, ...]
    camera: Array
    planar: bool
    up: Array
    size: float
    unit: float
    gravity: Array
    outputs: tuple[str, ...]
    values: Array
    notes: tuple[str, ...] = field(default=())

    def pose(self, frame: int, k: int) -> Array:
        """Pose [R | r] (3, 4) of a frame in picture k."""
        pose = self.frames[frame].pose
        return pose[min(k, len(pose) - 1)]

    def local(self, place: int, k: int, scale: float = 1.0) -> Array:
        """Position (3,) of a place in its frame in picture k, with deformations enlarged by `scale` [m]."""
        at = self.places[place]
        if at.shift is None:
            return at.base
        return at.base + (scale if at.elastic else 1.0) * at.shift[min(k, len(at.shift) - 1)]

    def position(self, place: int, k: int, scale: float = 1.0) -> Array:
        """World position (3,) of a place in picture k [m]."""
        pose = self.pose(self.places[place].frame, k)
        return pose[:, :3] @ self.local(place, k, scale) + pose[:, 3]

    def has(self, shape: Shape, k: int) -> bool:
        """Whether picture k has a shape."""
        return shape.present is None or bool(shape.present[min(k, len(shape.present) - 1)] > 0.5)

    def box(self) -> tuple[Array, Array]:
        """Smallest and largest world coordinates (3,) of all places over all pictures [m]."""
        if not self.places:
            return np.zeros(3), np.ones(3)
        tracks = np.vstack([self.track(i) for i in range(len(self.places))])
        return tracks.min(axis=0), tracks.max(axis=0)

    def track(self, place: int) -> Array:
        """World positions (n_f, 3) of a place, or (1, 3) if the place is fixed [m]."""
        at = self.places[place]
        pose = self.frames[at.frame].pose
        local = at.base[None] if at.shift is None else at.base + at.shift
        return (pose[:, :, :3] @ local[:, :, None])[:, :, 0] + pose[:, :, 3]
