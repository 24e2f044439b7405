"""Proofs of mechanisms with loops against closed forms, and what proofs of starts and of frames rest on."""

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import loop_proofs
import numpy as np
import pytest
from _loops import FINE
from enclosure_samples import ode, require_sharp
from scipy.integrate import solve_ivp

import symmb as mb
from symmb.prove.errors import ProofError
from symmb.prove.flow import integrated
from symmb.prove.problem import StartEquations
from symmb.prove.start import first_front
from symmb.prove.time_step import TimeStep


def test_a_start_that_is_far_from_its_polynomials_is_not_proved():
    """exp(u) = 1 + p, whose approximate solution is off by 3: one step of Newton's method from it is 1 long."""
    u, p, t = (ca.SX.sym(name) for name in "upt")
    problem = ode(lambda x, p, t: [0 * x[0]], lambda p: [p[0]], [(-0.01, 0.01)], [0.0])
    start = StartEquations(
        ca.Function("residual", [u, p, t], [ca.exp(u) - 1 - p]),
        ca.Function("states", [u, p, t], [u]),
        lambda P: np.log1p(P) + 3.0,
    )
    with pytest.raises(ProofError, match="solution of the starting equations cannot be proved"):
        first_front(replace(problem, start=start), 4)


def test_an_approximate_inverse_of_a_frame_is_not_taken_as_exact():
    """C is off by a tenth of the inverse of B."""
    B = np.array([[1.0, 0.5], [0.0, 2.0]])
    C = np.diag([0.9, 1.1]) @ np.linalg.inv(B)
    problem = ode(lambda x, p, t: [0 * x[0], 0 * x[1]], lambda p: [0.0, 0.0], [(1.0, 1.0)], [0.0, 1.0])
    still, frame = (integrated(c, np.zeros((c.size, 2)), 1.0) for c in (np.zeros(2), B.ravel()))
    step = TimeStep(problem, 0.0, 1.0, still, frame, C[..., None])
    for y in ([1.0, 1.0], [1.0, 0.0], [0.0, 1.0]):
        assert (step.inverse_times(np.array(y)) >= np.abs(np.linalg.inv(B)) @ y).all()


def _told(found):
    return f"{found.kind}: outside by {found.outside:.1e}, {found.proved:.0%} proved, {found.fault} {found.refused}"


@pytest.mark.parametrize(
    "seed", [*(pytest.param(seed, marks=pytest.mark.long) for seed in (100, 115, 124)), 103, 106, 121, 125]
)
def test_random_mechanisms_against_closed_forms(seed):
    """Four-bars, slider-cranks and a parallelogram, free and driven."""
    found = loop_proofs.check(loop_proofs.random_case(seed), order=4, count=2)
    assert found.outside <= loop_proofs.INSIDE and not found.fault and not found.refused, _told(found)
    assert found.proved == 1.0 and found.ratio < 1.01, _told(found)


def test_a_slider_crank_that_locks_is_proved_until_then():
    """Without the test that a divisor does not vanish, its bounds are too narrow at the end (found by planting it)."""
    found = loop_proofs.check(loop_proofs.random_case(184), order=4, count=2)
    assert found.outside <= loop_proofs.INSIDE and not found.fault, _told(found)
    assert "infinite later" in found.refused and found.proved == 1.0, _told(found)


@pytest.mark.parametrize("seed", [102, 111, 113, 116, pytest.param(127, marks=pytest.mark.long)])
def test_boxes_with_parameters_without_a_start_are_not_proved(seed):
    """Starts at change points and beyond dead centres."""
    found = loop_proofs.check(loop_proofs.random_case(seed), order=4)
    assert not found.fault and found.refused, _told(found)


def test_a_pendulum_on_a_distance_turns_over():
    """Neither the velocity along x nor that along y determines the other everywhere. The reference is the angle's."""
    p = mb.Parameters(L=1.0, w=8.0)
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    link = mb.Distance("link", mb.Ground().point(0, 0), bob.point(0, 0), p.L)
    times, box = np.linspace(0.0, 0.9, 10), {"w": (7.99, 8.01)}
    scene = mb.Scene(
        mb.System(bob, link, mb.Gravity(0, -9.81), parameters=p), {"bob.x": 0.0, "bob.vx": p.w}, times,
        {"x": bob.x, "y": bob.y, "vx": bob.vx, "vy": bob.vy}, guess={"bob.y": -1.0}, box=mb.Box(**box),
    )  # fmt: skip
    runs = []
    for w in (7.99, 7.995, 8.0, 8.01):
        run = solve_ivp(lambda t, z: [z[1], -9.81 * np.sin(z[0])], (0, 0.9), [0.0, w], method="DOP853", rtol=FINE,
                        atol=1e-14, t_eval=times)  # fmt: skip
        angle, rate = run.y
        runs.append(np.stack([np.sin(angle), -np.cos(angle), rate * np.cos(angle), rate * np.sin(angle)], axis=1))
    assert np.ptp([run[:, 1] for run in runs]) > 1.9  # over the top
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=5)), runs, loop_proofs.INSIDE, 1e-5)


