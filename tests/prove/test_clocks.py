"""Proofs in which each set of parameters has its own clock: closed forms and samples are inside, faults are found."""

import numpy as np
import pytest
from enclosure_samples import check, ode
from scipy.special import ellipj, ellipk
from verified_problems import random_oscillator

import symmb as mb
from symmb.prove import clock, enclose, march, outputs, several_parameters
from symmb.prove.clock import bounds_by_clock
from symmb.prove.orders import with_orders
from symmb.prove.pass_outputs import half_step

INSIDE = 1e-11
"""Error of samples over the size of an output."""


def has_clock(problem, order=4):
    return clock.with_clock(with_orders(problem, order)[0]).clock is not None


def phasor(spread, end=20.0, count=41):
    """x = cos(w t), y = sin(w t) and z = w t with w = a + b + c."""

    def rates(x, p, t):
        w = p[0] + p[1] + p[2]
        return [-w * x[1], w * x[0], w]

    box = [(v - spread, v + spread) for v in (0.2, 0.3, 0.5)]
    return ode(rates, lambda p: [1.0, 0.0, 0.0], box, np.linspace(0.0, end, count))


def test_a_turning_phasor():
    """The parameters only delay it. Its range is that of a cosine, up to half a turn."""
    problem = phasor(0.015)
    assert has_clock(problem) and not has_clock(phasor(1e-4))
    found, t = enclose(problem, 4, 1), problem.times
    low, high = 0.955 * t, 1.045 * t
    phase = np.linspace(low, high, 4001)
    least, most = np.cos(phase).min(axis=0), np.cos(phase).max(axis=0)
    assert not found.why and found.boxes == 1
    assert (found.lower[:, 0] <= least + 1e-12).all() and (found.upper[:, 0] >= most - 1e-12).all()
    np.testing.assert_allclose(found.upper[:, 0] - found.lower[:, 0], most - least, atol=1e-3)


def test_a_swinging_rod():
    """A scene against Jacobi's elliptic functions, over seven periods."""
    p = mb.Parameters(length=1.0, g=9.81, angle=1.0)
    rod = mb.Body("rod", mass=1.0, inertia=p.length**2 / 12)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(0, p.length / 2))
    system = mb.System(rod, hinge, mb.Gravity(0, -p.g), parameters=p)
    times = np.linspace(0.0, 12.0, 25)
    box = mb.Box(length=(0.99, 1.01), g=(9.8, 9.82), angle=(0.99, 1.01))
    bounds = mb.propagate(mb.Scene(system, {"rod.theta": p.angle}, times, {"theta": rod.theta}, box), mb.TaylorModel(5))
    length, g, angle = (a[..., None] for a in np.meshgrid(*(np.linspace(*own, 9) for own in box.bounds), indexing="ij"))
    m = np.sin(angle / 2) ** 2
    sn = ellipj(ellipk(m) - np.sqrt(1.5 * g / length) * times, m)[0]
    theta = (2 * np.arcsin(np.sqrt(m) * sn)).reshape(-1, len(times))
    width = np.ptp(theta, axis=0)
    assert (bounds.lower[:, 0] <= theta.min(axis=0) + 1e-11).all()
    assert (bounds.upper[:, 0] >= theta.max(axis=0) - 1e-11).all()
    assert ((bounds.upper - bounds.lower)[:, 0] <= 1.02 * width + 1e-4).all()


@pytest.mark.parametrize("seed", [12, 20, 24])
def test_samples_of_random_oscillators_lie_inside(seed):
    problem = random_oscillator(seed, wide=True)
    assert has_clock(problem)
    found = enclose(problem, 4, 1)
    result = check(problem, found, 100, seed)
    assert not found.why and result.outside <= INSIDE and result.filled > 0.8


def _later(patch):
    """Places in a step are taken for those of 1 % later times."""
    right = several_parameters.places_in_step
    for module in (clock, outputs):
        patch.setattr(module, "places_in_step", lambda step, times, basis: right(step, 1.01 * times, basis))


@pytest.mark.parametrize(
    "plant",
    [
        _later,
        lambda patch: patch.setattr(clock, "half_step", lambda step, variable, side: half_step(step, variable, 1)),
        lambda patch: patch.setattr(march, "bounds_by_clock", lambda steps, *own: bounds_by_clock(steps[-1:], *own)),
    ],
    ids=["places", "halves", "steps"],
)
def test_planted_faults_are_found(plant, monkeypatch):
    """The parameters are in several steps at the last time, since their clocks differ by more than a step."""
    plant(monkeypatch)
    problem = phasor(0.01, 60.0, 41)
    assert check(problem, enclose(problem, 3, 1), 200).outside > 1e-6
