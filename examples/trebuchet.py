"""A trebuchet throws a stone of 90 kg. How far does the stone fly, and which tolerances change the range most?

A weight hangs on the short arm of a beam and falls. A sling on the long arm pulls the stone along a trough until the
stone lifts off: the joint of the trough opens when its force changes its sign. The sling slips off its hook when it is
nearly in line with the beam. As a check, Lagrange's equations in three angles and a parabola give the same range.
`python examples/trebuchet.py FOLDER` draws the machine into FOLDER.

Source: own values; the machine is as large as the trebuchet at Warwick Castle.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

G, PIVOT, LONG, SHORT, BEAM, HANGER, FIELD = 9.81, 5.0, 8.0, 2.0, 600.0, 1.5, -0.5
INERTIA, CENTRE, BEGIN = BEAM * (LONG + SHORT) ** 2 / 12, (LONG - SHORT) / 2, np.pi + np.arcsin(4.5 / LONG)

p = mb.Parameters(weight=6000.0, stone=90.0, sling=7.0, hook=30.0)  # the hook's angle in degrees
ground = mb.Ground()
beam = mb.Body("beam", BEAM, INERTIA, com=(CENTRE, 0))
weight, stone = mb.Body("weight", p.weight, pose=mb.Particle()), mb.Body("stone", p.stone, pose=mb.Particle())
tip = beam.point(LONG, 0)
sling = mb.Distance("sling", tip, stone.point(0, 0), p.sling, unilateral=True)
trough = mb.PointOnLine("trough", ground.point(0, 0), stone.point(0, 0), axis=(1, 0, 0))
along = (stone.x - tip.x) * ca.cos(beam.theta) + (stone.y - tip.y) * ca.sin(beam.theta)  # sling along the beam
system = mb.System(
    beam,
    weight,
    stone,
    mb.Revolute("pivot", ground.point(0, PIVOT), beam.point(0, 0)),
    mb.Distance("hanger", beam.point(-SHORT, 0), weight.point(0, 0), HANGER),
    sling,
    trough,
    mb.Release(trough, lambda force: force.fy < 0),
    mb.Release(sling, along > p.sling * ca.cos(np.pi / 180 * p.hook)),
    mb.Gravity(0, -G),
    parameters=p,
)
scene = mb.Scene(
    system,
    start={"beam.theta": BEGIN, "weight.x": -SHORT * np.cos(BEGIN)},
    guess={"weight.y": 4.6, "stone.x": 0.3},
    times=np.linspace(0.0, 12.0, 601),
    outputs={"range": mb.value_at(stone.x, stone.y <= FIELD), "pull": mb.maximum(system.lam("sling")[0])},
    box=mb.Box(weight=(5900.0, 6100.0), stone=(86.0, 94.0), sling=(6.9, 7.1), hook=(27.0, 33.0)),
    name="trebuchet",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def thrown(weight: float, stone: float, sling: float, hook: float) -> float:
    """The range [m] by equations in q, the angles of beam, hanger and sling."""
    lengths = np.array([[-SHORT, HANGER, 0], [LONG, 0, sling]])  # from the pivot to weight and stone

    def solved(q: np.ndarray, v: np.ndarray, held: bool) -> np.ndarray:
        along, across = np.array([np.cos(q), np.sin(q)]), np.array([-np.sin(q), np.cos(q)])
        matrix, right = np.zeros((4, 4)), np.zeros(4)
        matrix[0, 0], right[0] = INERTIA + BEAM * CENTRE**2, -BEAM * G * CENTRE * along[0, 0]
        for mass, arms in zip((weight, stone), lengths, strict=True):
            matrix[:3, :3] += mass * (arms * across).T @ (arms * across)
            right[:3] += mass * (arms * across).T @ (arms * along @ v**2 - [0, G])
        matrix[3, :3] = matrix[:3, 3] = held * lengths[1] * across[1]  # the constraint of the trough
        matrix[3, 3], right[3] = not held, held * (lengths[1] * along[1] @ v**2)
        return np.linalg.solve(matrix, right)

    def phase(begin: float, state: np.ndarray, held: bool, end: Callable) -> tuple[float, np.ndarray]:
        def rates(t: float, z: np.ndarray) -> list[float]:
            return [*z[3:], *solved(z[:3], z[3:], held)[:3]]

        end.terminal = True
        found = solve_ivp(rates, (begin, 3.0), state, "DOP853", events=end, rtol=1e-11, atol=1e-11)
        return found.t[-1], found.y[:, -1]

    begin = np.array([BEGIN, -np.pi / 2, -np.arcsin(0.5 / sling), 0, 0, 0])
    lifted = phase(0.0, begin, True, lambda t, z: solved(z[:3], z[3:], True)[3])
    _, z = phase(*lifted, False, lambda t, z: np.cos(z[0] - z[2]) - np.cos(np.radians(hook)))
    x, y = (lengths[1] * [np.cos(z[:3]), np.sin(z[:3])]).sum(axis=1)
    vx, vy = (lengths[1] * [-np.sin(z[:3]), np.cos(z[:3])]) @ z[3:]
    return x + vx * (vy + np.sqrt(vy**2 + 2 * G * (y + PIVOT - FIELD))) / G


assert [event.name for event in run.events] == ["trough", "sling"]
assert abs(run["range"] / thrown(6000.0, 90.0, 7.0, 30.0) - 1) < 1e-7
worst = (thrown(5900.0, 94.0, 7.1, 33.0), thrown(6100.0, 86.0, 6.9, 27.0))
assert np.allclose(bounds["range"], worst, rtol=1e-3)  # the width of the bounds is 17 % of the range
assert not bounds.warnings

if __name__ == "__main__":
    print(f"The range is {run['range']:.0f} m, the bounds are {bounds['range'][0]:.0f} and {bounds['range'][1]:.0f}.\n")
    print(bounds.contributions())
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        throw = mb.simulate(scene.with_outputs({"height": stone.y}).with_times(np.linspace(0.0, 1.6, 161)))
        mb.view(throw, folder / "trebuchet.html", point=stone.point(0, 0))
        mb.view(throw, folder / "trebuchet.png", time=0.9, point=stone.point(0, 0))
        bounds.contributions().plot(folder / "trebuchet_contributions.png")
