"""Linearisations against closed forms, SciPy and runs, what they print, and their files."""

import json
import warnings
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from faults import refused, warned
from machines import GROUND, ball, bouncing_ball, cart, free_body, linkage, pendulum, rods, wheel
from scipy.linalg import eigh, expm
from scipy.signal import lsim
from small_scenes import pushing_oscillator
from steady_scenes import SteadyMotion, random_motions

import symmb as mb
from models import bicycle, double_pendulum, laval_rotor


def hanging_chain(n: int) -> np.ndarray:
    """Angular frequencies [rad/s] of n homogeneous rods of 1/n m and 1/n kg that hang, from M and K of their angles."""
    L = m = 1 / n
    i, k = np.indices((n, n))
    M = m * L**2 * (n - 1 - np.maximum(i, k) + np.where(i == k, 1 / 3, 1 / 2))
    K = np.diag(m * 9.81 * L * (n - np.arange(n) - 0.5))
    return np.sqrt(eigh(K, M, eigvals_only=True))


def uniform(n: int):
    """The same rods, hanging."""
    return rods(n, length=1 / n, mass=1 / n)


def test_chain_of_masses():
    """Five masses between six springs: omega_j = 2 sqrt(k/m) sin(j pi / 12)."""
    n, k, m = 5, 40.0, 2.0
    masses = [mb.Body(f"mass{i}", m, 0.1) for i in range(n)]
    slides = [mb.Prismatic(f"slide{i}", GROUND.point(i + 1, 0), masses[i].point(0, 0), axis=(1, 0)) for i in range(n)]
    points = [GROUND.point(0, 0), *(body.point(0, 0) for body in masses), GROUND.point(n + 1, 0)]
    springs = [mb.Spring(f"spring{i}", points[i], points[i + 1], k, 1.0) for i in range(n + 1)]
    lin = mb.linearize(mb.Scene(mb.System(*masses, *slides, *springs), {f"{s.name}.displacement": 0.0 for s in slides}))
    expected = 2 * np.sqrt(k / m) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies, expected, rtol=1e-12)
    assert abs(lin.damping).max() < 1e-12


def test_pendulum_with_a_spring():
    """A hanging rod, a horizontal spring at a height a below the hinge: omega^2 = (m g l/2 + k a^2) / (m l^2/3)."""
    mass, length, k, a = 1.5, 0.8, 30.0, 0.5
    ends = lambda m: (GROUND.point(1.0, -a), m.rod0.point(0, length / 2 - a))  # noqa: E731
    hanging = rods(1, lambda m: mb.Spring("spring", *ends(m), k, 1.0), length=length, mass=mass)
    lin = mb.linearize(hanging.scene(start={"hinge0.angle": 0.0}))
    expected = np.sqrt((mass * 9.81 * length / 2 + k * a**2) / (mass * length**2 / 3))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies, [expected], rtol=1e-12)


@pytest.mark.parametrize("coordinates", ["joint", "body"])
def test_hanging_chain(coordinates):
    lin = mb.linearize(uniform(5).scene(coordinates=coordinates))
    assert lin.A.shape == (10, 10)
    assert np.allclose(2 * np.pi * lin.frequencies, hanging_chain(5), rtol=1e-11, atol=0)
    assert not lin.damping.any()
    assert lin.stability == "not asymptotically stable: 5 undamped oscillations"


