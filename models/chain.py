"""Chain of n equal uniform rods hanging from the ground, released at rest.

    ===o===
        \\ 0.5 rad
         o            total length 1 m, total mass 1 kg
          \\           g = 9.81 m/s^2 down
           o
            \\ ...

Angles are absolute, from the vertical. Source: the usual scaling benchmark of tree-structured systems.
"""

import numpy as np

import symmb as mb


def scene(n: int = 5) -> mb.Scene:
    """A chain of n rods, all at 0.5 rad from the vertical.

    Parameters
    ----------
    n : int     number of rods
    """
    p = mb.Parameters(length=1.0, mass=1.0)
    L, m = p.length / n, p.mass / n
    rods = [mb.Body(f"rod{i}", mass=m, inertia=m * L**2 / 12) for i in range(1, n + 1)]
    ends = [mb.Ground().point(0, 0), *(rod.point(0, -L / 2) for rod in rods)]
    joints = [mb.Revolute(f"joint{i}", ends[i - 1], rod.point(0, L / 2)) for i, rod in enumerate(rods, 1)]
    return mb.Scene(
        mb.System(*rods, *joints, mb.Gravity(0, -9.81), parameters=p),
        start={f"{rod.name}.theta": 0.5 for rod in rods},
        times=np.linspace(0.0, 3.0, 151),
        outputs={
            **{f"theta{i}": rod.theta for i, rod in enumerate(rods, 1)},
            **{f"theta{i}_dot": rod.omega for i, rod in enumerate(rods, 1)},
        },
        box=mb.Box.around(p, 0.05, names=["length"]),
        name=f"chain of {n} rods",
    )
