"""States whose rates depend on each other against closed forms, published values and SciPy; laws that name elements
which are declared later."""

import pickle

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import ORIGIN, ball, run_of
from mechanisms import exact
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from stiff_layers import KINDS, MOST, error, make

import symmb as mb
from symmb.run.codegen import has_compiler

TIMES = np.linspace(0.0, 10.0, 51)


def values(states):
    return {state.name: state.value for state in states}


def predators(box=None):
    """The equations of Lotka and Volterra."""
    p = mb.Parameters(growth=1.1, hunger=0.4)
    states = mb.States(["prey", "foxes"], lambda x, y: (p.growth * x - p.hunger * x * y, 0.1 * x * y - 0.4 * y))
    return mb.Scene(mb.System(states), {"prey": 10.0, "foxes": 5.0}, TIMES, values(states), box)


def predators_by_scipy(growth, hunger):
    """Prey and foxes (2, n_t, n) for n values of each parameter."""
    rates = lambda x, y: (growth * x - hunger * x * y, 0.1 * x * y - 0.4 * y)  # noqa: E731
    return pairs_by_scipy(rates, np.repeat([10.0, 5.0], np.size(growth)), TIMES)


def pairs_by_scipy(rates, start, times):
    """States (2, n_t, n) of n systems of two states."""
    flat = exact(lambda _, z: np.concatenate(rates(*z.reshape(2, -1))), start, times)
    return flat.reshape(len(times), 2, -1).swapaxes(0, 1)


def from_rest(A, b, times):
    """States (n_t, n) of x' = A x + b from 0, by the exponential of a matrix."""
    whole = np.block([[A, np.reshape(b, (-1, 1))], [np.zeros((1, len(A) + 1))]])
    return np.array([expm(whole * t)[:-1, -1] for t in times])


@pytest.mark.parametrize(
    "solver", [None, mb.Rosenbrock(1e-10), mb.StateSpace(), mb.CVODES(1e-11, 1e-12), mb.IDAS(1e-11, 1e-12)], ids=repr
)
def test_predators_and_prey_are_those_of_scipy(solver):
    scene, expected = predators(), predators_by_scipy(1.1, 0.4)[:, :, 0].T
    run = mb.simulate(scene, solver)
    assert_allclose(run.values, expected, atol=1e-7)
    if solver is None:  # a copy, too
        assert np.array_equal(mb.simulate(pickle.loads(pickle.dumps(scene))).values, run.values)


def test_bounds_contain_a_scan_and_are_close_to_it():
    """Two parameters; each of 31 x 31 runs is one of SciPy's."""
    bounds = mb.propagate(predators(mb.Box(growth=(1.0, 1.2), hunger=(0.38, 0.42))))
    grid = np.meshgrid(np.linspace(1.0, 1.2, 31), np.linspace(0.38, 0.42, 31))
    scan = predators_by_scipy(*(values.ravel() for values in grid))
    edges = np.array([scan.min(axis=2).T, scan.max(axis=2).T])
    wide = np.ptp(edges, axis=0).max(axis=0)
    assert_allclose([bounds.lower, bounds.upper], edges, atol=3e-3 * wide.min())


def test_an_enclosure_holds_all_runs_and_is_sharp():
    """LOVO21 of the ARCH competition: x' = 3 x - 3 x y, y' = x y - y with an uncertain start."""
    p = mb.Parameters(start=1.3)
    states = mb.States(["x", "y"], lambda x, y: (3 * x - 3 * x * y, x * y - y))
    times, box = np.linspace(0.0, 3.64, 15), mb.Box(start=(1.288, 1.312))
    scene = mb.Scene(mb.System(states, parameters=p), {"x": p.start, "y": 1.0}, times, values(states), box)
    bounds = mb.propagate(scene, mb.TaylorModel(order=8))

    starts = [*np.linspace(1.288, 1.312, 201), *np.ones(201)]
    runs = pairs_by_scipy(lambda x, y: (3 * x - 3 * x * y, x * y - y), starts, times)
    lowest, highest = runs.min(axis=2).T, runs.max(axis=2).T
    assert (bounds.outer[0] <= lowest + 1e-11).all() and (highest - 1e-11 <= bounds.outer[1]).all()
    assert_allclose((bounds.outer[1] - bounds.outer[0])[1:].mean(), (highest - lowest)[1:].mean(), rtol=2e-3)


