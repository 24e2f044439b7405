"""Ball dropped onto a floor. Each impact returns a fraction of the ball's speed.

        o   . height          v+ = -e v-  at each impact
        :  .'.
        :  :  :  .-.          g = 9.81 m/s^2 along -y
        : :    : :  :
        :.:    :.:   :..      y is the gap under the ball
    ========================

Impacts happen at t_n = sqrt(2 h / g) (1 + 2 (e + e^2 + ... + e^(n - 1))), with speeds sqrt(2 g h) e^n after them. The
ball is at rest from sqrt(2 h / g) (1 + e) / (1 - e). As functions of e, outputs have kinks at impacts, and rates jump.

Source: Newton's law of restitution; textbook example, e.g. Acary and Brogliato (2008), Numerical Methods for Nonsmooth
Dynamical Systems, section 1.1.
"""

import numpy as np

import symmb as mb


def scene(*, restitution: float = 0.8, height: float = 1.0) -> mb.Scene:
    """A ball dropped from rest.

    Parameters
    ----------
    restitution : float      e, ratio of the speeds after and before an impact, 0 to 1
    height : float           gap at the start [m]
    """
    p = mb.Parameters(restitution=restitution, height=height)
    ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Gravity(0, -9.81), mb.Impact("floor", ball.y, p.restitution), parameters=p)
    return mb.Scene(
        system,
        start={"ball.y": p.height},
        times=np.linspace(0.0, 3.0, 301),
        outputs={"y": ball.y, "y_dot": ball.vy},
        box=mb.Box(restitution=(0.95 * restitution, min(1.0, 1.05 * restitution))),
        name="bouncing ball",
    )