def test_inputs_outputs_and_states_of_a_damped_motor():
    lag = lambda m: mb.State("lag", rate=lambda z: (m.shaft.angle - z) / 0.1)  # noqa: E731
    law = lambda m: -m.p.k * m.shaft.angle - m.p.c * m.shaft.angle_rate - 5 * m.lag.value  # noqa: E731
    rotor = wheel(lag, lambda m: mb.Actuator("motor", m.shaft, law(m)), inertia=2.0, c=0.4, k=3.0)
    scene = rotor.scene({"torque": -rotor.p.k * rotor.shaft.angle, "rate": rotor.shaft.angle_rate})
    lin = mb.linearize(scene, inputs=["motor", "k"])
    assert lin.states == ("shaft.angle", "shaft.angle_rate", "lag")
    np.testing.assert_allclose(lin.A, [[0, 1, 0], [-1.5, -0.2, -2.5], [10, 0, -10]], atol=1e-15)
    np.testing.assert_allclose(lin.B, [[0, 0], [0.5, 0], [0, 0]], atol=1e-15)
    np.testing.assert_allclose(lin.C, [[-3, 0, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(lin.D, np.zeros((2, 2)), atol=1e-15)
    values = np.linalg.eigvals(np.array([[0, 1, 0], [-1.5, -0.2, -2.5], [10, 0, -10]]))
    np.testing.assert_allclose(np.sort_complex(lin.eigenvalues), np.sort_complex(values), rtol=1e-12)
    assert str(lin).splitlines()[2].split()[-1] == "wheel.theta"


def pushed(scene: mb.Scene, name: str, size: float) -> mb.Trajectory:
    """A run whose start has another value of a parameter, or of a rate."""
    solver = mb.CVODES(rtol=1e-12, atol=1e-15)
    if name in scene.system.parameters:
        return mb.simulate(scene, solver, {name: size})
    return mb.simulate(replace(scene, start={**scene.start, name: size}), solver)


def angles_and_rates(bodies) -> dict:
    return {f"{body.name}_{name}": getattr(body, name) for name in ("theta", "omega") for body in bodies}


def swinging() -> mb.Scene:
    chain = rods(3, length=1 / 3, mass=1 / 3, push=0.0)
    start = {f"rod{k}.theta": 0.0 for k in range(3)} | {"rod1.omega": chain.p.push}
    return chain.scene(angles_and_rates(chain.bodies), start=start)


def controlled() -> mb.Scene:
    p = mb.Parameters(push=0.0)
    rotor = mb.Body("rotor", mass=1.0, inertia=2.0)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rotor.point(0, 0.3))
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
    outputs = angles_and_rates(scene.system.bodies)
    return replace(scene, start={"rod1.theta": 0.0, "rod2.theta": 0.0}).with_outputs(outputs)


def whirling() -> mb.Scene:
    scene = laval_rotor.scene()
    shaft = (e for e in scene.system.elements if isinstance(e, mb.Prismatic | mb.Revolute) and e.name != "spin")
    names = [(joint, joint.coordinate + rate) for joint in shaft for rate in ("", "_rate")]
    return scene.with_outputs({f"{joint.name}_{name}": getattr(joint, name) for joint, name in names})


@pytest.mark.parametrize(
    ("make", "name"),
    [(swinging, "push"), (controlled, "push"), (ridden, "lean_rate"), (hanging, "rod1.omega"), (whirling, "push")],
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
    run = rods(1, length=2.0, mass=3.0).run(None, [0.0, 0.5, 1.0], {"rod0.theta": 0.7})
    lin = warned("A changes along the motion", mb.linearize, run, 0.5)
    angle = run["rod0.theta"][1]
    np.testing.assert_allclose(lin.A, [[0, 1], [-3 * 9.81 * np.cos(angle) / 4, 0]], atol=1e-12)
    refused("one of the run's 3 output times", mb.linearize, run, 0.3)


def test_closed_loop_hangs_in_equilibrium():
    """A hanging parallelogram swings as a simple pendulum: coupler and cranks without turning of the coupler."""
    bars, down = linkage(lengths=(1.0, 2.0, 1.0, 2.0), g=9.81), -np.pi / 2
    guess = {"rocker.theta": down, "crank.y": -0.5, "rocker.x": 2.0, "rocker.y": -0.5, "coupler.x": 1.0}
    for coordinates in ("joint", "body"):
        scene = bars.scene(start={"crank.theta": down}, guess=guess | {"coupler.y": -1.0}, coordinates=coordinates)
        lin, (stiffness, inertia) = mb.linearize(scene), (9.81 * (2 * 0.5 + 1.0), 2 * (0.1 + 0.25) + 1.0)
        assert lin.frequencies.shape == (1,)
        assert 2 * np.pi * lin.frequencies[0] == pytest.approx(np.sqrt(stiffness / inertia), rel=1e-12)
        shape = lin.modes[0].shape
        assert abs(shape["coupler.theta"]) < 1e-12 and abs(shape["coupler.x"]) == pytest.approx(1.0)


def test_refusals():
    refused("Impact 'floor' is closed", mb.linearize, bouncing_ball().scene(start={"ball.y": 0.0}))
    kink = ball(lambda m: mb.Force("kink", m.at, (-ca.fabs(m.ball.x), 0, 0)), g=None)
    refused(r"the state is on a switch of the equations \(fabs\)", mb.linearize, kink.scene())
    assert mb.linearize(kink.scene(start={"ball.x": 1.0})).frequencies.size == 1
    smooth = ball(lambda m: mb.Force("smooth", m.at, (-ca.fabs(m.ball.x) * m.ball.x, 0, 0)), g=None)
    assert mb.linearize(smooth.scene()).frequencies.size == 0
    held = lambda m: mb.Sampled("u", period=0.1, law=-m.ball.x)  # noqa: E731
    sampled = ball(held, lambda m: mb.Force("f", m.at, (m.u.value, 0, 0)), g=None)
    refused("Sampled values", mb.linearize, sampled.scene())
    hanging = pendulum().scene(coordinates="body")
    refused("'length' moves constraints", mb.linearize, hanging, inputs=["length"])
    told = r"no actuator, input or parameter 'lenght'\. Did you mean 'length'"
    refused(told, mb.linearize, hanging, inputs=["lenght"])
    refused("a scene is linearised at its start", mb.linearize, hanging, 0.0)
    rod = mb.Body("rod", mass=1.0, inertia=1.0)
    fixed = mb.Scene(mb.System(rod, mb.Weld("fixed", GROUND.point(0, 0), rod.point(0, 0))))
    refused("the scene has no states", mb.linearize, fixed)


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


@pytest.mark.parametrize("coordinates", [None, "body"])
def test_a_redundant_loop(coordinates):
    """A bar that hangs on three parallel cranks, of which one is redundant, swings as a pendulum."""
    bar = mb.Body("bar", 2.0, 5.0)
    elements, guess = [bar, mb.Gravity(0, -9.81)], {"bar.y": -1.0}
    for k, x in enumerate((-1.0, 0.0, 1.0)):
        crank = mb.Body(f"crank{k}", 1.0, 1 / 12)
        top = mb.Revolute(f"top{k}", GROUND.point(x, 0), crank.point(0, 0.5))
        elements += [crank, top, mb.Revolute(f"foot{k}", crank.point(0, -0.5), bar.point(x, 0))]
        guess |= {f"crank{k}.x": x, f"crank{k}.y": -0.5}
    scene = mb.Scene(mb.System(*elements), {"crank0.theta": 0.0}, guess=guess, coordinates=coordinates)
    assert 2 * np.pi * mb.linearize(scene).frequencies == pytest.approx([np.sqrt(9.81 * 3.5 / 3)], rel=1e-9)


def test_a_body_that_spins_freely():
    """Euler's equations about principal axes with inertias 1, 2, 3: the middle one is unstable."""
    body = free_body(inertia=(1.0, 2.0, 3.0))
    axes = {(0.0, 2.0, 0.0): np.sqrt(1 / 3), (0.0, 0.0, 2.0): 1j * np.sqrt(1 / 1), (2.0, 0.0, 0.0): 1j * np.sqrt(1 / 3)}
    for omega, rate in axes.items():
        lin = mb.linearize(body.scene(start={"top.omega": omega}))
        assert np.abs(lin.eigenvalues - 2 * rate).min() < 1e-9
        assert (lin.stability == "unstable") == (omega[1] > 0)


def test_repeated_eigenvalues_keep_their_modes():
    law = lambda m: tuple(-m.p.k * getattr(m.ball, c) - 0.4 * getattr(m.ball, f"v{c}") for c in "xyz")  # noqa: E731
    scene = ball(lambda m: mb.Force("law", m.at, law(m)), g=None, k=9.0).scene(start={"ball.x": 0.5})
    lin = mb.linearize(scene, inputs=["k", "mass"])
    np.testing.assert_allclose(lin.B[lin.states.index("ball.vx")], [-0.5, 4.5])  # of -k x / mass
    assert 2 * np.pi * lin.frequencies == pytest.approx([3.0, 3.0, 3.0], rel=1e-9)
    shapes = np.array([[abs(amplitude) for amplitude in mode.shape.values()] for mode in lin.modes])
    assert np.linalg.matrix_rank(shapes) == 3


@pytest.mark.parametrize("values", [(1.0, 1.0, 1e160), (1e-98, 1e150, 1e170), (1.0, 1.0, 1.7e308)])
def test_strong_dampers_do_not_overflow(values):
    """The fast eigenvalue is -c/m. Squares of such numbers overflow."""
    m, k, c = values
    law = lambda m: mb.Force("law", m.at, (-m.p.k * m.cart.x - m.p.c * m.cart.vx, 0))  # noqa: E731
    found = mb.linearize(cart(law, mass=m, k=k, c=c).scene()).eigenvalues
    assert found[1] == pytest.approx(-c / m, rel=1e-9) and abs(found[0]) <= 1e-13 * c / m


def test_lines_tell_amplitudes_and_phases():
    lin = mb.linearize(pushing_oscillator())
    eigenvalue = -0.2 + 1j * np.sqrt(3.96)
    b = 2 * eigenvalue / (eigenvalue**2 + 9)  # of b over a, from b'' + 9 b = 2 a'
    assert lin.modes[0].text == f"a.x, b.y {abs(b):.2g} at {np.degrees(np.angle(b)):.0f} deg"
    assert lin.modes[1].text == "b.y"
    np.testing.assert_allclose(lin.damping, [0.1, 0.0], atol=1e-12)  # 0.2 over the modulus 2 of the eigenvalue
    assert "<td" in lin._repr_html_() and "b.y" in lin._repr_html_()


def test_state_spaces_of_scipy_and_of_control():
    lin = mb.linearize(pushing_oscillator(), inputs=["k"])
    t = np.linspace(0.0, 2.0, 11)
    start = np.zeros(len(lin.states))
    start[lin.states.index("b.y")] = 0.1
    np.testing.assert_allclose(lsim(lin.to_scipy(), 0 * t, t, start)[1][:, 1], 0.1 * np.cos(3 * t), atol=1e-10)
    pytest.importorskip("control")
    system = lin.to_control()
    assert system.output_labels == ["x", "y"] and system.input_labels == ["k"] and "a_vx" in system.state_labels
    np.testing.assert_array_equal(system.A, lin.A)
    for method in (mb.Linearization.to_scipy, mb.Linearization.to_control):
        refused(r"has no inputs. Pass inputs=\[...\] to linearize", method, mb.linearize(pushing_oscillator()))


def test_a_damaged_file(tmp_path):
    path = tmp_path / "lin.json"
    mb.linearize(pushing_oscillator()).save(path)
    entries = json.loads(path.read_text())
    path.write_text(json.dumps(entries | {"A": entries["A"][1:]}))
    refused(r"does not hold a result of Linearization.save: A must be an array", mb.Linearization.load, path)
    refused("json", mb.linearize(pushing_oscillator()).save, tmp_path / "lin.csv")


# States where the equations have no derivative are refused, and coefficients that change with time are doubted.

BODY = mb.Body("b", 1.0, pose=mb.Particle())


def forced(force, parameters=None, **options) -> mb.Scene:
    system = mb.System(BODY, mb.Force("f", BODY.point(0, 0, 0), (force, 0, 0)), parameters=parameters)
    return mb.Scene(system, times=np.linspace(0, 5, 11), outputs={"x": BODY.x}, **options)


X, V = BODY.x, BODY.vx
JUMPS = {
    "sign": -10 * X - 5 * ca.sign(V),
    "comparison": -3 * X - ca.if_else(V > 0, 0.2, -0.2),
    "relay": -ca.sign(X) - 0.1 * V,
    "a small jump": -400 * X - 1e-3 * ca.sign(V),
    "floor": -X - 0.5 * ca.floor(X + 1),
}


@pytest.mark.parametrize("law", JUMPS)
def test_forces_that_jump_at_the_state_are_refused(law):
    refused("forces jump there", mb.linearize, forced(JUMPS[law]))


INFINITE = {
    "root of a distance": -10 * X - 2 * ca.sqrt(ca.fabs(X)) * ca.sign(X),
    "valve": -4 * X - 2 * ca.sqrt(ca.fabs(V)) * ca.sign(V),
    "norm": -10 * X - 2 * V / ca.sqrt(V**2 + BODY.vy**2 + BODY.vz**2),
    "power": -X - 2 * V * (V**2) ** 0.25,
}


@pytest.mark.parametrize("law", INFINITE)
def test_infinite_slopes_are_refused(law):
    refused(r"infinite or undefined at this state|slopes on both sides|jump", mb.linearize, forced(INFINITE[law]))
    p = mb.Parameters(k=10.0)
    refused(None, mb.ModalSimulator, forced(INFINITE[law] - p.k * X, p, box=mb.Box(k=(9, 11))))


def test_an_output_without_a_slope_is_named_where_it_is_asked_for():
    some = forced(-10 * X).with_outputs({"x": X, "distance": ca.sqrt(X**2 + BODY.y**2)})
    refused("output 'distance' has no finite derivative", mb.linearize, some)
    assert mb.linearize(some, outputs=["x"]).C.shape[0] == 1


@pytest.mark.parametrize("law", [-10 * X - 1e3 * ca.fmax(X - 0.05, 0) ** 1.5, -10 * X - 2 * V * ca.fabs(V)])
def test_smooth_laws_with_switches_are_linearised(law):
    lin = mb.linearize(forced(law))
    assert not lin.doubts
    assert np.abs(lin.eigenvalues).max() == pytest.approx(10**0.5)


@pytest.mark.parametrize("rate", [0.7, 6.0, 40.0])
@pytest.mark.parametrize("share", [0.02, 0.5])
def test_a_stiffness_that_is_a_law_of_time_is_doubted(rate, share):
    """Mathieu's equation, whose stability the eigenvalues at one time do not tell."""
    warned("A changes along the motion", mb.linearize, forced(-10 * (1 + share * ca.cos(rate * mb.t)) * X))


def test_a_force_that_is_a_law_of_time_is_not_doubted():
    assert not mb.linearize(forced(-10 * X - V + ca.sin(3 * mb.t))).doubts


# Linearisations of steady motions in closed form, of states that are none, and of coordinates that nothing touches.


@cache
def motions() -> list[SteadyMotion]:
    return [motion for seed in (1, 2) for motion in random_motions(seed)]


@pytest.mark.parametrize("number", range(2 * 8))
def test_eigenvalues_in_closed_form(number: int) -> None:
    motion = motions()[number]
    with warnings.catch_warnings(action="ignore"):
        lin = mb.linearize(motion.scene)
    assert bool(lin.doubts) is not motion.steady
    for value in motion.eigenvalues if motion.steady else ():
        assert np.abs(lin.eigenvalues - value).min() < 1e-6 * abs(value)


def test_growth_is_what_the_closed_form_says() -> None:
    for motion in motions():
        if motion.name == "rolling disc":
            grows = motion.eigenvalues.real.max() > 0
            assert (mb.linearize(motion.scene).stability == "unstable") == grows


def test_critical_speed_of_a_rolling_disc() -> None:
    p = mb.Parameters(w=0.0)
    motion = next(random_motions(3))
    start = {**motion.scene.start, "disc.omega": (0.0, 0.0, p.w)}
    system = motion.scene.system.with_elements((), p)
    scene = mb.Scene(system, start, [0.0, 1.0], guess=motion.scene.guess)
    A = system.M[3, 3]
    disc = float(A)
    mass, R = float(system.M[0, 0]), float(motion.scene.guess["disc.z"])
    expected = np.sqrt(disc * mass * 9.81 * R / (2 * disc * (2 * disc + mass * R * R)))
    found = mb.critical(scene, "w", (0.2 * expected, 3 * expected)).run(np.zeros((1, 0))).Y.ravel()
    assert found == pytest.approx([expected], rel=1e-6)


@pytest.mark.parametrize("gravity", [False, True])
@pytest.mark.parametrize("time", [0.0, 0.7])
def test_a_particle_that_nothing_touches_is_a_state_of_the_outputs(gravity: bool, time: float) -> None:
    a, b = (mb.Body(name, 1.0, pose=mb.Particle()) for name in "ab")
    elements = [a, b, mb.Spring("s", GROUND.point(0, 0), a.point(0, 0), 4.0)]
    elements += [mb.Gravity(0, -9.81)] if gravity else []
    outputs = {"x": b.x, "both": b.x * b.z + 3 * b.vx + a.x}
    start = {"b.vx": 1.5, "a.x": 0.1, "b.x": 0.2, "b.z": 0.4, "b.vz": 0.3}
    run = mb.simulate(mb.Scene(mb.System(*elements), start, [0.0, 0.7], outputs))
    with warnings.catch_warnings(action="ignore"):
        lin = mb.linearize(run, time)
    x, z = 0.2 + 1.5 * time, 0.4 + 0.3 * time
    expected = {"b.x": (1.0, z), "b.z": (0.0, x), "b.vx": (0.0, 3.0), "b.vz": (0.0, 0.0), "a.x": (0.0, 1.0)}
    for name, column in expected.items():
        assert lin.C[:, lin.states.index(name)] == pytest.approx(column)
    i, j = lin.states.index("b.x"), lin.states.index("b.vx")
    assert np.flatnonzero(lin.A[i]).tolist() == [j] and not lin.A[j].any()
