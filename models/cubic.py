"""A cubic function of one uncertain number: a scene without bodies, as a test of bounds.

    f(x) = x^3 - 2 x^2 + x,  x in [0, 1]            range [0, 4/27], reached at x = 1/3

        f |    _
          |  /   \\
          | /      \\ _
          +------------ x
          0   1/3     1

Natural interval arithmetic gives [-2, 2].

Source: Wang and Yang (2021), Nonlinear Dynamics, eq. (13).
"""

import symmb as mb


def scene() -> mb.Scene:
    """The cubic function, with x in [0, 1]."""
    p = mb.Parameters(x=0.5)
    return mb.Scene(
        mb.System(parameters=p), outputs={"f": p.x**3 - 2 * p.x**2 + p.x}, box=mb.Box(x=(0.0, 1.0)), name="cubic"
    )
