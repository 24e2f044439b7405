"""Motions that pass switches of the state, against closed forms and SciPy's integrators that restart at each pass."""

import warnings

import casadi as ca
import numpy as np
import pytest
import switch_proofs
from enclosure_samples import require_sharp
from scipy.interpolate import PchipInterpolator

import symmb as mb

TIMES = np.linspace(0.0, 1.0, 21)


def proved(law, start, nominal, box, order=6, times=TIMES):
    """Bounds of a mass of 1 kg, and the text of its doubts."""
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        scene = switch_proofs.mass(times, law, start, nominal)
        bounds = mb.propagate(scene, mb.TaylorModel(order=order), mb.Box(**box))
    return bounds, " ".join(bounds.doubts)


def test_a_force_that_begins_at_a_place():
    """x = v t up to a / v, and a constant force F from then on."""

    def law(p, x, v, t):
        return ca.if_else(x > p.a, -p.F, 0)

    bounds, text = proved(law, (0.0, 1.5), {"a": 0.5, "F": 2.0}, {"a": (0.48, 0.52), "F": (1.9, 2.1)})
    assert not text
    runs = []
    for a in np.linspace(0.48, 0.52, 33):
        for F in (1.9, 2.0, 2.1):
            late = np.maximum(TIMES - a / 1.5, 0.0)
            runs.append(np.stack([1.5 * TIMES - F * late**2 / 2, 1.5 - F * late, -F * (late > 0)], 1))
    require_sharp(bounds, runs, 1e-12, 2e-3)


def test_a_place_that_is_no_polynomial_of_the_parameter():
    """The time of the pass, exp(2 a) / 1.5, errs by more than all else: v = 1.5 - 4 (t - exp(2 a) / 1.5)."""
    law = lambda p, x, v, t: ca.if_else(x > ca.exp(2 * p.a), -4.0, 0)  # noqa: E731
    bounds, text = proved(law, (0.0, 1.5), {"a": -0.2}, {"a": (-0.3, -0.1)}, order=2, times=np.array([0.0, 0.9, 1.0]))
    assert not text
    a = np.linspace(-0.3, -0.1, 101)[:, None]
    late = bounds.t[1:] - np.exp(2 * a) / 1.5
    for k, runs in enumerate((1.5 * bounds.t[1:] - 2 * late**2, 1.5 - 4 * late)):
        assert (bounds.lower[1:, k] <= runs.min(axis=0)).all() and (runs.max(axis=0) <= bounds.upper[1:, k]).all()
        assert (bounds.upper[1:, k] - bounds.lower[1:, k] - np.ptp(runs, axis=0) < 2e-2).all()


def test_friction_that_reverses():
    """v = v0 - (3 + mu) t, and -(3 - mu) (t - t0) behind the reversal at t0."""
    bounds, text = proved(lambda p, x, v, t: -3.0 - p.mu * ca.sign(v), (0.0, 2.0), {"mu": 1.0}, {"mu": (0.95, 1.05)})
    assert not text
    runs = []
    for mu in np.linspace(0.95, 1.05, 201):
        t0 = 2.0 / (3.0 + mu)
        before, late = np.minimum(TIMES, t0), np.maximum(TIMES - t0, 0.0)
        place = 2.0 * before - (3 + mu) * before**2 / 2 - (3 - mu) * late**2 / 2
        runs.append(np.stack([place, 2.0 - (3 + mu) * before - (3 - mu) * late, -3.0 - mu * np.sign(t0 - TIMES)], 1))
    require_sharp(bounds, runs, 1e-12, 2e-3)


def test_a_law_of_time_that_parameters_move():
    bounds, text = proved(lambda p, x, v, t: ca.if_else(t > p.s, 1.0, 0.0), (0.0, 0.0), {"s": 0.4}, {"s": (0.37, 0.42)})
    assert not text
    runs = []
    for s in np.linspace(0.37, 0.42, 101):
        late = np.maximum(TIMES - s, 0.0)
        runs.append(np.stack([late**2 / 2, late, 1.0 * (late > 0)], 1))
    require_sharp(bounds, runs, 1e-12, 1e-3)


def test_knots_of_a_table():
    """A force that a monotone cubic through points gives, at t = 0.2 s and 0.6 s from one piece to the next."""
    places, forces = [-1.0, 0.3, 0.9, 2.0], [0.0, 0.0, 1.2, 0.1]
    table, curve = mb.Table(places, forces), PchipInterpolator(places, forces).antiderivative()
    bounds, text = proved(lambda p, x, v, t: p.k * table(1.5 * t), (0.0, 1.5), {"k": 1.0}, {"k": (0.9, 1.1)})
    assert not text
    v = (curve(1.5 * TIMES) - curve(0.0)) / 1.5  # k times it
    for k, found in ((0.9, bounds.lower[:, 1]), (1.1, bounds.upper[:, 1])):
        np.testing.assert_allclose(found, 1.5 + k * v, atol=1e-9)


def test_switches_that_are_passed_together():
    """Two laws of one place, written in different ways, and one of time at the same time."""

    def law(p, x, v, t):
        return ca.if_else(x > 0.5, p.F, 0) + ca.if_else(3 * x - 1.5 > 0, 1, 0) - ca.if_else(t > 0.5, 2, 0)

    bounds, text = proved(law, (0.0, 1.0), {"F": 2.0}, {"F": (1.9, 2.1)})
    assert not text
    late = np.maximum(TIMES - 0.5, 0.0)
    runs = [
        np.stack([TIMES + (F - 1) * late**2 / 2, 1 + (F - 1) * late, (F - 1) * (late > 0)], 1) for F in (1.9, 2, 2.1)
    ]
    inner = TIMES != 0.5
    assert (bounds.lower[inner] <= np.min(runs, axis=0)[inner] + 1e-12).all()
    np.testing.assert_allclose(bounds.lower[inner], np.min(runs, axis=0)[inner], atol=1e-9)
    np.testing.assert_allclose(bounds.upper[inner], np.max(runs, axis=0)[inner], atol=1e-9)