R, L, C, U = 2.0, 0.5, 0.1, 3.0


def test_a_circuit_of_three_parts_is_linear():
    """R, L and C in series at a voltage: current i and voltage u of the capacitor."""
    p = mb.Parameters(resistance=R)
    i, u = circuit = mb.States(["i", "u"], lambda i, u: ((U - p.resistance * i - u) / L, i / C))
    A = np.array([[-R / L, -1 / L], [1 / C, 0]])
    times = np.linspace(0.0, 2.0, 21)
    scene = mb.Scene(mb.System(circuit), {}, times, {"i": (i.value, "A"), "u": (u.value, "V")})
    assert_allclose(mb.simulate(scene).values, from_rest(A, [U / L, 0], times), atol=1e-9)
    line = mb.linearize(mb.Scene(scene.system, {"i": 0.0, "u": U}, outputs=scene.outputs), inputs=["resistance"])
    assert line.states == ("i", "u")
    assert_allclose(line.A, A, atol=1e-14)
    assert_allclose(line.C, np.eye(2), atol=1e-14)
    assert_allclose(np.sort_complex(line.eigenvalues), np.sort_complex(np.linalg.eigvals(A)), rtol=1e-12)


@pytest.mark.parametrize("coordinates", ["joint", "body"])
def test_a_controller_in_state_space_turns_a_disc(coordinates):
    """A PI controller with a filter: z' = A z + B e and the torque C z + D e, as matrices; the disc starts at rest."""
    A, B, c, d = np.array([[0.0, 0.0], [0.0, -20.0]]), np.array([1.0, 20.0]), np.array([8.0, -30.0]), 36.0
    J, target = 0.5, 1.0
    disc = mb.Body("disc", mass=2.0, inertia=J)
    hinge = mb.Revolute("hinge", ORIGIN, disc.point(0, 0))
    error = target - hinge.angle
    pi = mb.States(["sum", "slow"], lambda *z: ca.DM(A) @ ca.vertcat(*z) + ca.DM(B) * error)
    torque = ca.dot(ca.DM(c), ca.vertcat(*(z.value for z in pi))) + d * error - 4 * hinge.angle_rate
    motor, times = mb.Actuator("motor", hinge, torque), np.linspace(0.0, 3.0, 31)
    outputs = {"angle": hinge.angle, "rate": hinge.angle_rate, "sum": pi.sum.value, "slow": pi["slow"].value}
    whole = np.zeros((4, 4))  # angle, rate, and the two states
    whole[0, 1], whole[1], whole[2:, 2:], whole[2:, 0] = 1, [-d / J, -4 / J, *(c / J)], A, -B
    run = run_of(disc, hinge, pi, motor, times=times, outputs=outputs, coordinates=coordinates)
    assert_allclose(run.values, from_rest(whole, target * np.array([0, d / J, *B]), times), atol=1e-8)


def robertson(a, b, c):
    first, second, third = 0.04 * a, 1e4 * b * c, 3e7 * b**2
    return [second - first, first - second - third, third]


def hires(a, b, c, d, e, f, g, h):
    joined = 280 * f * h - 1.81 * g
    return [
        -1.71 * a + 0.43 * b + 8.32 * c + 0.0007, 1.71 * a - 8.75 * b, -10.03 * c + 0.43 * d + 0.035 * e,
        8.32 * b + 1.71 * c - 1.12 * d, -1.745 * e + 0.43 * f + 0.43 * g,
        -280 * f * h + 0.69 * d + 1.71 * e - 0.43 * f + 0.69 * g, joined, -joined,
    ]  # fmt: skip


def oregonator(a, b, c):
    return [77.27 * (b + a * (1 - 8.375e-6 * a - b)), (c - (1 + a) * b) / 77.27, 0.161 * (a - c)]


