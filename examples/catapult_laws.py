"""A spring throws a ball over a fence. How probable is this, if stiffness, mass and stretch are uncertain?

The spring gives its energy to the ball, which leaves at 45 degrees. Without drag, the range is k s^2 / (m g). The
stiffness k has a normal distribution, and the mass m a uniform distribution. For the stretch s, only an interval is
known. So there is a lowest and a highest probability. Integrals give both values.
`python examples/catapult_laws.py FOLDER` draws the bounds into FOLDER.

Source: own.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
import scipy.stats as st
from scipy.integrate import quad

import symmb as mb

G, FENCE = 9.81, 8.0

p = mb.Parameters(stiffness=400.0, mass=0.1, stretch=0.14)
ball = mb.Body("ball", p.mass, pose=mb.Particle())
speed = ca.sqrt(p.stiffness * p.stretch**2 / p.mass)
start = {"ball.vx": speed / ca.sqrt(2), "ball.vy": speed / ca.sqrt(2)}
share = mb.t  # time divided by the time of flight: every ball lands at share = 1
system = mb.System(ball, parameters=p)
flight = ca.sqrt(2) * speed / G
scene = mb.Scene(
    system,
    start,
    np.linspace(0, 1, 41),
    {"x": ball.x * flight, "y": (ball.y - G / 2 * flight * share**2) * flight},
    box=mb.Box(stiffness=(340.0, 460.0), mass=(0.095, 0.105), stretch=(0.138, 0.142)),
    name="catapult",
)
bounds = mb.propagate(scene, mb.PolynomialChaos())
distributions = {"stiffness": st.norm(400.0, 15.0), "mass": st.uniform(0.095, 0.01)}
beyond = bounds.probability("x", above=FENCE, distributions=distributions)


def exact(stretch: float) -> float:
    """Probability that the range, stiffness stretch^2 / (mass G), is larger than the distance of the fence."""
    cut = distributions["stiffness"].cdf(460) - distributions["stiffness"].cdf(340)
    value, _ = quad(lambda m: distributions["stiffness"].sf(FENCE * m * G / stretch**2) / 0.01, 0.095, 0.105)
    return value / cut


assert abs(beyond.lower[-1] - exact(0.138)) < beyond.estimate[-1]
assert abs(beyond.upper[-1] - exact(0.142)) < beyond.estimate[-1]
assert beyond.estimate[-1] < 0.05
assert np.abs(bounds["y"][0][-1]) < 1e-6  # it has landed

if __name__ == "__main__":
    print(beyond, bounds.quantiles("x", [0.05, 0.95], distributions=distributions), sep="\n\n")
    if len(sys.argv) > 1:
        bounds.plot(Path(sys.argv[1]) / "catapult_laws.png")
