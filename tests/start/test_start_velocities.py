"""Velocities at the start: what nothing determines does not move relative to what carries it."""

import numpy as np
import pytest
from machines import GROUND, gears, linkage, pendulum, rods
from numpy.testing import assert_allclose

import symmb as mb


def velocities(scene):
    start = mb.DAESimulator(scene, mb.DormandPrince()).start  # without pilot runs, which would be compiled
    return dict(zip(start.dae.v_names, start.nominal()["v"].tolist(), strict=True))


def values(scene, *names):
    found = velocities(scene)
    return [found[name] for name in names]


def on_rail(name="cart", mass=1.0, inertia=1.0):
    """A body and its rail along x."""
    body = mb.Body(name, mass, inertia)
    return body, mb.Prismatic("rail", GROUND.point(0, 0), body.point(0, 0), axis=(1, 0, 0))


def cart(mass=1.0, length=2.0, parameters=None):
    """A cart on a rail along x, and a rod that hangs from it."""
    (wagon, rail), rod = on_rail(), mb.Body("rod", mass, mass * length**2 / 12)
    return mb.System(
        wagon, rod, rail, mb.Revolute("pin", wagon.point(0, 0), rod.point(0, length / 2)), parameters=parameters
    )


@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("length", [2e-3, 2.0, 2e3])
@pytest.mark.parametrize("listed", [{}, {"rod.omega": 0.0}])
def test_a_rod_on_a_cart_does_not_turn_against_it(mass, length, listed):
    scene = mb.Scene(cart(mass, length), {"cart.vx": 1.0, "rod.theta": 0.7, **listed})
    assert_allclose(values(scene, "cart.vx", "rod.vx", "rod.vy", "rod.omega"), [1, 1, 0, 0], atol=1e-12)
    assert not any(velocities(mb.Scene(cart(mass, length))).values())


@pytest.mark.parametrize(("listed", "value"), [("rod.omega", 3.0), ("rod.vx", 3.0 * np.cos(0.7))])
def test_a_rod_that_turns_does_not_move_the_cart(listed, value):
    scene = mb.Scene(cart(), {listed: value, "rod.theta": 0.7})
    expected = [0, 3 * np.cos(0.7), 3 * np.sin(0.7), 3]
    assert_allclose(values(scene, "cart.vx", "rod.vx", "rod.vy", "rod.omega"), expected, atol=1e-12)


@pytest.mark.parametrize("angle", [np.pi / 2, np.pi / 2 - 1e-4])
def test_a_rod_that_lies_down_moves_the_cart(angle):
    """Its turning alone would not give its middle that velocity, or only at 1e4 rad/s."""
    scene = mb.Scene(cart(), {"rod.vx": 1.0, "rod.theta": angle})
    assert_allclose(values(scene, "cart.vx", "rod.vx", "rod.omega"), [1, 1, 0], atol=1e-3)


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
@pytest.mark.parametrize("k", [0, 1, 2])
def test_what_hangs_on_a_turning_rod_turns_with_it_and_what_carries_it_rests(pose, k):
    name = f"rod{k}.omega"
    start = {name: 2.0} if isinstance(pose, mb.Planar) else {name: (0, 0, 2.0)}
    found = velocities(rods(3, g=None, pose=pose).scene(start=start))
    omega = [found[f"rod{i}.omega" + ("" if isinstance(pose, mb.Planar) else "_z")] for i in range(3)]
    assert_allclose(omega, [0.0 if i < k else 2.0 for i in range(3)], atol=1e-12)
    assert_allclose([found[f"rod{i}.vx"] for i in range(3)], [max(0, 2 * (i - k) + 1) for i in range(3)], atol=1e-12)


@pytest.mark.parametrize("k", [0, 1, 2])
def test_rods_that_float_follow_the_one_that_is_listed(k):
    chain, start = rods(3, g=None), {f"rod{k}.vx": 1.0, f"rod{k}.omega": 2.0}
    floating = mb.System(*chain.bodies, *chain.hinges[1:], parameters=chain.p)
    found = velocities(mb.Scene(floating, start, guess={"rod1.y": -1, "rod2.y": -2}))
    assert_allclose([found[f"rod{i}.omega"] for i in range(3)], 2, atol=1e-12)
    assert_allclose([found[f"rod{i}.vx"] for i in range(3)], [1 + 2 * (i - k) for i in range(3)], atol=1e-12)