PUBLISHED = [
    (robertson, [1, 0, 0], 1e11, [0.2083340149701255e-07, 0.8333360770334713e-13, 0.9999999791665050], 1e-3),
    (hires, [1, 0, 0, 0, 0, 0, 0, 0.0057], 321.8122,
     [0.7371312573325668e-3, 0.1442485726316185e-3, 0.5888729740967575e-4, 0.1175651343283149e-2,
      0.2386356198831331e-2, 0.6238968252742796e-2, 0.2849998395185769e-2, 0.2850001604814231e-2], 1e-7),
    (oregonator, [1, 2, 3], 360.0, [1.000814870318523, 1228.178521549917, 132.0554942846706], 1e-8),
]  # fmt: skip
"""Rates, start, last time, states then by the Test Set for IVP Solvers (Mazzia and Magherini 2008), relative error."""


@pytest.mark.parametrize(("law", "start", "end", "expected", "error"), PUBLISHED)
def test_stiff_reactions_end_at_the_published_values(law, start, end, expected, error):
    start = {f"y{k}": value for k, value in enumerate(start)}
    states = mb.States([*start], law)
    run = run_of(states, start=start, times=[0.0, end], outputs=values(states))
    assert_allclose(run.values[-1], expected, rtol=error)


@pytest.mark.parametrize("kind", KINDS[:3])
def test_studies_of_reactions_with_a_fast_start_are_those_of_scipy(kind):
    assert error(*make(kind, np.random.default_rng(1))) < MOST


def test_a_rod_of_sixty_cells_cools_by_its_modes():
    """T_k' = 61^2 (T_k-1 - 2 T_k + T_k+1), cold at both ends, from the first and the third mode."""
    k, names = np.arange(1, 61), [f"T{k}" for k in range(1, 61)]

    def rates(*temperatures):
        T = [0, *temperatures, 0]
        return [61**2 * (T[k - 1] - 2 * T[k] + T[k + 1]) for k in range(1, 61)]

    modes = [np.sin(m * np.pi * k / 61) for m in (1, 3)]
    states = mb.States(names, rates)
    times = np.linspace(0.0, 0.1, 11)
    start = dict(zip(names, sum(modes).tolist(), strict=True))
    run = run_of(states, start=start, times=times, outputs=values(states))
    speeds = [(2 - 2 * np.cos(m * np.pi / 61)) * 61**2 for m in (1, 3)]
    expected = sum(np.outer(np.exp(-w * times), mode) for w, mode in zip(speeds, modes, strict=True))
    assert_allclose(run.values, expected, atol=1e-7)


def tanks():
    """A valve between two tanks opens when the first is full to 0.6 m."""
    p = mb.Parameters(inflow=0.5, valve=0.4)

    def rates(first, second):
        flow = ca.if_else(first > 0.6, p.valve * (first - second), 0)
        return p.inflow - flow, flow - 0.3 * ca.sqrt(second + 0.01)

    states, box = mb.States(["first", "second"], rates), mb.Box(inflow=(0.45, 0.55), valve=(0.36, 0.44))
    return mb.Scene(mb.System(states), {"second": 0.2}, np.linspace(0.0, 4.0, 41), values(states), box)


def tanks_by_scipy(inflow, valve, times):
    def rates(_, z, is_open):
        flow = valve * (z[0] - z[1]) * is_open
        return [inflow - flow, flow - 0.3 * np.sqrt(z[1] + 0.01)]

    full = lambda t, z, _: z[0] - 0.6  # noqa: E731
    full.terminal = True
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12, "dense_output": True}
    before = solve_ivp(rates, (0.0, times[-1]), [0.0, 0.2], events=full, args=(False,), **options)
    when = before.t[-1]
    after = solve_ivp(rates, (when, times[-1]), before.y[:, -1], args=(True,), **options)
    return np.where(times < when, before.sol(times), after.sol(times)).T


def test_a_valve_that_opens_is_a_switch():
    scene = tanks()
    assert_allclose(mb.simulate(scene).values, tanks_by_scipy(0.5, 0.4, scene.times), atol=1e-7)
    inflows, valves = (axis.ravel() for axis in np.meshgrid(np.linspace(0.45, 0.55, 11), np.linspace(0.36, 0.44, 11)))
    scan = [tanks_by_scipy(*pair, scene.times) for pair in zip(inflows, valves, strict=True)]
    bounds, lowest, highest = mb.propagate(scene), np.min(scan, axis=0), np.max(scan, axis=0)
    assert (bounds.lower <= lowest + 1e-8).all() and (highest - 1e-8 <= bounds.upper).all()
    wide = (highest - lowest).max(axis=0)
    assert (lowest - bounds.lower <= 0.01 * wide).all() and (bounds.upper - highest <= 0.01 * wide).all()