def test_sliders_on_a_rod_that_turns_evenly():
    """Two equal masses on rails along x and y: x = L cos(w t), y = L sin(w t), over dead centres of either."""
    p = mb.Parameters(L=1.0, w=3.0)
    a, b = mb.Body("a", 1.0, 0.1), mb.Body("b", 1.0, 0.1)
    system = mb.System(
        a, b, mb.Distance("rod", a.point(0, 0), b.point(0, 0), p.L),
        mb.Prismatic("along_x", mb.Ground().point(0, 0), a.point(0, 0), axis=(1, 0, 0)),
        mb.Prismatic("along_y", mb.Ground().point(0, 0), b.point(0, 0), axis=(0, 1, 0)), parameters=p,
    )  # fmt: skip
    times = np.linspace(0.0, 1.5, 7)
    scene = mb.Scene(system, {"a.x": p.L * np.cos(0.4), "a.vx": -p.L * p.w * np.sin(0.4)}, times,
                     {"x": a.x, "y": b.y, "vx": a.vx, "vy": b.vy}, guess={"b.y": 0.4},
                     box=mb.Box(L=(0.999, 1.001), w=(2.997, 3.003)))  # fmt: skip
    runs = []
    for L in (0.999, 1.0, 1.001):
        for w in (2.997, 3.0, 3.003):
            turn = 0.4 + w * times
            runs.append(L * np.stack([np.cos(turn), np.sin(turn), -w * np.sin(turn), w * np.cos(turn)], axis=1))
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=4)), runs, loop_proofs.INSIDE, 1e-5)


def _absolute_run(lengths, poses, rates, times, ground=9.81):
    """Slender bars of density 1 that are pinned in a row, and to the ground at both ends: (n_t, 9) poses.

    The ends of a row are the left end of its first bar, and the left end of its last one, whose right end is pinned to
    the bar before. Accelerations and forces in the pins follow from Newton's and Euler's laws.
    """
    M = np.diag(np.column_stack([lengths, lengths, lengths**3 / 12]).ravel())
    load = np.tile([0.0, -ground, 0.0], 3) * np.diag(M)

    def end(k, side, q, w):
        angle, J = q[3 * k + 2], np.zeros((2, 9))
        arm = side * lengths[k] / 2 * np.array([np.cos(angle), np.sin(angle)])
        J[:, 3 * k : 3 * k + 3] = [[1, 0, -arm[1]], [0, 1, arm[0]]]
        return J, -arm * w[3 * k + 2] ** 2

    def rate(t, z):
        q, w = np.split(z, 2)
        ends = [end(k, side, q, w) for k, side in ((0, -1), (0, 1), (1, -1), (1, 1), (2, 1), (2, -1))]
        pins = [ends[0], *((a[0] - b[0], a[1] - b[1]) for a, b in list(pairwise(ends))[1::2]), ends[-1]]
        J = np.vstack([pin[0] for pin in pins])
        K = np.block([[M, J.T], [J, np.zeros((8, 8))]])
        return np.concatenate([w, np.linalg.solve(K, np.concatenate([load, *(-pin[1] for pin in pins)]))[:9]])

    start = np.concatenate([poses, rates])
    return solve_ivp(rate, times[[0, -1]], start, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=times).y[:9].T


def test_a_four_bar_passes_dead_centres_of_all_of_its_bars():
    """The longest and the shortest bar are longer than the others (Grashof): no bar turns all the way."""
    values = {"a": 0.597, "b": 1.01, "c": 0.573, "d": 0.708, "rho": 1.0, "tilt": 0.842, "spin": 3.61, "k": 1.0}
    times, spread = np.linspace(0.0, 0.4, 9), 2e-4
    box = {"spin": (values["spin"] * (1 - spread), values["spin"] * (1 + spread))}
    case = loop_proofs.planar_case("four-bar", values, loop_proofs.loops._four_bar, loop_proofs._start, times, box,
                                   ("coupler", "C"))  # fmt: skip
    at = loop_proofs.loops.symbols(list(values))
    bars = loop_proofs.loops._four_bar(at.named, at.phi).bars.values()
    poses = ca.vertcat(*(ca.vertcat(*bar.pose) for bar in bars))
    start = ca.Function("start", [at.phi, at.p], [poses, ca.jacobian(poses, at.phi)])
    q, along = (part.full().ravel() for part in start(values["tilt"], list(values.values())))
    lengths = np.array([values[name] for name in "abc"])
    runs = np.array([_absolute_run(lengths, q, along * spin, times) for spin in np.linspace(*box["spin"], 3)])
    scene = replace(case.scene, outputs={name: case.scene.outputs[name] for name in ("theta", "x", "y")})
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=5)), runs[:, :, [5, 3, 4]], loop_proofs.INSIDE, 1e-5)
