r"""A block on a moving belt, held by a spring. The block sticks, breaks away, slips back, and sticks again.

        |      spring
       /|             ____
       /|---/\/\/\---|____|  -> x
       /|          o===========o
       /|             -> speed

The belt carries the block until the spring force reaches static friction, mu_s N. Sliding friction is lower, so the
block swings back until its speed equals the belt's speed. With A = (mu_s - mu_k) N / k, w^2 = k / m and belt speed V
the period is 2 A / V + 2 (pi - atan(A w / V)) / w.

Source: textbook oscillator, e.g. Leine, van Campen, de Kraker, van den Steen, Stick-slip vibrations induced by
alternate friction models, Nonlinear Dynamics 16 (1998).
"""

import numpy as np

import symmb as mb


def scene(
    *,
    mass: float = 1.0,
    stiffness: float = 100.0,
    speed: float = 0.1,
    normal_force: float = 10.0,
    static: float = 0.4,
    kinetic: float = 0.25,
    bristles: float = 3e4,
    stribeck: float = 2e-3,
) -> mb.Scene:
    """A block that starts at the rest position of its spring. The run shows three and a half periods.

    Parameters
    ----------
    mass : float               mass of the block [kg]
    stiffness : float          stiffness of the spring [N/m]
    speed : float              speed of the belt [m/s]
    normal_force : float       force between block and belt [N]
    static, kinetic : float    coefficients of friction [-]
    bristles : float           stiffness of the bristles [1/m]
    stribeck : float           speed of slip at which friction decreases to kinetic friction [m/s]

    The formula in the module's docstring is for stiff bristles and sudden slip. The default period is 0.3 % shorter.
    """
    p = mb.Parameters(stiffness=stiffness, speed=speed)
    wall = mb.Ground().point(0, 0)
    block = mb.Body("block", mass=mass, pose=mb.Particle())
    belt = mb.Body("belt", mass=1.0, pose=mb.Particle())
    law = mb.Bristle(kinetic, bristles, damping=0.3 * bristles**0.5, static=static, speed=stribeck)
    system = mb.System(
        block,
        belt,
        mb.Motion("drive", belt.x, p.speed * mb.t),
        mb.Spring("spring", wall, block.point(0, 0), p.stiffness),
        mb.Friction("friction", belt.point(0, 0), block.point(0, 0), (1, 0, 0), normal_force, law),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"block.x": 0.0, "block.y": 0.0, "block.z": 0.0, "block.vx": p.speed},
        times=np.linspace(0.0, 3.0, 301),
        outputs={"x": block.x, "vx": block.vx, "slip": block.vx - belt.vx},
        box=mb.Box.around(p, 0.01),
        name="stick-slip oscillator",
    )
