"""Real robots: accelerations of symmb against those of Pinocchio for URDF files, and of MuJoCo for MJCF files.

    pip install pin example-robot-data icub-models mujoco dm_control gymnasium gymnasium-robotics robosuite
    PYTHONPATH=.:tests python tests/benchmarks/real_robots.py [--seed 0] [--states 20] [FILE or FOLDER ...]

Without files it takes those of the packages that are installed. Each file is loaded by default, and assembled. Then its
accelerations at random states must agree to 1e-10 of the largest one with those of the other program, or to ten times
what changes in Pinocchio when numbers of the model are rounded otherwise: some hands have nearly no mass. They are
those of the tree, without forces in joints, armature, constraints and rows of <mimic>, which both programs leave out.
An inertia that symmb repairs is given to Pinocchio. Bodies that move freely are where the file draws them.
"""

import argparse
import importlib.util
import sys
import tempfile
import time
import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

import symmb as mb

PACKAGES = "dm_control", "gymnasium", "gymnasium_robotics", "robosuite"
ENTRIES = "xx", "xy", "xz", "yy", "yz", "zz"
LIMIT = 1e-10

LEAST = 1e-6
"""Least size of accelerations [1/s^2 or m/s^2] at rates of 1: a door on a vertical hinge has none but rounding."""


def found_files():
    """The files of the packages."""
    share = [Path(sys.prefix) / "share" / "iCub" / "robots"]
    share += [Path(p) / "cmeel.prefix/share/example-robot-data/robots" for p in sys.path]
    yield from (file for folder in share for file in sorted(folder.rglob("*.urdf")))
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        yield from sorted(Path(str(spec.origin)).parent.rglob("*.xml")) if spec and spec.origin else ()


def repaired_text(path, numbers):
    """A URDF file with the inertia of the robot, and without what symmb leaves out here."""
    tree = ElementTree.parse(path)
    for link in tree.iter("link"):
        for inertia in link.iter("inertia"):
            name = link.get("name").translate(str.maketrans(".[] ", "____"))
            for entry in ENTRIES:
                inertia.set(f"i{entry}", repr(numbers[f"{name}.inertia.{entry}"]))
    for joint in tree.iter("joint"):
        for child in [*joint.findall("mimic"), *joint.findall("dynamics")]:
            joint.remove(child)
    return ElementTree.tostring(tree.getroot(), encoding="unicode")


def own_accelerations(robot, gravity, values, rates):
    """Accelerations (m, n) of the joints by name at values and rates (m, n), without forces in joints."""
    joints = {j.name: j for j in robot.joints.values() if j.coordinate}
    bodies = [e for e in robot.elements if isinstance(e, mb.Body) and ":rotor" not in e.name]
    system = mb.System(*bodies, *robot.joints.values(), *gravity)
    start = {f"{name}.{j.coordinate}": 0.1 for name, j in joints.items()}
    scene = mb.Scene(system, robot.start | start, [0.0, 1e-3], coordinates="joint")
    start = mb.DAESimulator(scene, mb.DormandPrince()).formulation.start
    dae, nominal = start.dae, start.nominal()
    at = [dae.q_names.index(f"{name}.{j.coordinate}") for name, j in joints.items()]
    of_v = [dae.v_names.index(f"{name}.{j.coordinate}_rate") for name, j in joints.items()]
    found = []
    for q_of_joints, v_of_joints in zip(values, rates, strict=True):
        q, v = nominal["q"].copy(), np.zeros(dae.n_v)
        q[at], v[of_v] = q_of_joints, v_of_joints
        s = (np.zeros(dae.n_s),) if dae.n_s else ()
        found.append(np.asarray(dae.rhs(q, v, *s, dae.p_nominal, 0.0)[1]).ravel()[of_v])
    return np.array(found)


def rounded_otherwise(model):
    """A Pinocchio model with numbers that are one or two units in the last place larger or smaller."""
    import pinocchio as pin

    rng, other = np.random.default_rng(0), model.copy()

    def moved(numbers):
        return numbers * (1 + np.finfo(float).eps * rng.choice([-1, 1], np.shape(numbers)))

    for k in range(1, model.njoints):
        inertia, place = other.inertias[k], other.jointPlacements[k]
        other.inertias[k] = pin.Inertia(float(moved(inertia.mass)), moved(inertia.lever), inertia.inertia)
        other.jointPlacements[k] = pin.SE3(place.rotation, moved(place.translation))
    return other