def test_a_drive_of_one_joint_leaves_the_others_at_rest():
    drive = lambda m: mb.Motion("drive", m.rod1.theta - m.rod0.theta, 0.4 * mb.t)  # noqa: E731
    found = velocities(rods(3, drive, g=None).scene())
    assert_allclose([found[f"rod{i}.omega"] for i in range(3)], [0, 0.4, 0.4], atol=1e-12)


def test_a_wheel_rolls_with_its_cart_and_gears_turn_together():
    (wagon, rail), wheel = on_rail(), mb.Body("wheel", 1.0, 1.0)
    axle = mb.Revolute("axle", wagon.point(0, 0), wheel.point(0, 0))
    rolling = mb.System(wagon, wheel, rail, axle, mb.VelocityConstraint("rolling", (wheel.vx + 0.25 * wheel.omega,)))
    turning = gears(ratio=-0.5).system
    for system, rates in ((rolling, {"cart.vx": 1.0, "wheel.omega": -4.0}), (turning, {"a.omega": 4.0, "b.omega": -2})):
        for name, rate in rates.items():
            assert_allclose(values(mb.Scene(system, {name: rate}), *rates), [*rates.values()], atol=1e-12)


MASSES = np.array([1.0, 2.0, 0.5, 3.0])
PINS = np.array([[0, 0], [0, 1], [0.8, 1.7], [1.6, 1.2], [1.5, 0]])


def five_bar(speed=0.0, unit=1.0, listed="bar0.omega", value=1.0):
    """Four bars between five pins, the first and the last one on a wagon that moves at a speed; a pendulum on bar 2."""
    wagon, rail = on_rail("wagon", 5.0, unit**2)
    along = np.diff(PINS, axis=0) * unit
    lengths, angles = np.hypot(*along.T), np.arctan2(along[:, 1], along[:, 0])
    bars = [mb.Body(f"bar{k}", m, m * a**2 / 12) for k, (m, a) in enumerate(zip(MASSES, lengths, strict=True))]
    hanging = mb.Body("hanging", 1.0, 0.1 * unit**2)
    ends = [(bar.point(-a / 2, 0), bar.point(a / 2, 0)) for bar, a in zip(bars, lengths, strict=True)]
    pins = [mb.Revolute(f"pin{k + 1}", ends[k][1], ends[k + 1][0]) for k in range(3)]
    system = mb.System(
        wagon, *bars, hanging, rail,
        mb.Revolute("pin0", wagon.point(0, 0), ends[0][0]), *pins,
        mb.Revolute("pin4", wagon.point(*(PINS[4] * unit)), ends[3][1]),
        mb.Revolute("hook", bars[2].point(0, 0), hanging.point(0, 0.3 * unit)),
    )  # fmt: skip
    middles = (PINS[1:] + PINS[:-1]) / 2 * unit
    guess = {f"bar{k}.{c}": middles[k, i] for k in range(4) for i, c in enumerate("xy")}
    guess |= {f"bar{k}.theta": angles[k] for k in range(1, 4)}
    guess |= {"hanging.x": middles[2, 0], "hanging.y": middles[2, 1] - 0.3 * unit}
    return mb.Scene(system, {"bar0.theta": angles[0], "wagon.vx": speed * unit, listed: value}, guess=guess)


def rates_of_least_energy(pinned):
    """Angular velocities (4,) of the bars, `pinned` = (bar, rate), of least kinetic energy relative to the wagon.

    The pendulum rides on bar 2 and does not turn against it.
    """
    arms = np.stack([-np.diff(PINS, axis=0)[:, 1], np.diff(PINS, axis=0)[:, 0]])  # velocity of an end per rate
    H = np.zeros((4, 4))
    for k, m in enumerate(MASSES):
        V = np.zeros((2, 4))
        V[:, :k], V[:, k] = arms[:, :k], arms[:, k] / 2
        H += m * V.T @ V
        H[k, k] += m * (arms[:, k] @ arms[:, k]) / 12
    bar, rate = pinned
    C = np.vstack([arms, np.eye(4)[bar]])
    K = np.block([[H, C.T], [C, np.zeros((3, 3))]])
    return np.linalg.solve(K, [0, 0, 0, 0, 0, 0, rate])[:4]


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("speed", [0.0, 7.0])
@pytest.mark.parametrize("bar", [0, *(pytest.param(bar, marks=pytest.mark.long) for bar in (1, 3))])
def test_loops_move_with_least_kinetic_energy_relative_to_what_carries_them(unit, speed, bar):
    scene = five_bar(speed, unit, f"bar{bar}.omega", 1.3)
    omega = rates_of_least_energy((bar, 1.3))
    assert_allclose(values(scene, *[f"bar{k}.omega" for k in range(4)]), omega, rtol=1e-9, atol=1e-12)
    assert_allclose(values(scene, "hanging.omega", "wagon.vx"), [omega[2], speed * unit], rtol=1e-9)


