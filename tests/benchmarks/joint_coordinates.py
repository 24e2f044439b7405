"""Ensembles in coordinates of joints beside those of bodies, and beside MuJoCo's RK4, on one core.

Arms of 6 and 20 links in space swing for 1 s from a bent position. MuJoCo takes the largest step at which its error of
the joints' angles, against symmb at a tolerance of 1e-13, is below 1e-5; symmb takes the loosest tolerance that does.
Seconds are those of a run in an ensemble of 256, medians of five. MuJoCo is an optional package.

    PYTHONPATH=. python tests/benchmarks/joint_coordinates.py
"""

from dataclasses import replace

import numpy as np
from _timing import median, pin

import symmb as mb
from models import andrews, chain, double_pendulum, four_bar, heavy_top, n_four_bar, slider_crank

try:
    import mujoco
except ImportError:
    mujoco = None

SAMPLES, ERROR, END = 256, 1e-5, 1.0
AXES = ((0, 0, 1), (1, 0, 0), (0, 1, 0))
LENGTH, MASS, INERTIA = 0.4, 1.0, (0.02, 0.004, 0.02)
ANGLE = 0.3
"""Of each joint at the start [rad]."""


def arm(n: int, coordinates: str) -> mb.Scene:
    """An arm of n links along y on hinges about z, x and y in turn, whose masses may vary."""
    p = mb.Parameters(m=MASS)
    elements: list = [mb.Gravity(0, 0, -9.81)]
    at, joints = mb.Ground().point(0, 0, 0), []
    for k in range(n):
        link = mb.Body(f"link{k}", p.m, INERTIA, mb.Spatial(), com=(0, LENGTH / 2, 0))
        joints.append(mb.Revolute(f"joint{k}", at, link.point(0, 0, 0), axis=AXES[k % 3]))
        elements += [link, joints[-1]]
        at = link.point(0, LENGTH, 0)
    start = {f"joint{k}.angle": ANGLE for k in range(n)}
    outputs = {f"angle{k}": joint.angle for k, joint in enumerate(joints)}
    return mb.Scene(mb.System(*elements, parameters=p), start, [0.0, END], outputs, coordinates=coordinates)


def run_seconds(simulator: mb.DAESimulator, spread: float) -> float:
    """Seconds of a run in an ensemble of samples close to the nominal one."""
    simulator.threads = 1
    P = simulator.dae.p_nominal * (1 + spread * np.random.default_rng(0).uniform(-1, 1, (SAMPLES, 1)))
    return median(lambda: simulator.run(P).extremes()) / SAMPLES


def by_mujoco(n: int, step: float) -> tuple[np.ndarray, float]:
    """Angles at the end, and seconds of a run."""
    spec = mujoco.MjSpec()
    spec.option.integrator, spec.option.timestep = mujoco.mjtIntegrator.mjINT_RK4, step
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    on, place = spec.worldbody, (0, 0, 0)
    for k in range(n):
        more = {"mass": MASS, "ipos": (0, LENGTH / 2, 0), "inertia": INERTIA, "explicitinertial": True}
        on = on.add_body(name=f"link{k}", pos=place, **more)
        on.add_joint(name=f"joint{k}", axis=AXES[k % 3])
        place = (0, LENGTH, 0)
    model = spec.compile()
    data = mujoco.MjData(model)

    def run() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = ANGLE
        mujoco.mj_step(model, data, nstep=round(END / step))

    seconds = median(run)
    return data.qpos.copy(), seconds


def beside_mujoco(n: int) -> None:
    exact = mb.DAESimulator(arm(n, "joint"), mb.DormandPrince(rtol=1e-13)).run(np.array([[MASS]])).Y[0, -1]
    simulators = {}
    for coordinates in ("joint", "body"):
        for rtol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
            simulator = mb.DAESimulator(arm(n, coordinates), mb.DormandPrince(rtol=rtol))
            error = np.abs(simulator.run(np.array([[MASS]])).Y[0, -1] - exact).max()
            if error <= ERROR:
                break
        simulators[coordinates] = simulator
        seconds = run_seconds(simulator, 1e-3)
        print(f"arm of {n}: {coordinates:6} rtol {rtol:g}, error {error:.1e}, {1e6 * seconds:9.1f} us a run")
        if coordinates == "joint":
            best = seconds
    for steps in (50, 100, 200, 300, 400, 600, 800, 1200, 1600, 3200) if mujoco else ():
        angles, seconds = by_mujoco(n, END / steps)
        error = np.abs(angles - exact).max()
        if error <= ERROR:
            text = f"{steps} steps, error {error:.1e}, {1e6 * seconds:9.1f} us a run: {seconds / best:.1f} times"
            print(f"arm of {n}: MuJoCo {text}")
            break


def main() -> None:
    pin()
    for n in (6, 20):
        beside_mujoco(n)
    scenes = [double_pendulum.scene(), chain.scene(40), heavy_top.scene(), four_bar.scene(), slider_crank.scene()]
    for scene in [*scenes, andrews.scene(), n_four_bar.scene()]:
        found = {}
        for coordinates in ("joint", "body"):
            simulator = mb.DAESimulator(replace(scene, coordinates=coordinates), mb.DormandPrince())
            found[coordinates] = run_seconds(simulator, 1e-3)
        chosen = mb.DAESimulator(scene, mb.DormandPrince()).coordinates
        ratio = found["body"] / found["joint"]
        print(
            f"{scene.name:16} joint {1e6 * found['joint']:9.1f} us, body {ratio:5.2f} times as much, chosen: {chosen}"
        )


if __name__ == "__main__":
    main()
