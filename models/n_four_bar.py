"""N four-bar windows side by side: N + 1 equal cranks joined by N equal couplers, one degree of freedom.

     B0        B1        B2
      o---------o---------o  - - -
      |         |         |
      |         |         |  crank, length 1, mass 1        g = 9.81 m/s^2 down
      |         |         |
    ==o=========o=========o==

At the start all cranks are upright and B0 moves at 1 m/s to the right. When the cranks are horizontal (at 0.71 s), the
constraints lose rank. Runs need special treatment to pass this position.

Source: IFToMM benchmark A02; Gonzalez, Dopico, Lugris, Cuadrado (2006), Multibody System Dynamics 16, 179-190.
"""

import numpy as np

import symmb as mb


def scene(N: int = 2) -> mb.Scene:
    """The mechanism with N windows, up to 0.6 s, before the cranks are horizontal.

    Parameters
    ----------
    N : int     number of windows
    """
    p = mb.Parameters(length=1.0, mass=1.0)
    ground, L = mb.Ground(), p.length
    rod = p.mass, p.mass * L**2 / 12  # mass and moment of inertia
    cranks = [mb.Body(f"crank{i}", *rod) for i in range(N + 1)]  # along their y axes
    couplers = [mb.Body(f"coupler{i}", *rod) for i in range(N)]  # along their x axes
    joints = [mb.Revolute(f"foot{i}", ground.point(i * L, 0), crank.point(0, -L / 2)) for i, crank in enumerate(cranks)]
    for i, coupler in enumerate(couplers):
        left, right = cranks[i].point(0, L / 2), cranks[i + 1].point(0, L / 2)
        joints.append(mb.Revolute(f"left{i}", left, coupler.point(-L / 2, 0)))
        joints.append(mb.Revolute(f"right{i}", right, coupler.point(L / 2, 0)))
    B0 = cranks[0].point(0, L / 2)
    return mb.Scene(
        mb.System(*cranks, *couplers, *joints, mb.Gravity(0, -9.81), parameters=p),
        start={"crank0.theta": 0.0, "crank0.omega": -1.0 / L},
        times=np.linspace(0.0, 0.6, 61),
        outputs={"B0_x": B0.x, "B0_y": B0.y, "B0_x_dot": B0.vx, "B0_y_dot": B0.vy},
        box=mb.Box.around(p, 0.05, names=["length"]),
        name=f"{N} four-bar windows",
    )
