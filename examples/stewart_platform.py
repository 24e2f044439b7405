"""Six legs carry a platform. How large is the position error of the platform if the lengths of the legs have errors?

The legs of a Stewart platform have the lengths that a required motion needs: one circle in 4 s. Each leg may be 0.1 mm
too long or too short. In the worst case, the errors of all legs add up. The inverse Jacobian of the legs gives the sum.
`python examples/stewart_platform.py FOLDER` draws the platform into FOLDER.

Source: Stewart (1965), A platform with six degrees of freedom; own values.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import symmb as mb

BASE, TOP, HEIGHT, OFF = 1.0, 0.6, 1.2, 1e-4  # [m]
TURN = np.pi / 2  # angular velocity on the required circle [rad/s]


def ring(radius: float, spread: float) -> np.ndarray:
    """Three pairs of points on a circle, (6, 3)."""
    angles = np.radians([120 * (i // 2) + (spread if i % 2 else -spread) for i in range(6)])
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])


FEET, HEADS = ring(BASE, 50.0), ring(TOP, 20.0)


def wanted(t, sin=np.sin, cos=np.cos):
    """Required position of the platform's middle (3,) [m]."""
    return 0.2 * sin(TURN * t), 0.2 * (1 - cos(TURN * t)), HEIGHT


p = mb.Parameters(**{f"leg{i}": 0.0 for i in range(6)})
ground = mb.Ground()
platform = mb.Body("platform", mass=50.0, inertia=(5.0, 5.0, 9.0), pose=mb.Spatial())
middle = ca.vertcat(*wanted(mb.t, ca.sin, ca.cos))
legs = [
    mb.Distance(
        f"leg{i}", ground.point(*foot), platform.point(*head), ca.norm_2(middle + head - foot) + getattr(p, f"leg{i}")
    )
    for i, (foot, head) in enumerate(zip(FEET, HEADS, strict=True))
]
scene = mb.Scene(
    mb.System(platform, *legs, mb.Gravity(0, 0, -9.81), parameters=p),
    guess={"platform.z": HEIGHT},
    times=np.linspace(0.0, 4.0, 41),
    outputs={"x": platform.x, "y": platform.y, "z": platform.z},
    box=mb.Box(**{f"leg{i}": (-OFF, OFF) for i in range(6)}),
    name="Stewart platform",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())

# To first order, the change of a leg's length is its direction times the displacement of its upper end.
places = np.column_stack(np.broadcast_arrays(*wanted(scene.times)))
assert np.abs(run.values - places).max() < 1e-7
for place, low, high in zip(places, bounds.lower, bounds.upper, strict=True):
    arms = place + HEADS - FEET
    directions = arms / np.linalg.norm(arms, axis=1)[:, None]
    jacobian = np.hstack([directions, np.cross(HEADS, directions)])
    worst = OFF * np.abs(np.linalg.inv(jacobian)[:3]).sum(axis=1)
    assert np.allclose(high - place, worst, rtol=2e-2) and np.allclose(place - low, worst, rtol=2e-2)
assert not bounds.warnings

if __name__ == "__main__":
    off = np.maximum(bounds.upper - places, places - bounds.lower).max(axis=0)
    print(
        "The largest errors of the platform are {:.2f} mm along x, {:.2f} mm along y and {:.2f} mm along z,".format(
            *1e3 * off
        )
    )
    print(f"if each leg has an error of {1e3 * OFF:.1f} mm. The study made {bounds.evaluations} runs.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "stewart_platform.html")
        mb.view(run, Path(sys.argv[1]) / "stewart_platform.png", time=1.0)