def test_loops_on_a_moving_wagon_ride_along():
    found = velocities(five_bar(2.0, listed="wagon.omega", value=0.0))
    assert_allclose([v for name, v in found.items() if name.endswith("vx")], 2, atol=1e-12)
    assert_allclose([v for name, v in found.items() if not name.endswith("vx")], 0, atol=1e-12)


def test_start_velocities_have_derivatives_by_parameters():
    """A rod that turns on a cart of speed u, at angle a and of length l: omega = (w - u) / (l cos a) for a tip at w."""
    p = mb.Parameters(u=0.0, w=2.0, a=0.4, l=0.7)
    system = cart(length=2 * p.l, parameters=p)
    scene = mb.Scene(system, {"cart.vx": p.u, "rod.vx": p.w, "rod.theta": p.a})
    simulator = mb.DAESimulator(scene, mb.DormandPrince())
    at = simulator.start.dae.v_names.index("rod.omega") + simulator.start.dae.n_q
    P = np.array([[0.0, 2.0, 0.4, 0.7], [1.0, -1.0, 0.9, 2.0]])
    assert_allclose(simulator.start.states(P)[0][:, at], (P[:, 1] - P[:, 0]) / P[:, 3] / np.cos(P[:, 2]))
    u, w, a, length = P[1]
    omega = (w - u) / (length * np.cos(a))
    slopes = [-omega / (w - u), omega / (w - u), omega * np.tan(a), -omega / length]
    assert_allclose(simulator.start.jets(P[1], np.eye(4), 2)[1][:, at], slopes)


def test_a_listed_speed_that_vanishes_at_the_nominal_parameters_moves_what_it_must():
    """The weld turns with the rod that carries it, for every sample."""
    flag = mb.Body("flag", 1.0, 0.1)
    rod = pendulum(flag, lambda m: mb.Weld("weld", m.rod.point(0.5, 0), flag.point(0, 0)), length=0.5, g=None, w=0.0)
    start = mb.DAESimulator(rod.scene(start={"flag.omega": rod.p.w}), mb.DormandPrince()).start
    x, reasons = start.states(np.array([[*rod.p.values()][:-1] + [w] for w in (0.0, 3.0)]))
    assert reasons == ("", "")
    assert_allclose(x[:, start.dae.n_q + start.dae.v_names.index("rod.omega")], [0, 3], atol=1e-12)


def test_bodies_without_mass_start_as_well():
    link, bob = mb.Body("link", 0.0), mb.Body("bob", 1.0, pose=mb.Particle())
    system = mb.System(
        link, bob,
        mb.Revolute("hinge", GROUND.point(0, 0), link.point(0, 1)),
        mb.Spherical("end", link.point(0, -1), bob.point(0, 0)),
    )  # fmt: skip
    for start in ({"link.omega": 1.5}, {"bob.vx": 3.0}):
        assert_allclose(values(mb.Scene(system, start), "link.omega", "link.vx", "bob.vx"), [1.5, 1.5, 3], atol=1e-12)


@pytest.mark.parametrize("angle", [1e-2, 1e-3, 1e-4, 3e-5, 1e-6])
def test_a_parallelogram_starts_close_to_its_change_point(angle):
    """Its cranks turn alike and its coupler does not turn."""
    cranks = linkage(lengths=(1.0, 2.0, 1.0, 2.0))
    scene = cranks.scene(None, [0.0, 0.1], {"crank.theta": angle, "crank.omega": 1.0}, guess={"rocker.theta": angle})
    expected = [1, 1, 0, -np.sin(angle), np.cos(angle)]
    names = ("crank.omega", "rocker.omega", "coupler.omega", "coupler.vx", "coupler.vy")
    assert_allclose(values(scene, *names), expected, rtol=0, atol=1e-7)
    assert mb.DAESimulator(scene, mb.DormandPrince()).run(np.tile([*cranks.p.values()], (3, 1))).ok.all()
