"""Bounds of oscillations over many periods, against closed forms and dense samples."""

import casadi as ca
import numpy as np
import pytest
from black_boxes import black_box_bounds, rms
from machines import spring_mass
from small_scenes import particle

import symmb as mb


def assert_bounds(bounds, lower, upper, tolerance=2e-3):
    """Bounds and estimate are within a fraction of the width of closed forms (n_t,)."""
    own, width = [bounds.lower[:, 0], bounds.upper[:, 0]], rms(upper - lower)
    error = np.abs(np.subtract(own, [lower, upper])).max(axis=0)
    assert rms(error) < tolerance * width
    assert rms(bounds.estimate) < 1e-2 * width
    assert not bounds.doubts


def ranges_of_waves(phase):
    """Smallest and largest cosine (n_t,) between two phases, each (n_t,)."""
    low, high = phase
    even, odd = (np.ceil((low - shift) / (2 * np.pi)) * 2 * np.pi + shift <= high for shift in (0.0, np.pi))
    ends = np.cos([low, high])
    return np.where(odd, -1.0, ends.min(axis=0)), np.where(even, 1.0, ends.max(axis=0))


@pytest.mark.parametrize("periods", [30, 1000])
def test_an_oscillator_has_the_bounds_of_its_closed_form(periods):
    """x = cos(w t), with 3 % uncertain rate w = sqrt(k / m). The number of runs is the same for all horizons."""
    t = np.linspace(0.0, periods, 20 * periods)
    x = lambda k, m: np.cos(2 * np.pi * np.sqrt(k / m) * t)  # noqa: E731
    bounds = black_box_bounds(x, None, t, k=(0.97, 1.03), m=(0.97, 1.03))
    ends = np.sqrt([0.97 / 1.03, 1.03 / 0.97])
    lower, upper = ranges_of_waves(2 * np.pi * np.outer(ends, t))
    assert_bounds(bounds, lower, upper)
    assert bounds.evaluations < 50


def test_amplitudes_and_decay_count_beside_the_phase():
    """x = a exp(-c t) cos(w t): the envelope is that of the largest a and the smallest c."""
    t = np.linspace(0.0, 100.0, 3001)
    x = lambda a, c, w: a * np.exp(-c * t) * np.cos(w * t)  # noqa: E731
    bounds = black_box_bounds(x, None, t, a=(0.9, 1.1), c=(0.008, 0.012), w=(5.7, 6.3))
    low, high = ranges_of_waves(np.outer([5.7, 6.3], t))
    ends = np.array([0.9 * np.exp(-0.012 * t), 1.1 * np.exp(-0.008 * t)])
    lower, upper = np.minimum(*(ends * low)), np.maximum(*(ends * high))
    assert_bounds(bounds, lower, upper)
    assert bounds.evaluations < 80


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_smaller_tolerances_do_not_increase_errors():
    """x oscillates between springs with a gap. The time of a turn is that of a half cycle and of the free way."""
    law = lambda p, mass: -p.k * (ca.fmax(mass.x - p.gap, 0) + ca.fmin(mass.x + p.gap, 0))  # noqa: E731
    t = np.linspace(0.0, 30.0, 1501)
    scene = particle(law, t, {"mass.x": 0.1}, k=(95, 105), gap=(0.02, 0.04))
    k, gap = (each.ravel()[:, None] for each in np.meshgrid(np.linspace(95, 105, 41), np.linspace(0.02, 0.04, 81)))
    w = np.sqrt(k)
    quarter, free = np.pi / 2 / w, 2 * gap / ((0.1 - gap) * w)
    turns, s = np.divmod(t, 2 * quarter + free)
    away = np.where(s < quarter, gap + (0.1 - gap) * np.cos(w * s), gap - (0.1 - gap) * w * (s - quarter))
    back = -gap - (0.1 - gap) * np.sin(w * (s - quarter - free))
    x = np.where(s < quarter + free, away, back) * np.where(turns % 2 == 0, 1.0, -1.0)
    lower, upper = x.min(axis=0), x.max(axis=0)
    for tolerance in (1e-2, 1e-3, 1e-4):
        assert_bounds(mb.propagate(scene, mb.PolynomialChaos(tolerance=tolerance)), lower, upper)


def test_a_large_tolerance_takes_no_more_runs():
    t = np.linspace(0.0, 30.0, 1501)
    x = lambda k: np.exp(-0.1 * t) * np.cos(np.sqrt(k - 0.01) * t)  # noqa: E731
    methods = [mb.PolynomialChaos(tolerance=tolerance) for tolerance in (0.1, 0.01)]
    large, small = (black_box_bounds(x, method, t, k=(90, 110)).evaluations for method in methods)
    assert large <= small


