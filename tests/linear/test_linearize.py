"""Linearisations against closed forms, SciPy and runs."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from faults import refused, warned
from scipy.linalg import eigh, expm

import symmb as mb
from models import bicycle, double_pendulum, four_bar, laval_rotor


def hanging_chain(n: int) -> np.ndarray:
    """Angular frequencies [rad/s] of n homogeneous rods of 1/n m and 1/n kg that hang, from M and K of their angles."""
    L = m = 1 / n
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            M[i, j] = m * L**2 * ((n - 1 - max(i, j)) + (0.5 if i != j else 1 / 3))
        K[i, i] = m * 9.81 * L * (n - 1 - i + 0.5)
    return np.sqrt(eigh(K, M, eigvals_only=True))


def rods(n: int) -> mb.Scene:
    """The same rods, hanging."""
    L = m = 1 / n
    elements, at = [mb.Gravity(0, -9.81)], mb.Ground().point(0, 0)
    for k in range(n):
        rod = mb.Body(f"rod{k}", m, m * L**2 / 12)
        elements += [rod, mb.Revolute(f"joint{k}", at, rod.point(0, L / 2))]
        at = rod.point(0, -L / 2)
    return mb.Scene(mb.System(*elements), {f"rod{k}.theta": 0.0 for k in range(n)})


def test_chain_of_masses():
    """Five masses between six springs: omega_j = 2 sqrt(k/m) sin(j pi / 12)."""
    n, k, m = 5, 40.0, 2.0
    ground = mb.Ground()
    masses = [mb.Body(f"mass{i}", m, 0.1) for i in range(n)]
    slides = [mb.Prismatic(f"slide{i}", ground.point(i + 1, 0), masses[i].point(0, 0), axis=(1, 0)) for i in range(n)]
    points = [ground.point(0, 0), *(body.point(0, 0) for body in masses), ground.point(n + 1, 0)]
    springs = [mb.Spring(f"spring{i}", points[i], points[i + 1], k, 1.0) for i in range(n + 1)]
    lin = mb.linearize(mb.Scene(mb.System(*masses, *slides, *springs), {f"{s.name}.displacement": 0.0 for s in slides}))
    expected = 2 * np.sqrt(k / m) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies, expected, rtol=1e-12)
    assert abs(lin.damping).max() < 1e-12


def test_pendulum_with_a_spring():
    """A hanging rod, a horizontal spring at a height a below the hinge: omega^2 = (m g l/2 + k a^2) / (m l^2/3)."""
    mass, length, k, a = 1.5, 0.8, 30.0, 0.5
    ground, rod = mb.Ground(), mb.Body("rod", mass, mass * length**2 / 12)
    hinge = mb.Revolute("hinge", ground.point(0, 0), rod.point(0, length / 2))
    spring = mb.Spring("spring", ground.point(1.0, -a), rod.point(0, length / 2 - a), k, 1.0)
    lin = mb.linearize(mb.Scene(mb.System(rod, hinge, spring, mb.Gravity(0, -9.81)), {"hinge.angle": 0.0}))
    expected = np.sqrt((mass * 9.81 * length / 2 + k * a**2) / (mass * length**2 / 3))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies, [expected], rtol=1e-12)


@pytest.mark.parametrize("coordinates", ["joint", "body"])
def test_hanging_chain(coordinates):
    scene = rods(5)
    lin = mb.linearize(mb.Scene(scene.system, scene.start, coordinates=coordinates))
    assert lin.A.shape == (10, 10)
    assert np.allclose(2 * np.pi * lin.frequencies, hanging_chain(5), rtol=1e-11, atol=0)
    assert not lin.damping.any()
    assert lin.stability == "not asymptotically stable: 5 undamped oscillations"


def test_inputs_outputs_and_states_of_a_damped_motor():
    p = mb.Parameters(c=0.4, k=3.0)
    rotor = mb.Body("rotor", mass=1.0, inertia=2.0)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rotor.point(0, 0))
    lag = mb.State("lag", rate=lambda z: (hinge.angle - z) / 0.1)
    motor = mb.Actuator("motor", hinge, -p.k * hinge.angle - p.c * hinge.angle_rate - 5 * lag.value)
    outputs = {"torque": -p.k * hinge.angle, "rate": hinge.angle_rate}
    scene = mb.Scene(mb.System(rotor, hinge, lag, motor, parameters=p), outputs=outputs)
    lin = mb.linearize(scene, inputs=["motor", "k"])
    assert lin.states == ("hinge.angle", "hinge.angle_rate", "lag")
    np.testing.assert_allclose(lin.A, [[0, 1, 0], [-1.5, -0.2, -2.5], [10, 0, -10]], atol=1e-15)
    np.testing.assert_allclose(lin.B, [[0, 0], [0.5, 0], [0, 0]], atol=1e-15)
    np.testing.assert_allclose(lin.C, [[-3, 0, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(lin.D, np.zeros((2, 2)), atol=1e-15)
    values = np.linalg.eigvals(np.array([[0, 1, 0], [-1.5, -0.2, -2.5], [10, 0, -10]]))
    np.testing.assert_allclose(np.sort_complex(lin.eigenvalues), np.sort_complex(values), rtol=1e-12)
    assert str(lin).splitlines()[2].split()[-1] == "rotor.theta"


def pushed(scene: mb.Scene, name: str, size: float) -> mb.Trajectory:
    """A run whose start has another value of a parameter, or of a rate."""
    solver = mb.CVODES(rtol=1e-12, atol=1e-15)
    if name in scene.system.parameters:
        return mb.simulate(scene, solver, {name: size})
    return mb.simulate(replace(scene, start={**scene.start, name: size}), solver)


def swinging() -> mb.Scene:
    p = mb.Parameters(push=0.0)
    scene = rods(3)
    system = mb.System(*scene.system.elements, parameters=p)
    bodies = system.bodies
    outputs = {f"angle{k}": rod.theta for k, rod in enumerate(bodies)} | {
        f"rate{k}": rod.omega for k, rod in enumerate(bodies)
    }
    return mb.Scene(system, {**scene.start, "rod1.omega": p.push}, outputs=outputs)


def controlled() -> mb.Scene:
    p = mb.Parameters(push=0.0)
    rotor = mb.Body("rotor", mass=1.0, inertia=2.0)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rotor.point(0, 0.3))
    lag = mb.State("lag", rate=lambda z: (ca.sin(hinge.angle) - z) / 0.1)
    motor = mb.Actuator("motor", hinge, -3 * ca.tanh(lag.value) - hinge.angle_rate)
    system = mb.System(rotor, hinge, lag, motor, mb.Gravity(0, -9.81), parameters=p)
    outputs = {"angle": hinge.angle, "rate": hinge.angle_rate, "lag": lag.value}
    return mb.Scene(system, {"hinge.angle": 0.0, "hinge.angle_rate": p.push}, outputs=outputs)


def ridden() -> mb.Scene:
    scene = bicycle.scene(speed=4.0)
    frame, steering = scene.system.bodies[0], scene.system.elements[4]
    lean = frame.rotation[2, 1]
    outputs = {"lean": lean, "steer": steering.angle, "lean_rate": mb.ddt(lean), "steer_rate": steering.angle_rate}
    return scene.with_outputs(outputs)


def hanging() -> mb.Scene:
    scene = double_pendulum.scene()
    rods = scene.system.bodies
    outputs = {f"angle{k}": rod.theta for k, rod in enumerate(rods)}
    outputs |= {f"rate{k}": rod.omega for k, rod in enumerate(rods)}
    return replace(scene, start={"rod1.theta": 0.0, "rod2.theta": 0.0}).with_outputs(outputs)


def whirling() -> mb.Scene:
    scene = laval_rotor.scene()
    shaft = (e for e in scene.system.elements if isinstance(e, mb.Prismatic | mb.Revolute) and e.name != "spin")
    joints = {joint.name: joint for joint in shaft}
    outputs = {name: getattr(joint, joint.coordinate) for name, joint in joints.items()}
    outputs |= {f"{name}_rate": getattr(joint, f"{joint.coordinate}_rate") for name, joint in joints.items()}
    return scene.with_outputs(outputs)


@pytest.mark.parametrize(
    ("make", "name"),
    [(swinging, "push"), (controlled, "push"), (ridden, "lean_rate"), (hanging, "rod1.omega"), (whirling, "push")],
    ids=["rods", "motor", "bicycle", "double pendulum", "rotor"],
)
def test_finite_differences_of_runs(make, name):
    """exp(A t) takes a small deviation along the differences of runs."""
    scene = make().with_times(np.linspace(0.0, 0.5, 6))
    lin = mb.linearize(scene)
    assert not lin.doubts
    size = 1e-4
    there, back = (pushed(scene, name, sign * size) for sign in (1, -1))
    differences = (there.values - back.values) / (2 * size)
    begin = np.linalg.lstsq(lin.C, differences[0], rcond=None)[0]
    linear = [lin.C @ expm(lin.A * t) @ begin for t in there.t]
    np.testing.assert_allclose(differences, linear, atol=1e-7 * np.abs(linear).max())


def test_a_run_at_a_time_is_its_state():
    """A pendulum at its lowest point, swinging: frozen equations, and a doubt."""
    rod = mb.Body("rod", mass=3.0, inertia=1.0)
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, 1))
    run = mb.simulate(mb.Scene(mb.System(rod, pin, mb.Gravity(0, -9.81)), {"rod.theta": 0.7}, [0.0, 0.5, 1.0]))
    lin = warned("A changes along the motion", mb.linearize, run, 0.5)
    angle = run["rod.theta"][1]
    np.testing.assert_allclose(lin.A, [[0, 1], [-3 * 9.81 * np.cos(angle) / 4, 0]], atol=1e-12)
    refused("one of the run's 3 output times", mb.linearize, run, 0.3)


def test_closed_loop_hangs_in_equilibrium():
    """A hanging parallelogram swings as a simple pendulum: coupler and cranks without turning of the coupler."""
    ground = mb.Ground()
    left, right = (mb.Body(name, mass=1.0, inertia=1 / 12) for name in ("left", "right"))
    bar = mb.Body("bar", mass=2.0, inertia=5.0)
    hinges = [
        mb.Revolute("a", ground.point(0, 0), left.point(0, 0.5)),
        mb.Revolute("b", left.point(0, -0.5), bar.point(-1, 0)),
        mb.Revolute("c", bar.point(1, 0), right.point(0, -0.5)),
        mb.Revolute("d", right.point(0, 0.5), ground.point(2, 0)),
    ]
    system = mb.System(left, right, bar, *hinges, mb.Gravity(0, -9.81))
    guess = {"left.y": -0.5, "right.x": 2.0, "right.y": -0.5, "bar.x": 1.0, "bar.y": -1.0}
    for coordinates in ("joint", "body"):
        lin = mb.linearize(mb.Scene(system, {"left.theta": 0.0}, guess=guess, coordinates=coordinates))
        stiffness, inertia = 9.81 * (2 * 0.5 + 2 * 1.0), 2 / 3 + 2.0
        assert lin.frequencies.shape == (1,)
        assert 2 * np.pi * lin.frequencies[0] == pytest.approx(np.sqrt(stiffness / inertia), rel=1e-12)
        shape = lin.modes[0].shape
        assert abs(shape["bar.theta"]) < 1e-12 and abs(shape["bar.x"]) == pytest.approx(1.0)


def test_four_bar_in_motion_is_doubtful():
    with pytest.warns(mb.SymmbWarning, match="neither an equilibrium nor a steady motion"):
        assert mb.linearize(four_bar.scene()).doubts


def test_refusals():
    mass = mb.Body("mass", mass=1.0, pose=mb.Particle())
    at = mass.point(0, 0, 0)
    floor = mb.Impact("floor", gap=mass.z, restitution=0.5)
    with pytest.raises(mb.DeclarationError, match="Impact 'floor' is closed"):
        mb.linearize(mb.Scene(mb.System(mass, floor, mb.Gravity(0, 0, -9.81)), {"mass.z": 0.0}))
    kink = mb.Force("kink", at, (-ca.fabs(mass.x), 0, 0))
    refused(r"the state is on a switch of the equations \(fabs\)", mb.linearize, mb.Scene(mb.System(mass, kink)))
    assert mb.linearize(mb.Scene(mb.System(mass, kink), {"mass.x": 1.0})).frequencies.size == 1
    smooth = mb.Force("smooth", at, (-ca.fabs(mass.x) * mass.x, 0, 0))
    assert mb.linearize(mb.Scene(mb.System(mass, smooth))).frequencies.size == 0
    held = mb.Sampled("u", period=0.1, law=-mass.x)
    refused("Sampled values", mb.linearize, mb.Scene(mb.System(mass, held, mb.Force("f", at, (held.value, 0, 0)))))
    p = mb.Parameters(length=1.0)
    rod = mb.Body("rod", mass=1.0, inertia=1.0)
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, p.length))
    hanging = mb.Scene(mb.System(rod, pin, mb.Gravity(0, -9.81), parameters=p), coordinates="body")
    refused("'length' moves constraints", mb.linearize, hanging, inputs=["length"])
    with pytest.raises(mb.DeclarationError, match=r"no actuator, input or parameter 'lenght'\. Did you mean 'length'"):
        mb.linearize(hanging, inputs=["lenght"])
    refused("a scene is linearised at its start", mb.linearize, hanging, 0.0)
    with pytest.raises(mb.DeclarationError, match="the scene has no states"):
        mb.linearize(mb.Scene(mb.System(rod, mb.Weld("fixed", mb.Ground().point(0, 0), rod.point(0, 0)))))


def test_free_motions_have_exact_zeros():
    """A free body in space that nothing acts on, and a stiff oscillator beside it."""
    free = mb.Body("free", 1.0, (1.0, 2.0, 3.0), mb.Spatial())
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    spring = mb.Force("spring", mass.point(0, 0, 0), (-1e8 * mass.x, -mass.y, -1e-6 * mass.z))
    lin = mb.linearize(mb.Scene(mb.System(free, mass, spring)))
    assert np.count_nonzero(lin.eigenvalues == 0) == 12
    np.testing.assert_allclose(2 * np.pi * lin.frequencies, [1e-3, 1.0, 1e4], rtol=1e-9)
    assert lin.stability == "not asymptotically stable: 3 undamped oscillations and 12 zero eigenvalues"


@pytest.mark.parametrize("pose", [mb.Particle(), mb.Planar(), mb.Spatial()], ids=repr)
@pytest.mark.parametrize("speed", [0.0, 2.0])
def test_bodies_that_nothing_touches_move_uniformly(pose, speed):
    inertia = {} if isinstance(pose, mb.Particle) else {"inertia": 0.1 if isinstance(pose, mb.Planar) else (1, 2, 3)}
    body = mb.Body("body", 1.3, pose=pose, **inertia)
    scene = mb.Scene(mb.System(body), start={"body.vx": speed}, outputs={"x": body.x, "energy": 0.65 * body.vx**2})
    lin = mb.linearize(scene)
    x, vx = lin.states.index("body.x"), lin.states.index("body.vx")
    np.testing.assert_allclose(lin.A[x], np.eye(len(lin.A))[vx])
    np.testing.assert_allclose(lin.A[vx], 0)
    np.testing.assert_allclose(lin.C[:, [x, vx]], [[1, 0], [0, 1.3 * speed]])
    assert not lin.eigenvalues.any()
