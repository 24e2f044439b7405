"""The winch of a crane accelerates while its rope is slack. How large is the peak force when the load is lifted?

The rope goes from the winch over a pulley at the tip of the boom to the load. A second rope, the pendant, holds the
boom. With more slack, the winch is faster when the rope becomes taut. The peak of the pull, divided by the weight of
the load, is the hoisting factor. Cranes are designed with this factor. As a check, SciPy integrates equations of motion
in three coordinates.
`python examples/crane_slack_rope.py FOLDER` draws the crane into FOLDER.

Source: hoisting factor e.g. EN 13001-2; own values.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import symmb as mb

G, BOOM, MASS, ANGLE, RADIUS = 9.81, 12.0, 1500.0, np.radians(55.0), 0.25
FRAME, WINCH, X = np.array([-3.0, 6.0]), np.array([-2.0, 1.0]), BOOM * np.cos(ANGLE) + RADIUS
PENDANT, FLOOR = (1.2e7, 3e4), (5e7, 3e5)  # stiffness [N/m] and damping [N s/m]
ROPE, END = 4e3, 1.2  # damping [N s/m] of the rope, and last time of the run [s]


def ways(q: np.ndarray) -> np.ndarray:
    """Lengths of the pendant and the rope, and depth in the floor [m], for the boom's angle and the load's position."""
    tip = BOOM * np.array([np.cos(q[0]), np.sin(q[0])])
    (winch, a), (load, b) = ((np.hypot(*d), np.arctan2(d[1], d[0])) for d in (WINCH - tip, q[1:] - tip))
    arc = 2 * np.pi + a - b - np.arccos(RADIUS / winch) - np.arccos(RADIUS / load)
    rope = np.sqrt(winch**2 - RADIUS**2) + np.sqrt(load**2 - RADIUS**2) + RADIUS * arc
    return np.array([np.hypot(*(tip - FRAME)), rope, -q[2]])


TAUT = ways(np.array([ANGLE, X, 0.0]))
p = mb.Parameters(load=3000.0, slack=0.12, stiffness=6e5, gain=0.5)
ground = mb.Ground()
boom = mb.Body("boom", MASS, MASS * BOOM**2 / 12, com=(BOOM / 2, 0))
load = mb.Body("load", p.load, 500.0)
tip, hook = boom.point(BOOM, 0), load.point(0, 0)
wound = p.gain * mb.t**2 / 2
system = mb.System(
    boom,
    load,
    mb.Revolute("foot", ground.point(0, 0), boom.point(0, 0)),
    mb.Rope("pendant", [ground.point(*FRAME), tip], PENDANT[0], TAUT[0], PENDANT[1]),
    mb.Rope("rope", [ground.point(*WINCH), (tip, -RADIUS), hook], p.stiffness, TAUT[1] + p.slack - wound, ROPE),
    mb.Contact("floor", hook, ground.point(0, 0), (0, 1), mb.KelvinVoigt(*FLOOR)),
    mb.Gravity(0, -G),
    parameters=p,
)
pull = system.force("rope")
scene = mb.Scene(
    system,
    start={"load.x": X, "load.theta": 0.0},
    guess={"boom.theta": ANGLE, "load.y": -1e-3},
    times=np.linspace(0.0, END, 121),
    outputs={"factor": mb.maximum(pull / (p.load * G)), "speed": mb.value_at(p.gain * mb.t, pull > 0)},
    box=mb.Box(load=(2850.0, 3150.0), slack=(0.08, 0.16), stiffness=(5.4e5, 6.6e5), gain=(0.45, 0.55)),
    equilibrium=True,
    name="crane with slack rope",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def factor(load: float, slack: float, stiffness: float, gain: float) -> float:
    """The largest pull of the rope, divided by the weight of the load."""
    springs = np.array([PENDANT, (stiffness, ROPE), FLOOR])
    inertia = np.array([MASS * BOOM**2 / 3, load, load])

    def pulls(t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slopes = np.array([(ways(q + h) - ways(q - h)) / 2e-6 for h in 1e-6 * np.eye(3)]).T
        stretch, rates = ways(q) - TAUT - [0, slack - gain * t**2 / 2, 0], slopes @ v + [0, gain * t, 0]
        return (stretch > 0) * np.maximum(springs[:, 0] * stretch + springs[:, 1] * rates, 0), slopes

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        pull, slopes = pulls(t, z[:3], z[3:])
        weights = np.array([MASS * BOOM / 2 * np.cos(z[0]), 0, load])
        return np.r_[z[3:], (-pull @ slopes - G * weights) / inertia]

    at_rest = fsolve(lambda u: rates(0, np.array([u[0], X, u[1], 0, 0, 0]))[[3, 5]], [ANGLE, -1e-3], xtol=1e-12)
    start = [at_rest[0], X, at_rest[1], 0, 0, 0]
    found = solve_ivp(rates, (0, END), start, rtol=1e-7, atol=1e-10, max_step=0.02, dense_output=True)
    times = np.linspace(0, END, 1000)
    return max(pulls(t, z[:3], z[3:])[0][1] for t, z in zip(times, found.sol(times).T, strict=True)) / (load * G)


assert abs(run["factor"] / factor(3000.0, 0.12, 6e5, 0.5) - 1) < 1e-5
worst = factor(3150.0, 0.08, 5.4e5, 0.45), factor(2850.0, 0.16, 6.6e5, 0.55)
assert np.allclose(bounds["factor"], worst, rtol=2e-3)
assert not bounds.warnings

if __name__ == "__main__":
    print(f"The rope becomes taut at {run['speed']:.2f} m/s. Its pull is up to {run['factor']:.2f} times the weight,")
    print("and {:.2f} to {:.2f} times the weight within the tolerances.\n".format(*bounds["factor"]))
    print(bounds.contributions())
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        lift = mb.simulate(scene.with_outputs({"pull": pull, "pendant": system.force("pendant"), "height": load.y}))
        mb.view(lift, folder / "crane_slack_rope.html")
        mb.view(lift, folder / "crane_slack_rope.png", time=END)
        lift.plot(folder / "crane_slack_rope_pull.png")
