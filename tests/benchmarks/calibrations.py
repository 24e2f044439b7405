"""How often 95 % regions of calibrations hold the truth, from data with 1 % noise.

    PYTHONPATH=. python tests/benchmarks/calibrations.py [FIRST_SEED] [NUMBER]

The double pendulum's two lengths, and four numbers of a quarter car on a step of the road.
"""

import sys

import casadi as ca
import numpy as np
import scipy.stats as st

import symmb as mb
from models import double_pendulum


def pendulum() -> tuple[mb.Scene, list[str], dict[str, float]]:
    return double_pendulum.scene(), ["x2", "theta1"], {"l1": 1.03, "l2": 0.96}


def quarter_car() -> tuple[mb.Scene, list[str], dict[str, float]]:
    """Wheel and body over a step of 50 mm at 0.2 s."""
    p = mb.Parameters(body=300.0, spring=15000.0, damper=1200.0, tyre=180_000.0)
    axis = {"pose": mb.Particle()}
    body, wheel = mb.Body("body", p.body, **axis), mb.Body("wheel", 40.0, **axis)
    road = 0.025 * (1 + ca.tanh((mb.t - 0.2) / 0.02))
    lift = p.spring * (wheel.y - body.y) + p.damper * (wheel.vy - body.vy)
    tyre = p.tyre * (road - wheel.y)
    system = mb.System(
        body,
        wheel,
        mb.Force("suspension", body.point(0, 0), (0, lift)),
        mb.Force("reaction", wheel.point(0, 0), (0, tyre - lift)),
        parameters=p,
    )
    start = {"body.y": 0.0, "wheel.y": 0.0}
    scene = mb.Scene(system, start, np.linspace(0, 3, 151), {"body_y": body.y, "wheel_y": wheel.y}, name="quarter car")
    return scene, ["body_y", "wheel_y"], {"body": 320.0, "spring": 14000.0, "damper": 1300.0, "tyre": 200_000.0}


def held(scene, outputs, truth, seed) -> tuple[bool, bool]:
    """Whether the box and the ellipsoid of 95 % hold the truth."""
    rng = np.random.default_rng(seed)
    run = mb.simulate(scene, parameters=truth)
    data = {}
    for name in outputs:
        y = run[name]
        data[name] = y + 0.01 * np.abs(y).max() * rng.standard_normal(len(y))
    fit = mb.calibrate(scene, data, [*truth])
    box = fit.box(0.95)
    in_box = all(low <= truth[name] <= high for name, (low, high) in zip(box.names, box.bounds, strict=True))
    error = np.array([fit.parameters[name] - value for name, value in truth.items()])
    d = len(error)
    distance = error @ np.linalg.solve(fit.covariance, error) / d
    return in_box, bool(distance <= st.f(d, fit.degrees).ppf(0.95))


if __name__ == "__main__":
    first, number = (int(x) for x in [*sys.argv[1:], 1, 100][:2])
    for name, (scene, outputs, truth) in {"double pendulum": pendulum(), "quarter car": quarter_car()}.items():
        results = np.array([held(scene, outputs, truth, seed) for seed in range(first, first + number)])
        box, ellipsoid = results.sum(axis=0)
        print(f"{name}: the box holds the truth in {box} of {number}, the ellipsoid in {ellipsoid}", flush=True)
