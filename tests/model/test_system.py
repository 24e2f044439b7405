"""A system derives what its scene needs and nothing else, and says so; its compiled Functions fit together."""

import subprocess

import casadi as ca
import machines
import numpy as np
import pytest
import sympy as sp
from faults import refused
from joints import bundle, numbers, random_state
from machines import rods
from mechanisms import double_pendulum, spinning_body
from numpy.testing import assert_allclose
from processes import printed_lines
from scipy.integrate import solve_ivp

import symmb as mb
from symmb.equations.model.c_export import example_c, save_c


def pendulum():
    p = mb.Parameters(l=1.0, g=9.81)
    rod = mb.Body("rod", p.l, p.l**3 / 12, mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(0, -p.l / 2))
    return mb.System(rod, hinge, mb.Gravity(0, p.g), parameters=p)


def spatial():
    p = mb.Parameters(m=2.0)
    top = mb.Body("top", p.m, (0.1, 0.2, 0.3), mb.Spatial())
    return mb.System(top, mb.Spherical("tip", mb.Ground().point(0, 0), top.point(0, 0, -0.5)), parameters=p)


def driven():
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    return mb.System(ball, mb.Motion("drive", ball.x, ca.sin(mb.t)), mb.Force("push", ball.point(0, 0), (0, 1, 2)))


def free():
    ball = mb.Body("ball", 2.0, pose=mb.Particle())
    return mb.System(ball, mb.Spring("spring", mb.Ground().point(0, 0), ball.point(0, 0), 8.0))


SYSTEMS = {
    pendulum: (
        "M Q Phi Phi_q gamma",
        "1 planar|1 Revolute|1 Gravity|n_q = 3, n_v = 3, n_c = 2; 1 degree of freedom|3 of 5 rows of Phi vanish|"
        "constant along the motion, diagonal: reciprocals|quaternions and N|Phi_t and Phi_tt (no drive)|"
        "work (all forces have a potential)",
        (),
    ),
    spatial: (
        "M N Q Phi Phi_q gamma",
        "1 spatial|n_q = 7, n_v = 6, n_c = 3; 3 degrees of freedom",
        ("quaternions", "vanish by structure"),
    ),
    driven: ("M Q Phi Phi_q Phi_t gamma", "1 Motion|1 Force", ("Phi_tt",)),
    free: ("M Q", "Phi, gamma and multipliers (no constraint)|constraints  none", ()),
    mb.System: ("", "bodies       none|M            none", ()),
}
"""The parts of a system, what its print tells, and what it leaves out."""


@pytest.mark.parametrize("make", SYSTEMS)
def test_only_what_a_scene_has_is_there(make):
    system, parts = make(), tuple(SYSTEMS[make][0].split())
    assert system.parts == tuple(system.to_sympy()) == parts
    assert system.latex().count(r"\[") == len(system._as_read.displays) >= len(parts)


@pytest.mark.parametrize("make", SYSTEMS)
def test_print_tells_what_was_found_and_what_fell_away(make):
    text, (_, told, absent) = str(make()), SYSTEMS[make]
    for part in told.split("|"):
        assert part in text, text
    assert not any(part in text for part in absent)


def test_to_sympy_gives_the_same_numbers():
    system = pendulum()
    matrices = system.to_sympy("M", "Q", "Phi", "Phi_q", "gamma")
    names = [*system.parameters, *system.collected.q_names, *system.collected.v_names]
    values = dict(zip(names, (0.8, 9.0, 0.3, -0.4, 0.7, 1.0, -2.0, 3.0), strict=True))
    for name, matrix in matrices.items():
        sx = getattr(system, name)
        f = ca.Function("f", [system.p, system.q, system.v], [ca.densify(sx)])
        expected = f([0.8, 9.0], [0.3, -0.4, 0.7], [1.0, -2.0, 3.0]).full()
        found = np.array(matrix.subs({s: values[s.name] for s in matrix.free_symbols}), dtype=float)
        assert_allclose(found, expected, atol=1e-14)
    assert {s.name for s in matrices["Phi"].free_symbols} == {"l", "rod.x", "rod.y", "rod.theta"}
    assert matrices["M"][0, 0] == next(s for s in matrices["M"].free_symbols if s.name == "l")
    assert isinstance(matrices["M"], sp.MatrixBase)


def test_latex_shows_names():
    text = pendulum().latex()
    assert all(part in text for part in (r"\Phi_q =", r"\gamma =", r"\theta"))


