"""A spring holds a roller on a cam. At which speed does the roller lift off? How high does it jump above this speed?

At the top of the cam, the spring must accelerate the follower downwards. The joint `CamFollower` always keeps the
follower on the cam. Its multiplier is the contact force. If the lift is harmonic, a formula also gives this force.
`CurveContact` lets the roller lift off. An equation of motion in one coordinate, solved by SciPy, gives the same jump.
`python examples/cam_liftoff.py FOLDER` draws cam and follower into FOLDER.

Source: textbook, e.g. Norton, Design of Machinery, dynamics of cams; own values.
"""

import sys
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

G, BASE, LIFT, ROLLER = 9.81, 0.04, 0.02, 0.012  # BASE: smallest distance of the roller's centre from the shaft [m]
RATED, FAST, TURN = 1300.0, 1550.0, 2 * np.pi / 60  # speeds [1/min]; TURN converts them to rad/s
STIFFNESS, DAMPING = 2e7, 1e3  # of the surfaces [N/m, N s/m]


def radius(angle: Any) -> Any:
    """Distance from the shaft to the roller's centre [m]: the radius of the base circle plus the lift."""
    return BASE + LIFT / 2 * (1 - np.cos(angle))


def profile(s: ca.SX) -> list[ca.SX]:
    """Points of the cam's profile, where the roller touches the cam."""
    centre = radius(s - np.pi / 2) * ca.vertcat(ca.cos(s), ca.sin(s))
    along = ca.jacobian(centre, s)
    return ca.vertsplit(centre - ROLLER * ca.vertcat(along[1], -along[0]) / ca.norm_2(along))


p = mb.Parameters(mass=1.2, spring=5000.0, preload=150.0, rpm=FAST)
ground = mb.Ground()
cam, rod = mb.Body("cam", 2.5, 1e-3), mb.Body("rod", p.mass, 1e-4)
shaft = mb.Revolute("shaft", ground.point(0, 0), cam.point(0, 0))
guide = mb.Prismatic("guide", ground.point(0, 0), rod.point(0, 0), axis=(0, 1, 0))
parts = (
    cam,
    rod,
    shaft,
    guide,
    mb.Motion("motor", shaft.angle, p.rpm * TURN * mb.t),
    mb.Force("spring", rod.point(0, 0), (0, -p.preload - p.spring * (rod.y - BASE))),
    mb.Gravity(0, -G),
)
tolerances = {"mass": (1.16, 1.24), "spring": (4750.0, 5250.0), "preload": (140.0, 160.0)}

held = mb.System(*parts, mb.CamFollower("roller", shaft, guide, radius), parameters=p)
riding = mb.Scene(
    held,
    times=np.linspace(0.0, 60 / RATED, 61),
    outputs={"lowest force": mb.minimum(-held.lam("roller")[0])},
    box=mb.Box(**tolerances, rpm=(RATED - 20, RATED + 20)),
    name="cam that holds its roller",
)
curve = mb.Curve(profile, 0, 2 * np.pi, closed=True)
law = mb.KelvinVoigt(STIFFNESS, DAMPING)
loose = mb.System(*parts, mb.CurveContact("roller", cam.point(0, 0), curve, rod.point(0, 0), ROLLER, law), parameters=p)
force, height = loose.force("roller"), rod.y - radius(shaft.angle)
jumping = mb.Scene(
    loose,
    start={"rod.y": BASE - (p.preload + p.mass * (G + LIFT / 2 * (p.rpm * TURN) ** 2)) / STIFFNESS},
    times=np.linspace(0.0, 60 / FAST, 401),
    outputs={
        "jump": mb.maximum(1e3 * height),
        "blow": mb.maximum(force),
        "angle": mb.value_at(shaft.angle, force <= 0),
    },
    box=mb.Box(**tolerances, rpm=(FAST - 20, FAST + 20)),
    name="cam and roller",
)
run, ride_bounds, bounds = mb.simulate(jumping), *(mb.propagate(s, mb.PolynomialChaos()) for s in (riding, jumping))


def least_force(mass: float, spring: float, preload: float, rpm: float) -> float:
    """Contact force [N] at the top of the cam, for a roller that stays on the cam."""
    return preload + spring * LIFT + mass * (G - LIFT / 2 * (rpm * TURN) ** 2)


def jump(mass: float, spring: float, preload: float, rpm: float) -> float:
    """Jump of the roller [mm], by complex numbers. Contact: the roller's centre is inside of the lift curve."""
    omega = rpm * TURN

    def push(t: float, y: float, v: float) -> float:
        turned = np.exp(-1j * omega * t)
        centre, rate, s = 1j * y * turned, (1j * v + omega * y) * turned, np.pi / 2 - omega * t

        def at(s: float) -> tuple[complex, complex]:
            """Vector from the curve to the roller's centre, and tangent of the curve."""
            r = radius(s - np.pi / 2)
            return centre - r * np.exp(1j * s), (1j * r - LIFT / 2 * np.cos(s)) * np.exp(1j * s)

        for _ in range(8):
            offset, along = at(s)
            s += (offset * along.conjugate()).real / abs(along) ** 2
        offset, along = at(s)
        normal = -1j * along / abs(along)
        depth, sinks = (-(z * normal.conjugate()).real for z in (offset, rate))
        return max(STIFFNESS * depth + DAMPING * sinks, 0.0) * (normal / turned).imag if depth > 0 else 0.0

    def rates(t: float, z: np.ndarray) -> list[float]:
        return [z[1], (push(t, *z) - preload - spring * (z[0] - BASE)) / mass - G]

    begin = BASE - (preload + mass * (G + LIFT / 2 * omega**2)) / STIFFNESS
    found = solve_ivp(rates, (0, 60 / FAST), [begin, 0], rtol=1e-8, atol=1e-11, max_step=1e-4, dense_output=True)
    times = np.linspace(0, 60 / FAST, 4000)
    return 1e3 * (found.sol(times)[0] - radius(omega * times)).max()


assert abs(ride_bounds["lowest force"][0] / least_force(1.24, 4750.0, 140.0, RATED + 20) - 1) < 1e-4
assert abs(ride_bounds["lowest force"][1] / least_force(1.16, 5250.0, 160.0, RATED - 20) - 1) < 1e-4
assert abs(run["jump"] / jump(1.2, 5000.0, 150.0, FAST) - 1) < 1e-5
worst = [jump(1.16, 5250.0, 160.0, FAST - 20), jump(1.24, 4750.0, 140.0, FAST + 20)]
assert np.allclose(bounds["jump"], worst, rtol=1e-3)
assert not ride_bounds.warnings and not bounds.warnings

if __name__ == "__main__":
    limit = np.sqrt((least_force(1.2, 5000.0, 150.0, 0.0)) / (1.2 * LIFT / 2)) / TURN
    print(f"The roller lifts off at speeds above {limit:.0f} 1/min.")
    print("At {:.0f} 1/min the lowest contact force is {:.0f} to {:.0f} N.".format(RATED, *ride_bounds["lowest force"]))
    print(f"At {FAST:.0f} 1/min the roller lifts off {np.degrees(np.pi - run['angle']):.0f} degrees before the top,")
    print("and jumps by {:.2f} to {:.2f} mm.\n".format(*bounds["jump"]))
    print(bounds.contributions())
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        flight = mb.simulate(jumping.with_outputs({"height above the cam": height, "force": force}))
        mb.view(flight, folder / "cam_liftoff.html")
        mb.view(flight, folder / "cam_liftoff.png", time=0.027)
        flight.plot(folder / "cam_liftoff_jump.png")