@pytest.mark.skipif(not has_compiler(), reason="needs a C compiler")
def test_an_fmu_has_these_states(tmp_path):
    fmpy = pytest.importorskip("fmpy")
    mb.save_fmu(predators(), path := str(tmp_path / "predators.fmu"))
    rows = fmpy.simulate_fmu(path, stop_time=TIMES[-1], output_interval=0.2, start_values={"growth": 1.2})
    expected = predators_by_scipy(1.2, 0.4)[:, :, 0]
    for name, values in zip(("prey", "foxes"), expected, strict=True):
        assert_allclose(rows[name], values, atol=1e-6)


def test_states_are_found_by_name_and_by_place():
    calls = []
    states = mb.States(("µ", "b"), lambda x, y: calls.append(None) or (y, -x))
    first, second = states
    assert states.b is states["b"] is states[1] is states[-1] is second and states["μ"] is first
    assert len(states) == 2 and repr(states) == "States(['μ', 'b'])"
    mb.System(states)
    assert len(calls) == 1
    with mb.System() as system:
        mb.States(["x", "y"], lambda x, y: (y, -x))
    assert [element.name for element in system.elements] == ["x", "y"]
    assert str(system.s_rate) == "[y, (-x)]"


# Elements that are declared later


def test_two_single_states_may_name_each_other():
    x = mb.State("x", rate=lambda z: y.value)
    y = mb.State("y", rate=lambda z: -4 * x.value)
    assert_allclose(run_of(x, y, start={"x": 1.0}, times=TIMES)["x"], np.cos(2 * TIMES), atol=1e-8)


def test_a_chain_of_states_in_a_list_names_the_next_one():
    """A ring: z_k' = z_k+1 - z_k. The sum stays, and the exponential of the matrix has the rest."""
    times, ring = np.linspace(0.0, 2.0, 11), []
    ring += [mb.State(f"z{k}", rate=lambda z, k=k: ring[(k + 1) % 5].value - z) for k in range(5)]
    run = run_of(*ring, start={"z0": 1.0}, times=times, outputs=values(ring))
    A = np.roll(np.eye(5), 1, axis=1) - np.eye(5)
    assert_allclose(run.values, [expm(A * t)[:, 0] for t in times], atol=1e-9)


def test_a_law_in_a_loop_has_the_values_of_its_turn():
    states = []
    for speed in (1.0, 2.0):
        states.append(mb.State(f"z{speed:.0f}", rate=lambda z: -speed * z))  # noqa: B023
        states.extend(mb.States([f"a{speed:.0f}", f"b{speed:.0f}"], lambda a, b: (-speed * a, a)))  # noqa: B023
    start = {"z1": 1.0, "z2": 1.0, "a1": 1.0, "a2": 1.0}
    run = run_of(*states, start=start, times=[0.0, 1.0], outputs=values(states))
    one, two = np.exp(-1.0), np.exp(-2.0)
    assert_allclose(run.values[-1], [one, one, 1 - one, two, two, (1 - two) / 2], atol=1e-9)


def test_a_state_names_the_motor_that_it_drives():
    """An integral of the current's error is the voltage. J w' = k i, L i' = g m - R i - k w, m' = I - i."""
    J, k, resistance, inductance, gain, target = 0.02, 0.3, 1.5, 0.05, 12.0, 0.8
    wheel = mb.Body("wheel", mass=1.0, inertia=J)
    shaft = mb.Revolute("shaft", ORIGIN, wheel.point(0, 0))
    memory = mb.State("memory", rate=lambda z: target - motor.current)
    motor = mb.Motor("motor", shaft, gain * memory.value, resistance, k, inductance)
    times = np.linspace(0.0, 1.0, 21)
    outputs = {"speed": shaft.angle_rate, "current": motor.current, "memory": memory.value}
    run = run_of(wheel, shaft, memory, motor, times=times, outputs=outputs)
    A = [[0, k / J, 0], [-k / inductance, -resistance / inductance, gain / inductance], [0, -1, 0]]
    assert_allclose(run.values, from_rest(np.array(A), [0, 0, target], times), atol=1e-8)