def test_coordinates_stand_in_the_order_of_declaration():
    a, b = mb.Body("a", 1.0, 0.1), mb.Body("b", 1.0, (1, 2, 3), mb.Spatial())
    system, dae = bundle(b, a, mb.Gravity(0, -9.81), mb.Spherical("ball", a.point(0, 0), b.point(0, 0)))
    assert dae.q_names == ("b.x", "b.y", "b.z", "b.e0", "b.e1", "b.e2", "b.e3", "a.x", "a.y", "a.theta")
    assert dae.v_names == ("b.vx", "b.vy", "b.vz", "b.omega_x", "b.omega_y", "b.omega_z", "a.vx", "a.vy", "a.omega")
    assert dae.row_names == ("ball.lam[0]", "ball.lam[1]", "ball.lam[2]")
    assert [s.name() for s in ca.vertsplit(system.q)] == list(dae.q_names)
    assert [s.name() for s in ca.vertsplit(system.lam("ball"))] == list(dae.row_names)
    assert_allclose(dae.q_neutral, [0, 0, 0, 1, 0, 0, 0, 0, 0, 0])


def test_points_are_declared_from_their_own_origin():
    """A plate whose centre of mass lies (0.1, -0.2) off the origin of its points, turned by a right angle."""
    plate = mb.Body("plate", 1.0, 0.1, mb.Planar(), com=(0.1, -0.2))
    point = plate.point(0.5, 0.3)
    f = ca.Function("f", [plate.frame.q, plate.frame.v], [point.x, point.y, point.vx, point.vy])
    x, y, vx, vy = (float(value) for value in f([1, 2, np.pi / 2], [3, 4, 5]))
    assert_allclose([x, y], [1 - 0.5, 2 + 0.4])
    assert_allclose([vx, vy], [3 - 5 * 0.4, 4 - 5 * 0.5])