def pinocchio_accelerations(path, robot, joints, values, rates):
    """Accelerations by the model, and by one that is rounded otherwise, (2, m, n)."""
    import pinocchio as pin

    with tempfile.NamedTemporaryFile("w", suffix=".urdf", delete=False) as file:
        file.write(repaired_text(path, robot.numbers))
    model = pin.buildModelFromUrdf(file.name)
    Path(file.name).unlink()
    models = [model, rounded_otherwise(model)]
    names = {name.translate(str.maketrans(".[] ", "____")): k for k, name in enumerate(model.names)}
    at = [model.joints[names[name]].idx_v for name in joints]
    found = []
    for q_of_joints, v_of_joints in zip(values, rates, strict=True):
        step, v = np.zeros(model.nv), np.zeros(model.nv)
        step[at], v[at] = q_of_joints, v_of_joints
        q = pin.integrate(model, pin.neutral(model), step)
        found.append([pin.aba(own, own.createData(), q, v, np.zeros(model.nv))[at] for own in models])
    return np.swapaxes(found, 0, 1)


def mujoco_accelerations(path, robot, joints, values, rates):
    import mujoco

    m = mujoco.MjSpec.from_file(str(path)).compile()
    for off in ("CONSTRAINT", "SPRING", "DAMPER", "ACTUATION"):
        m.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{off}"))
    m.opt.density = m.opt.viscosity = 0
    m.dof_armature[:], m.body_gravcomp[:], m.tendon_armature[:] = 0, 0, 0
    numbers = [k for k in range(m.njnt) if m.jnt_type[k] != mujoco.mjtJoint.mjJNT_FREE]
    known = dict(zip(robot.joints, numbers, strict=True))
    at = [known[name] for name in joints]
    data, found = mujoco.MjData(m), []
    for q, v in zip(values, rates, strict=True):
        data.qpos[:], data.qvel[:] = m.qpos0, 0
        data.qpos[m.jnt_qposadr[at]], data.qvel[m.jnt_dofadr[at]] = q, v
        mujoco.mj_forward(m, data)
        found.append(data.qacc[m.jnt_dofadr[at]].copy())
    return np.array(found)


def difference(path, states, rng):
    """Largest difference of the accelerations of a file over the largest one, what rounding makes, and the joints."""
    is_urdf = path.suffix == ".urdf"
    robot = mb.load_urdf(path) if is_urdf else mb.load_mjcf(path)
    joints = [j.name for j in robot.joints.values() if j.coordinate]
    if not joints:
        return 0.0, 0.0, 0
    values, rates = rng.uniform(-1, 1, (2, states, len(joints)))
    gravity = [mb.Gravity(0, 0, -9.81)] if is_urdf else [e for e in robot.elements if isinstance(e, mb.Gravity)]
    own = own_accelerations(robot, gravity, values, rates)
    if is_urdf:
        other, rounded = pinocchio_accelerations(path, robot, joints, values, rates)
    else:
        other = rounded = mujoco_accelerations(path, robot, joints, values, rates)
    size = max(np.abs(other).max(), LEAST)
    return float(np.abs(own - other).max() / size), float(np.abs(rounded - other).max() / size), len(joints)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--states", type=int, default=20)
    options = parser.parse_args()
    given = [file for path in options.files for file in (sorted(path.rglob("*.*")) if path.is_dir() else [path])]
    files = [file for file in given or found_files() if file.suffix in (".urdf", ".xml")]
    loaded = agree = 0
    for number, path in enumerate(files):
        begin, title = time.process_time(), "/".join(path.parts[-2:])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", mb.SymmbWarning)
                worst, floor, count = difference(path, options.states, np.random.default_rng([options.seed, number]))
        except mb.SymmbError as error:
            print(f"{title:50} {str(error)[:120]}", flush=True)
            continue
        loaded, agree = loaded + 1, agree + (worst < max(LIMIT, 10 * floor))
        print(
            f"{title:50} {count:3} joints {worst:.1e} (rounding {floor:.0e}) {time.process_time() - begin:.1f} s",
            flush=True,
        )
    print(f"{loaded} of {len(files)} load, {agree} agree to {LIMIT:g}, or to rounding", flush=True)


if __name__ == "__main__":
    main()