def test_a_long_horizon_of_a_scene_takes_as_many_runs_as_a_short_one():
    """A nonlinear oscillator (Duffing) without damping, whose mass and stiffness are known to 5 %."""
    machine = spring_mass(lambda m: mb.Force("cubic", m.at, (-m.p.k3 * m.ball.x**3, 0)), stiffness=100.0, k3=200.0)
    p, x, v = machine.p, machine.ball.x, machine.ball.vx
    outputs = {"x": x, "energy": p.mass * v**2 / 2 + p.stiffness * x**2 / 2 + p.k3 * x**4 / 4}
    box = mb.Box.around({"mass": 1.0, "stiffness": 100.0, "k3": 200.0}, 0.05)
    evaluations = list[int]()
    for end in (20.0, 80.0):
        times = np.linspace(0.0, end, int(30 * end) + 1)
        bounds = mb.propagate(machine.scene(outputs, times, {"ball.x": 0.3}, box=box), mb.PolynomialChaos())
        evaluations.append(bounds.evaluations)
        late = times > end / 2  # phases differ by more than a cycle
        np.testing.assert_allclose(bounds.upper[late, 0], 0.3, atol=1e-3)  # the start is the amplitude
        np.testing.assert_allclose(bounds.lower[late, 0], -0.3, atol=1e-3)
        energies = [p["stiffness"] * s * 0.3**2 / 2 + p["k3"] * s * 0.3**4 / 4 for s in (0.95, 1.05)]
        np.testing.assert_allclose([bounds.lower[:, 1].min(), bounds.upper[:, 1].max()], energies, rtol=1e-5)
        assert not bounds.doubts and "phase" in bounds.range_of
    assert max(evaluations) < 160  # a first grid takes 137


def test_two_frequencies_are_no_phase():
    """A beat of two frequencies has no regular cycles. Its study is the usual one."""
    t = np.linspace(0.0, 20.0, 801)
    x = lambda w: np.cos(w * t) + 0.9 * np.cos(1.35 * w * t)  # noqa: E731
    bounds, values = black_box_bounds(x, None, t, w=(5.4, 6.6)), x(np.linspace(5.4, 6.6, 20001)[:, None])
    assert "phase" not in bounds.range_of
    beyond = np.maximum(bounds.lower[:, 0] - values.min(axis=0), values.max(axis=0) - bounds.upper[:, 0])
    assert (beyond <= bounds.estimate[:, 0] + 1e-2).all()


def test_a_kink_of_the_amplitude_is_in_the_estimate():
    """The amplitude is limited in half of the box, which a polynomial misses."""
    t = np.linspace(0.0, 60.0, 1801)
    bounds = black_box_bounds(lambda a, w: np.minimum(a, 1.0) * np.cos(w * t), None, t, a=(0.5, 1.5), w=(5.7, 6.3))
    late = t > 20.0
    error = np.maximum(np.abs(bounds.upper - 1.0), np.abs(bounds.lower + 1.0))[late]
    assert (error <= bounds.estimate[late] + 1e-2).mean() > 0.99


@pytest.mark.parametrize(
    "form",
    [
        lambda a, b, w, t: [(1 + 0.5 * (a - a**3) + 0.1 * b) * np.cos(w * t), 0 * t],
        lambda a, b, w, t: [(1 - 0.2 * ((a - 0.35) ** 2 + (b - 0.5) ** 2)) * np.cos(w * t), 0 * t],
        lambda a, b, w, t: [np.cos(w * t), np.exp(-(((a - 0.5) / 0.3) ** 2)) + 0 * t],
        lambda a, b, w, t: [np.exp(10 * (np.cos(w * t) - 1)), (1 + 0.1 * a) * t],
        lambda a, b, w, t: [np.cos((w + 0.15 * a) * t - 1.4 * np.pi * a), b * t],
    ],
    ids=["cubic amplitude", "amplitude inside", "peak of another output", "pulse", "start at other phases"],
)
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_runs_are_within_bounds_and_estimate(form):
    t = np.linspace(0.0, 50.0, 1201)
    box = {"a": (-1, 1), "b": (-1, 1), "w": (5.7, 6.3)}
    bounds = black_box_bounds(lambda a, b, w: np.transpose(form(a, b, w, t)), None, t, "x y", **box)
    rng = np.random.default_rng(0)
    samples = mb.Box(**box).from_unit(np.clip(rng.uniform(-1.2, 1.2, (10000, 3)), -1.0, 1.0))
    Y = np.stack([np.array(form(a, b, w, t)) for a, b, w in samples])
    width = rms((bounds.upper - bounds.lower)[:, 0])
    missed = np.maximum(bounds.lower.T - Y.min(axis=0), Y.max(axis=0) - bounds.upper.T) - bounds.estimate.T
    assert (missed > 5e-3 * np.where(np.arange(2)[:, None] == 0, width, 1.0)).mean() < 2e-3


def test_a_driven_oscillator_near_resonance_reaches_small_tolerances():
    """The driven and the free oscillation have different frequencies, so that there is no phase."""
    t, decay, drive = np.linspace(0.0, 100.0, 501), 0.025, 10.2

    def x(k):
        k = np.asarray(k)[..., None]
        w, driven = np.sqrt(k - decay**2), np.exp(1j * drive * t) / (k - drive**2 + 2j * decay * drive)
        start, rate = -driven[..., :1].imag, -drive * driven[..., :1].real
        free = start * np.cos(w * t) + (rate + decay * start) / w * np.sin(w * t)
        return driven.imag + np.exp(-decay * t) * free

    method = mb.PolynomialChaos(tolerance=1e-3, seconds=600.0)
    bounds = black_box_bounds(x, method, t, nominal={"k": 100.0}, k=(95, 112))
    dense = x(np.linspace(95, 112, 6001))
    assert_bounds(bounds, dense.min(axis=0), dense.max(axis=0))
    assert rms(bounds.estimate) < 1.1e-3 * rms(bounds.upper - bounds.lower) and bounds.evaluations < 400