def test_rotations_are_body_to_world_and_compose_from_the_right():
    body = mb.Body("b", 1.0, (1, 1, 1), mb.Spatial())
    R = ca.Function("R", [body.frame.q], [body.rotation])
    quarter_z, quarter_x = mb.rotation((0, 0, 1), np.pi / 2), mb.rotation((2, 0, 0), np.pi / 2)

    def matrix(rotation):
        return R(ca.vertcat(0, 0, 0, ca.DM(rotation.quaternion))).full()

    assert_allclose(matrix(quarter_z) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    assert_allclose(matrix(quarter_z @ quarter_x), matrix(quarter_z) @ matrix(quarter_x), atol=1e-15)
    assert_allclose(matrix(quarter_z @ quarter_x) @ [0, 1, 0], [0, 0, 1], atol=1e-15)


def test_untouched_coordinates_of_a_particle_move_uniformly():
    falling = machines.ball(lambda m: mb.Force("drag", m.at, (0, -0.5 * m.ball.vy)), mass=2.0)
    ball, system = falling.ball, falling.system
    assert system.collected.q_names == ("ball.y",)
    assert system.q.numel() == system.v.numel() == 1
    assert "ball.x moves uniformly" in str(system) and "ball.z moves uniformly" in str(system)
    outputs = {"x": ball.x, "vx": ball.vx, "z": ball.z, "d": ball.x * ball.y, "y": ball.y}
    trajectory = falling.run(outputs, np.linspace(2.0, 4.0, 5), {"ball.x": 1.0, "ball.vx": 3.0, "ball.z": -2.0})
    t = trajectory.t - 2.0
    assert_allclose([trajectory[name] for name in ("x", "vx", "z")], [1 + 3 * t, 0 * t + 3, 0 * t - 2])
    assert_allclose(trajectory["d"], trajectory["x"] * trajectory["ball.y"])
    assert_allclose([trajectory(ball.point(1, 0).x), trajectory(ball.vz)], [2 + 3 * t, 0 * t])
    assert trajectory.energy_drift < 1e-7


@pytest.mark.parametrize(
    "element",
    [
        lambda b: mb.Force("push", b.point(0, 0), (0, b.x)),
        lambda b: mb.Force("push", b.point(0, 0), (0, ca.sin(b.vx))),
        lambda b: mb.Motion("drive", b.y - b.x, mb.t),
        lambda b: mb.VelocityConstraint("roll", (b.vy - b.vx,)),
    ],
)
def test_a_coordinate_that_anything_touches_stays(element):
    system = machines.ball(lambda m: element(m.ball), g=None).system
    assert system.collected.q_names == ("ball.x", "ball.y")


@pytest.mark.parametrize("solver", [mb.CVODES(rtol=1e-11), mb.IDAS(rtol=1e-11), mb.Collocation(steps=200)], ids=repr)
def test_a_massless_coupler_carries_force_without_inertia(solver):
    """A massless bar hinged to the ground and to a particle is a rod without mass: the pendulum of length 0.8."""
    bar = mb.Body("bar", 0.0, 0.0, mb.Planar())
    bob = mb.Body("bob", 1.5, 0.0, mb.Planar())
    system = mb.System(
        bar, bob,
        mb.Revolute("top", mb.Ground().point(0, 0), bar.point(0, 0)),
        mb.Weld("end", bar.point(0, -0.8), bob.point(0, 0)),
        mb.Gravity(0, -9.81),
    )  # fmt: skip
    assert "singular: the full matrix is solved" in str(system)
    times = np.linspace(0, 2, 9)
    run = mb.simulate(mb.Scene(system, start={"bar.theta": 0.6}, times=times), solver)
    alone, start = machines.bob(length=0.8, mass=1.5), {"bob.x": 0.8 * np.sin(0.6), "bob.z": 0.0}
    expected = alone.run(None, times, start, solver=mb.CVODES(rtol=1e-12), guess={"bob.y": -0.8})
    assert_allclose(run["bob.x"], expected["bob.x"], atol=2e-8)
    assert_allclose(run.reaction("end")[0][:, 1], expected.reaction("rod")[0][:, 1], atol=1e-6)


def test_a_system_without_constraints_has_no_rows():
    system = free()
    dae = mb.compile_dae(system)
    assert (dae.Phi, dae.G, dae.gamma, dae.min_norm_correction, dae.n_r, dae.power) == (None, None, None, None, 0, None)
    times = np.linspace(0, 3, 7)
    trajectory = mb.simulate(mb.Scene(system, {"ball.x": 0.4, "ball.vy": 1.0}, times), mb.CVODES(rtol=1e-11))
    assert_allclose(trajectory["ball.x"], 0.4 * np.cos(2 * times), atol=1e-8)
    assert_allclose(trajectory["ball.y"], 0.5 * np.sin(2 * times), atol=1e-8)
    assert trajectory.lam.shape == (7, 0)


def test_a_scene_without_bodies_is_an_expression_of_parameters_and_time():
    p = mb.Parameters(x=0.2)
    scene = mb.Scene(mb.System(parameters=p), times=[0.0, 1.0, 3.0], outputs={"y": p.x * mb.t**2, "one": 1.0})
    simulator = mb.DAESimulator(scene)
    ensemble = simulator.run(np.array([[0.2], [2.0]]))
    assert_allclose(ensemble.Y, [[[0, 1], [0.2, 1], [1.8, 1]], [[0, 1], [2, 1], [18, 1]]])
    assert ensemble.ok.all()
    assert_allclose(numbers(simulator.expression, [3.0], 2.0), [12, 1])
    assert_allclose(simulator.jets(np.array([0.2]), np.array([[1.0]]), 2)[1, 0, :, 0], [0, 1, 9])
    assert np.isnan(mb.simulate(scene).energy_drift)


def test_the_nearest_names_are_offered():
    trajectory = mb.simulate(mb.Scene(pendulum()))
    refused(r"No output or state 'rod\.teta'\. Did you mean 'rod\.theta'\?", lambda: trajectory["rod.teta"])


@pytest.mark.parametrize("law", [lambda u: 3 * u, lambda u: u**2 - u])
def test_inputs_stand_in_the_equations(law):
    """In Q, also of joints, as symbols; in compiled equations as parameters behind the others; in runs they are 0."""
    u = mb.Input("u")
    lag = mb.State("lag", rate=lambda z: u.value - z)
    motor = lambda m: mb.Actuator("motor", m.hinge, law(u.value) + 0 * lag.value)  # noqa: E731
    system = machines.pendulum(u, lag, motor, length=0.5, mass=2.0, inertia=0.05, g=None).system
    slopes = [ca.substitute(ca.jacobian(own.Q, u.value), u.value, 0.7)[-1] for own in (system, system.joint_space())]
    slope = float(ca.substitute(ca.jacobian(law(u.value), u.value), u.value, 0.7))
    assert [float(s) for s in slopes] == [slope, slope]
    assert float(ca.jacobian(system.s_rate, u.value)) == 1
    dae = mb.compile_dae(system.joint_space())
    assert dae.p_names == ("length", "mass", "inertia", "u")
    assert_allclose(
        dae.rhs(0, 0, 0, [0.5, 2.0, 0.05, 0.7], 0)[1], float(law(ca.SX(0.7))) / (0.05 + 2.0 * 0.5**2), atol=1e-12
    )
    assert mb.simulate(mb.Scene(system, times=[0.0, 1.0]))["rod.omega"][-1] == 0
    assert "u" in str(system.to_sympy("Q")["Q"])


@pytest.mark.parametrize(
    ("law", "coordinates"),
    [
        (lambda u, b: (u, 0), "x"), (lambda u, b: (0, -1.7 * u**2), "y"), (lambda u, b: (u * b.vx, 0), "x"),
        (lambda u, b: (0, u * ca.sin(b.x)), "xy"), (lambda u, b: (0 * u, 0), ""),
    ],
)  # fmt: skip
def test_coordinates_that_only_inputs_drive_stay(law, coordinates):
    u, ball, other = mb.Input("u"), mb.Body("ball", 2.0, pose=mb.Particle()), mb.Body("other", 3.0, pose=mb.Particle())
    force = law(u.value, ball)
    system = mb.System(ball, other, u, mb.Force("push", ball.point(0, 0), force), mb.Gravity(0, 0, -9.81))
    names = [*(f"ball.{name}" for name in coordinates), "ball.z", "other.z"]
    assert [*system.collected.q_names] == [*system.with_inputs.collected.q_names] == names
    pushed = [force["xy".index(name)] for name in coordinates]
    at = [u.value, ball.x, ball.vx], [0.6, 0.4, -0.8]
    Q = ca.Function("Q", [*at[0]], [system.Q - ca.vertcat(*pushed, -19.62, -29.43)])
    assert_allclose(Q(*at[1]).full(), 0, atol=1e-15)
    run = mb.simulate(mb.Scene(system, {"ball.vx": 1.3, "ball.vy": -0.4}, [0.0, 2.0], outputs={"way": ball.x - ball.y}))
    assert_allclose(run["way"], [0, 3.4], atol=1e-12)
    assert_allclose([run[name][0] for name in names], 0)


@pytest.mark.parametrize(("scene", "p"), [(double_pendulum, [1.1, 0.7]), (spinning_body, [1.2, 0.1])])
def test_the_functions_fit_together(scene, p):
    dae = mb.compile_dae(scene().system)
    rng = np.random.default_rng(3)
    q, v = random_state(dae, rng)
    at = (q, v, p, 0.3)
    M, G, Q, gamma = (f(*at).full() for f in (dae.M, dae.G, dae.Q, dae.gamma))
    assert np.linalg.eigvalsh(M).min() > 0
    qdot, vdot = (x.full() for x in dae.rhs(*at))
    a, lam = (x.full() for x in dae.forward(*at, gamma))
    assert_allclose(a, vdot, atol=1e-12)
    assert_allclose(M @ a + G.T @ lam, Q, atol=1e-11)
    assert_allclose(G @ a, gamma, atol=1e-11)
    right = rng.uniform(-1, 1, dae.n_r)
    delta = numbers(dae.min_norm_correction, *at, right)
    assert_allclose(G @ delta, right, atol=1e-12)
    inverse = np.linalg.inv(M)  # the least of all such displacements in the norm of M
    assert_allclose(delta, inverse @ G.T @ np.linalg.solve(G @ inverse @ G.T, right), atol=1e-11)
    T, _ = dae.energy(*at)
    assert_allclose(float(T), 0.5 * v @ M @ v)
    assert_allclose(dae.Phi_q(*at).full() @ qdot[:, 0], numbers(dae.Phi_dot, *at), atol=1e-13)
    h = 1e-6
    assert_allclose((numbers(dae.retract, q, h * v) - q) / h, qdot[:, 0], atol=1e-5)
    assert_allclose(numbers(dae.retract, q, np.zeros(dae.n_v)), q, atol=1e-15)


def test_sizes_and_names():
    dae = mb.compile_dae(double_pendulum().system)
    assert (dae.n_q, dae.n_v, dae.n_s, dae.n_c, dae.n_r) == (6, 6, 0, 4, 4)
    assert dae.rows == {"shoulder": slice(0, 2), "elbow": slice(2, 4)}
    assert dae.p_names == ("l1", "l2")
    assert (dae.Phi_t, dae.power, dae.s_start) == (None, None, None)


def test_the_paper_s_double_pendulum_is_solved_in_few_instructions():
    """Range space by LDL' keeps the count low: the dense KKT matrix takes over a thousand."""
    assert mb.compile_dae(double_pendulum().system).rhs.n_instructions() < 300


def test_instructions_grow_with_the_number_of_bodies_not_its_cube():
    long, short = (mb.compile_dae(rods(n).system).rhs.n_instructions() / n for n in (40, 5))
    assert long < 1.3 * short


def test_retraction_keeps_quaternions_at_unit_length():
    dae = mb.compile_dae(spinning_body().system)
    q, v = random_state(dae, np.random.default_rng(4))
    assert_allclose(np.linalg.norm(numbers(dae.retract, q, 0.3 * v)[3:]), 1, rtol=1e-15)


@pytest.mark.parametrize("rows", [[1, 0], [0.0, 1.0, 1.0], np.array([1, 0], dtype=np.int8)], ids=repr)
def test_rows_to_keep_are_a_set(rows):
    """In any order, and as numbers of any kind."""
    system = double_pendulum().system
    assert mb.compile_dae(system, rows).row_names == ("shoulder.lam[0]", "shoulder.lam[1]")


@pytest.mark.parametrize("rows, nullities", [([4], (0, 0)), ([0.5], (0, 0)), ([np.nan], (0, 0)), ([0], (0.5, 0))])
def test_rows_and_nullities_that_do_not_exist_are_refused(rows, nullities):
    told = "compile_dae: (there is no constraint row|a nullity must be)"
    refused(told, mb.compile_dae, double_pendulum().system, rows, nullities)


# The C that is written builds and runs on its own and gives the trajectory SciPy gives.


# A driven, damped pendulum beside a clock: q = (theta, c), c' = 1 with a velocity that never changes.
Q, V, S, P, T = (ca.SX.sym(name, n) for name, n in [("q", 2), ("v", 2), ("s", 1), ("p", 3), ("t", 1)])
LENGTH, DAMPING, DRIVE = ca.vertsplit(P)
PARAMETERS = {"l": 0.8, "c": 0.1, "amplitude": 2.0}
Q0, V0, S0 = [1.2, 0.0], [-0.3, 1.0], [0.2]


def _accelerations(torque):
    vdot = ca.SX(2, 1)
    vdot[0] = -9.81 / LENGTH * ca.sin(Q[0]) - DAMPING * V[0] + torque
    return vdot


PLAIN = ca.Function("rhs", [Q, V, P, T], [V, _accelerations(DRIVE * ca.cos(2 * T))], list("qvpt"), ["qdot", "vdot"])
RATES = [V, _accelerations(DRIVE * S), 3 * (ca.cos(2 * T) - S)]
FILTERED = ca.Function("rhs", [Q, V, S, P, T], RATES, list("qvspt"), ["qdot", "vdot", "sdot"])


def _pendulum(t, x):
    """Driven by the cosine, or by the fifth state, which follows it."""
    length, damping, amplitude = PARAMETERS.values()
    torque = amplitude * (x[4] if len(x) > 4 else np.cos(2 * t))
    rates = [x[2], x[3], -9.81 / length * np.sin(x[0]) - damping * x[2] + torque, 0.0]
    return [*rates, *(3 * (np.cos(2 * t) - x[4:]))]


@pytest.mark.parametrize("rhs, s", [(PLAIN, []), (FILTERED, S0)])
def test_example_builds_alone_and_agrees_with_scipy(tmp_path, rhs, s):
    t0, t1, steps = 0.5, 5.5, 2000
    names = ["rod.theta", "clock.x"]
    text = example_c(rhs, q=Q0, v=V0, s=s, parameters=PARAMETERS, coordinates=names, t0=t0, t1=t1, steps=steps)
    # gamma as a bare C name would clash with the function of math.h
    save_c({"rhs": rhs, "gamma": PLAIN, "M": ca.Function("M", [P], [ca.diag(P)])}, tmp_path / "c", example=text)
    head, *rows = printed_lines(tmp_path / "c")
    table = np.array([line.split() for line in rows], dtype=float)
    assert head.split() == ["t", "rod.theta", "clock.x"]
    np.testing.assert_allclose(table[:, 0], np.linspace(t0, t1, steps + 1), rtol=1e-14)
    expected = solve_ivp(_pendulum, (t0, t1), [*Q0, *V0, *s], "DOP853", table[:, 0], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(table[:, 1:], expected.y[:2].T, atol=1e-8)


@pytest.mark.parametrize(
    "rate, steps",
    [(Q[0] ** 3, 4000), (ca.sqrt(0.5 - Q[0]), 7), (ca.exp(Q[0]), 30)],
    ids=["runs away", "root", "exponential"],
)
def test_a_motion_that_breaks_down_ends_the_example_with_a_sentence(tmp_path, rate, steps):
    rhs = ca.Function("rhs", [Q, V, P, T], [ca.vertcat(rate, 0), ca.SX(2, 1)], list("qvpt"), ["qdot", "vdot"])
    options = {"q": [0.4, 0], "v": [0, 0], "parameters": PARAMETERS, "coordinates": ["x", "y"], "t0": 0.0, "t1": 400.0}
    save_c({"rhs": rhs}, tmp_path / "c", example=example_c(rhs, **options, steps=steps))
    with pytest.raises(subprocess.CalledProcessError) as error:
        printed_lines(tmp_path / "c")
    assert error.value.returncode == 1 and "nan" not in error.value.stdout
    assert error.value.stderr.startswith("The state became infinite or NaN in the step from t = ")


def test_functions_without_example_are_linked_by_a_program_of_ones_own(tmp_path):
    jacobian = ca.SX(2, 3)
    jacobian[0, 0], jacobian[1, 2] = ca.cos(P[0]), P[1] * P[2]
    save_c({"Phi_q": ca.Function("f", [P], [jacobian], ["p"], ["Phi_q"])}, tmp_path, name="crane")
    (tmp_path / "own.c").write_text(
        '#include <stdio.h>\n#include "crane.h"\n#include "crane.h"\n'
        "int main(void) { const double p[] = {0.5, 2, 3}, *arg[] = {p}; double y[2], *res[] = {y};\n"
        'crane_Phi_q(arg, res, 0, 0, 0); printf("%.17g %.17g", y[0], y[1]); return 0; }\n'
    )
    assert [float(word) for word in printed_lines(tmp_path)[0].split()] == pytest.approx([np.cos(0.5), 6])
    header = (tmp_path / "crane.h").read_text()
    assert "crane_Phi_q(p) -> (Phi_q)" in header
    assert "res[0]  Phi_q    2 x 3, stored: (0,0) (1,2)\n" in header
    assert "arg[0]  p        3 x 1\n" in header


def test_a_model_of_mx_with_an_inner_function(tmp_path):
    q, v, p, t = ca.MX.sym("q"), ca.MX.sym("v"), ca.MX.sym("p", 0), ca.MX.sym("t")
    inner = ca.Function("inner", [Q[0]], [ca.sin(Q[0])], {"never_inline": True})
    rhs = ca.Function("rhs", [q, v, p, t], [v, -inner(q)])
    text = example_c(rhs, q=[0.1], v=[0], parameters={}, coordinates=["x"], t0=0, t1=1, steps=100, name="mx")
    save_c({"rhs": rhs}, tmp_path, name="mx", example=text)
    end = float(printed_lines(tmp_path)[-1].split()[1])
    exact = solve_ivp(lambda _, x: [x[1], -np.sin(x[0])], (0, 1), [0.1, 0], "DOP853", rtol=1e-12, atol=1e-13)
    assert end == pytest.approx(exact.y[0, -1], abs=1e-9)


def test_faults(tmp_path):
    refused("name='my model' is not a C identifier", save_c, {"rhs": PLAIN}, tmp_path, name="my model")
    refused("Pass at least one Function", save_c, {}, tmp_path)
    given = dict(q=Q0, v=V0, parameters=PARAMETERS, coordinates=["a", "b"], t0=0, t1=1, steps=10)
    refused(r"values of these lengths: .*'q': 2", example_c, PLAIN, **given | {"q": [1.0]})
    refused("values of 1 states", example_c, PLAIN, **given | {"s": [1.0]})
    refused("values of 0 states", example_c, FILTERED, **given)
    refused("finite", example_c, PLAIN, **given | {"t1": np.inf})
    refused("at least one step", example_c, PLAIN, **given | {"steps": 0})


@pytest.mark.parametrize("name", ["values", "items", "get", "nominal"])
def test_an_input_may_have_the_name_of_an_attribute_of_parameters(name):
    u, cart = mb.Input(name), mb.Body("cart", 2.0, pose=mb.Particle())
    system = mb.System(cart, u, mb.Force("motor", cart.point(0, 0), (8 * u.value, 0)))
    assert mb.linearize(mb.Scene(system), inputs=[name], outputs=["cart.vx"]).B.ravel().tolist() == [0.0, 4.0]