@pytest.mark.parametrize(
    ("law", "nominal", "box", "until", "message"),
    [
        # v = 1 - 2 t up to 0.5 s, when the friction holds the mass
        (lambda p, x, v, t: -1.0 - p.mu * ca.sign(v), {"mu": 1.5}, {"mu": (1.4, 1.6)}, 1 / 2.6, "m.vx"),
        # it is highest, x = 1 / (2 F), at the place of the spring for some F
        (lambda p, x, v, t: -p.F + ca.fmax(x - 0.5, 0), {"F": 1.0}, {"F": (0.98, 1.02)}, 0.9, "m.x"),
        # two places are one for some parameters
        (lambda p, x, v, t: (x > p.a) + ca.if_else(x > 0.5, 2, 0), {"a": 0.5}, {"a": (0.49, 0.51)}, 0.49, "(a-m.x)"),
    ],
    ids=["sticks", "grazes", "together"],
)  # fmt: skip
def test_what_is_not_passed_by_all_of_the_box_ends_the_proof(law, nominal, box, until, message):
    bounds, text = proved(law, (0.0, 1.0), nominal, box)
    finite = np.isfinite(bounds.upper).all(axis=1)
    np.testing.assert_array_equal(finite, (until - 0.1 < TIMES) & finite | (TIMES <= until - 0.1))
    assert finite[TIMES <= until - 0.1].all() and not finite[TIMES >= until + 0.15].any()
    assert "the equations have kinks or jumps" in text and message in text


def test_what_samples_do_not_see_is_not_proved():
    """A narrow band of a force, and a place that only a corner of the box reaches: no node lies in either."""
    band = lambda p, x, v, t: ca.if_else((x - 0.5) ** 2 < 1e-6, p.F, 0)  # noqa: E731
    bounds, text = proved(band, (0.0, 1.0), {"F": 200.0}, {"F": (190.0, 210.0)})
    for F in (190.0, 210.0):
        last = np.sqrt(1 + 2 * F * 2e-3)  # behind the band
        assert bounds.lower[-1, 1] <= last <= bounds.upper[-1, 1]
    assert "'(sq((m.x-0.5))-1e-06)' changes its sign once for the whole box" in text

    corner = lambda p, x, v, t: -p.F - 1000 * (x > 0.5095)  # noqa: E731
    bounds, text = proved(corner, (0.0, 1.0), {"F": 1.0}, {"F": (0.98, 1.02)})
    early = (1 - np.sqrt(1 - 2 * 0.98 * 0.5095)) / 0.98  # when the mass with 0.98 N comes there
    assert 0.9 < bounds.t[np.isfinite(bounds.upper[:, 0])][-1] <= early
    assert "(0.5095-m.x)" in text and "change its sign only for a part of the box" in text


@pytest.mark.parametrize(
    ("law", "v", "a"),
    [
        (lambda p, x, v, t: ca.if_else(t > 0, p.F, 0), 0.0, lambda F: F),
        (lambda p, x, v, t: p.F * ca.if_else(x > 0, 1, 2), 1.0, lambda F: F),
        (lambda p, x, v, t: p.F * ca.if_else(x > 0, 1, 2), -1.0, lambda F: 2 * F),
        (lambda p, x, v, t: 1.5 - p.F * ca.sign(v), 0.0, lambda F: 1.5 - F),
        (lambda p, x, v, t: p.F * ca.fmax(x, 0) * ca.if_else(t >= 0, 0, 1) + p.F * ca.sign(v), 0.5, lambda F: F),
    ],
    ids=["step", "up", "down", "slips", "two"],
)
def test_motions_that_begin_on_switches_and_leave_them(law, v, a):
    """x = v t + a t^2 / 2 at a time; at the first time an acceleration may be that of either side."""
    times = np.linspace(0.0, 0.45, 10)
    bounds, text = proved(law, (0.0, v), {"F": 1.0}, {"F": (0.9, 1.1)}, times=times)
    assert not text
    runs = [np.stack([v * times + a(F) * times**2 / 2, v + a(F) * times], 1) for F in (0.9, 1.0, 1.1)]
    for own, extreme in ((bounds.lower, np.min), (bounds.upper, np.max)):
        np.testing.assert_allclose(own[:, :2], extreme(runs, axis=0), atol=1e-12)
    known = np.sort([[a(0.9)], [a(1.1)]], axis=0)
    np.testing.assert_allclose([bounds.lower[1:, 2], bounds.upper[1:, 2]], known + 0 * times[1:])


def test_a_motion_that_sticks_at_the_start_is_not_proved():
    bounds, text = proved(lambda p, x, v, t: 0.5 - p.F * ca.sign(v), (0.0, 0.0), {"F": 1.0}, {"F": (0.9, 1.1)})
    assert "its value may be 0 when the motion begins" in text and not np.isfinite(bounds.upper[1:]).any()


@pytest.mark.parametrize("seed", [0, 1002, 8, 4])
def test_random_scenes_against_runs_that_restart(seed):
    """A draw of tests/benchmarks."""
    wrong, share, excess, _, text = switch_proofs.judged(seed, 20, order=5)
    assert not wrong and share == 1 and (excess < 0.05).all(), text