def test_a_pull_names_a_later_state():
    """The pull grows with time: x'' = -10 m, m' = 2."""
    law = lambda length, rate: 10 * wound.value  # noqa: E731
    machine = ball(lambda m: mb.NonlinearSpring("rope", ORIGIN, m.at, law), wound := mb.State("wound", 2.0), g=None)
    assert_allclose(machine.run("x", [0.0, 1.0], {"ball.x": 30.0})["x"], [30.0, 30.0 - 20.0 / 6], atol=1e-9)


def test_a_sampled_value_names_a_later_one():
    """Each value sees what the other one held: u_k = v_k-1 + 1, and v_k = 2 u_k at the same instant."""
    u = mb.Sampled("u", 0.1, law=lambda held: v.value + 1)
    v = mb.Sampled("v", 0.1, law=lambda held: 2 * u.value)
    times = 0.1 * np.arange(4) + 0.05
    run = ball(u, v, g=None).run(values((u, v)), [0.0, *times])
    assert_allclose(run.values[1:], [[1, 2], [3, 6], [7, 14], [15, 30]], atol=1e-12)


def test_the_rate_of_a_state_that_names_later_elements_is_known_with_the_system():
    x = mb.State("x", rate=lambda z: -3 * y.value)
    refused("'x' is a first-order state. Its rate names elements that are declared later", lambda: mb.ddt(x.value))
    y = mb.State("y", rate=0.0)
    assert str(mb.System(x, y).ddt(x.value)) == str(mb.ddt(x.value)) == "(-3*y)"


def test_an_older_element_of_the_same_name_is_reported():
    x, older = mb.State("x", rate=1.0), mb.State("x", rate=1.0)
    told = "State 'y': rate: symbol 'x' belongs to an object outside the System, which has another"
    refused(told, lambda: mb.System(x, mb.State("y", rate=lambda z: older.value)))


def both(x, y):
    return y, -x


PAIR = mb.States(["x", "y"], both)
FAULTS = [
    (lambda: mb.States("xy", both), r'States: expected a list of names, such as \["x", "y"\], got \'xy\''),
    (lambda: mb.States([], both), r"States: expected a list of names, such as .*, got \[\]"),
    (lambda: mb.States(["x", "x"], both), r"States: 'x': the name is used twice"),
    (lambda: mb.States(["x", "2y"], both), r"States: '2y': the name must consist of letters, digits and underscores"),
    (lambda: mb.States(["x", 3], both), r"States: 3: a name must be a text, got 3"),
    (lambda: mb.States(["x"], 1.0), r"States: rates 1.0 is not a function. Pass a function of the values that"),
    (lambda: mb.States(["x", "y"], lambda x, y: (y, x, x)), r"States \['x', 'y'\]: rates: expected 2 rates, .*got 3"),
    (lambda: mb.States(["x", "y"], lambda x, y: x), r"rates: expected 2 rates, one for each state, got 1"),
    (lambda: mb.States(["x", "y"], lambda x: x), r"rates: the law raises TypeError: .*takes 1 positional"),
    (lambda: mb.States(["x", "y"], lambda x, y: (y, "fast")), r"State 'y': rate: expected one number or CasADi SX"),
    (lambda: mb.States(["x", "y"], both).z, r"States: no state 'z'. Known are: x, y"),
    (lambda: mb.States(["x1", "y"], both)["x"], r"States: no state 'x'. Did you mean 'x1'"),
    (lambda: mb.System(PAIR.x), r"State 'x': rate: State 'y' is not part of the System"),
    (lambda: mb.System(mb.States(["x", "y"], both), mb.State("x", 1.0)), r"State 'x': the name is used twice"),
    (lambda: mb.System(mb.States(["x"], lambda x: nowhere.value)), r"rates: the law raises NameError: .*'nowhere'"),  # noqa: F821
    (lambda: mb.System(mb.Sampled("u", 0.1, lambda u: nowhere)), r"Sampled 'u': law: the law raises NameError"),  # noqa: F821
]


@pytest.mark.parametrize(("make", "text"), FAULTS)
def test_faults_name_the_states(make, text):
    assert "\n" not in refused(text, make)
