"""Contributions against closed forms and sums over dense grids."""

from dataclasses import replace
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pytest
from black_boxes import black_box_bounds, reloaded, unit_bounds
from faults import refused, warned

import symmb as mb
from models import double_pendulum
from symmb.bound.propagation import Study

T = np.array([0.0, 1.0, 2.0])


def bounds_of_products(method=None):
    products = lambda a, b: np.stack([1.0 + a + 3.0 * b * T, -a * b * T], axis=1)  # noqa: E731
    return black_box_bounds(products, method, T, "y product", nominal={"a": 0.5}, a=(0.0, 2.0), b=(-1.0, 1.0))


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_an_output_that_is_noise_takes_no_further_runs():
    """y = a + b t; z is 0.5 with noise of 1e-8."""
    noisy = lambda a, b: np.stack([a + b * T, 0.5 + 1e-8 * np.sin(1e6 * a + b * T)], axis=1)  # noqa: E731
    bounds = black_box_bounds(noisy, None, T, "y z", {"z": 3e-8}, a=(0.9, 1.1), b=(0.9, 1.1))
    found = bounds.contributions()
    assert found.runs == 0
    assert np.allclose(found.alone[:, 0], np.stack([0 * T + 0.2, 0.2 * T], axis=1), atol=1e-4)
    assert (found.alone[:, 1] <= 3e-8).all()


def bounds_of_stairs(d):
    return warned("", unit_bounds, lambda x: np.floor(3 * sum(x) + 0.01), d, mb.MonteCarlo(30))


def test_widths_come_from_runs_where_no_polynomial_is_good():
    """Stairs over five parameters: each alone goes from -3 to 3, all together from -15 to 15."""
    found = bounds_of_stairs(5).contributions(runs=10_000)
    assert found.runs > 0
    assert np.allclose(found.alone[0, 0], 6)
    assert np.allclose(found.saved[0, 0], 6, atol=found.saved_estimate[0, 0])


def test_contributions_are_shown_and_labelled(tmp_path):
    bounds = bounds_of_products()
    found = bounds.contributions()
    text = str(found)
    assert "do not sum to the full width" in text
    assert text.index("b  ") < text.index("a  ")  # the largest first
    assert found.to_xarray()["saved"].sel(time=2.0, output="y", parameter="b") == pytest.approx(12)
    assert len(found.to_pandas()) == 12
    assert "<table" in found._repr_html_()
    for figure in (found.plot(tmp_path / "c.png"), found.plot(time=1.0), found.plot(outputs="y")):
        assert figure.axes
        plt.close(figure)
    assert np.array_equal(reloaded(bounds, tmp_path / "b.npz").contributions().saved, found.saved)


def test_pieces_are_kept_in_files(tmp_path):
    bounds = unit_bounds(lambda x: abs(x[0] - 0.3) + x[1], 2)
    assert len(bounds.surrogate.expansions) > 1
    for suffix in ("npz", "json"):
        again = reloaded(bounds, tmp_path / f"b.{suffix}")
        kept, own = again.contributions(), bounds.contributions()
        assert np.array_equal(kept.alone, own.alone) and np.array_equal(kept.saved, own.saved)
        assert (kept.errors >= own.errors).all()  # runs, which files cannot make, give smaller errors


def test_bounds_without_polynomials_from_a_file_tell_so(tmp_path):
    bounds = bounds_of_products(mb.Vertex())
    refused("has no polynomials", reloaded(bounds, tmp_path / "b.npz").contributions)
    refused("have no box", reloaded(bounds, tmp_path / "b.csv").contributions)


def test_taylor_of_the_double_pendulum_contributes_as_runs_do():
    scene = double_pendulum.scene()
    found = mb.propagate(scene, mb.Taylor(2), mb.Box(l1=(0.99, 1.01), l2=(0.99, 1.01))).contributions()
    runs = mb.sweep(scene, {"l1": np.linspace(0.99, 1.01, 21)})
    width = np.ptp(runs["x2"], axis=0)
    k = found.names.index("x2")
    assert (np.abs(found.alone[:, k, 0] - width) <= found.estimate[:, k] + 1e-3 * width.max()).all()


@pytest.mark.parametrize("method", [mb.Taylor(1), mb.PolynomialChaos(order=1), mb.PolynomialChaos.paper(1)], ids=repr)
def test_contributions_of_first_order(method):
    found = mb.propagate(double_pendulum.scene(), method, mb.Box(l1=(0.999, 1.001))).contributions()
    assert np.allclose(found.alone[..., 0], found.width, atol=2 * found.estimate.max())


def test_progress_tells_how_many_further_studies_there_are(monkeypatch):
    labels, own = [], Study.range
    monkeypatch.setattr(Study, "range", lambda self, box, label, n: labels.append(label) or own(self, box, label, n))
    bounds_of_stairs(3).contributions(runs=10_000)
    assert labels == [f"contributions, further study {k + 1} of {len(labels)}" for k in range(len(labels))] and labels


def test_widths_of_an_arm_that_meets_a_stop_have_small_errors():
    """Polynomials of the full box are poor. Studies of one parameter, and of all parameters but one, are not."""
    p = mb.Parameters(length=0.4, rate=2000.0, free=0.15, torque=11.0, payload=1.5, stop=np.pi / 3)
    arm, load = mb.Body("arm", 1.2, 0.1 * p.length**2), mb.Body("load", p.payload, 1e-4 * p.payload)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), arm.point(-p.length / 2, 0))
    grip = mb.Weld("grip", arm.point(p.length / 2, 0), load.point(0, 0))
    motor = mb.Actuator("motor", hinge, p.torque - 0.8 * hinge.angle_rate)
    pull = mb.Ground().point(-0.05, 0.2), arm.point(0.1 - p.length / 2, 0)
    spring = mb.Spring("spring", *pull, p.rate, length=p.free)
    stop = mb.Stop("stop", hinge, upper=p.stop, law=mb.KelvinVoigt(2000.0, 20.0))
    system = mb.System(arm, load, hinge, grip, motor, spring, stop, mb.Gravity(0, -9.81), parameters=p)
    reaches, tip = hinge.angle >= p.stop, arm.point(p.length / 2, 0)
    outputs = {
        "peak": mb.maximum(system.force("stop")),
        "arrival": mb.first_time(reaches),
        "speed": mb.value_at(hinge.angle_rate, reaches),
        "tip": tip.y,
    }
    box = mb.Box.plus_minus(p, length=5e-4, rate="10%", free=2e-3, torque="5%", payload=0.2, stop=0.0087)
    scene = mb.Scene(system, {"hinge.angle": -0.6}, np.linspace(0, 1.2, 61), outputs, box)
    bounds = mb.propagate(scene, mb.PolynomialChaos(seconds=60.0))
    found = bounds.contributions()
    assert 0 < found.runs <= bounds.evaluations // 2
    assert (found.errors[0, 0, :3] < 0.01 * found.width[0, :3, None]).all()
    assert (found.errors[1, 0, :3] < 0.1 * found.width[0, :3, None]).all()
    own = mb.propagate(scene, mb.PolynomialChaos(tolerance=1e-3), mb.Box(rate=box["rate"]))
    off = np.abs(found.alone[0, :3, 1] - (own.upper - own.lower)[0, :3])
    assert (off <= found.errors[0, 0, :3, 1] + 1e-3 * found.width[0, :3]).all()


def test_contributions_below_their_error_are_told():
    found = bounds_of_products().contributions()
    assert "may be zero" not in str(found) + found._repr_html_()
    errors = np.zeros((2, 3, 2, 2))
    errors[0, 2, 0, 1], errors[1, 2, 0] = 13.0, (3.0, 13.0)
    rough = replace(found, errors=errors)
    told = "Contributions that are smaller than their estimated errors may be zero."
    assert told in str(rough) and told in rough._repr_html_()
    assert "may be zero" not in rough.some_as_html([0], {0: 1})
    assert "may be zero" not in rough.some_as_html([1], {})


@pytest.mark.parametrize("seed", range(4))
def test_told_errors_of_widths_are_right_and_of_their_size(seed):
    """Water that runs out of a vessel: y = (sqrt(h) - c t / 2)^2, against corners, since y is monotonic."""
    rng = np.random.default_rng(seed)
    spread, t = rng.uniform(0.05, 0.3, 3), np.linspace(0.0, 1.5, 16)

    def level(h, c, f):
        return ((np.sqrt(h) - c * t / 2) ** 2 + np.exp(-4 * f * np.abs(t - 0.7)))[:, None]

    box = {name: (1 - s, 1 + s) for name, s in zip("hcf", spread, strict=True)}
    found = black_box_bounds(level, mb.PolynomialChaos(tolerance=0.03), t, **box).contributions()
    ends = np.stack([1 - spread, 1 + spread])
    for k in range(3):
        alone = np.abs(np.subtract(*(level(*np.where(np.arange(3) == k, end, 1.0)) for end in ends)))[:, 0]
        face = [level(*np.where(np.arange(3) == k, 1.0, corner)) for corner in product(*ends.T)]
        saved = found.width[:, 0] - np.ptp(face, axis=0)[:, 0]
        assert (np.abs(found.alone[:, 0, k] - alone) <= found.errors[0, :, 0, k] + 1e-9).all()
        assert (np.abs(found.saved[:, 0, k] - saved) <= found.errors[1, :, 0, k] + 1e-9).all()
    assert (found.errors.max(axis=(0, 2, 3)) <= 0.15 * found.width.max()).all()


FEW_RUNS = {
    "narrow peak": (lambda a, b, c: 1 / (1 + 400 * (a - 0.37) ** 2) + 0.1 * b * c + 0.02 * c, (0.999, 0, 0.04)),
    "jump": (lambda a, b, c: (a > 0.2) + 0.1 * b + 0 * c, (1.0, 0.2, 0.0)),
    "creases": (lambda a, b, c: np.abs(a - 0.2 * b) + 0.3 * np.maximum(b, c), (1.0, 0.5, 0.3)),
}
"""Functions, and the true widths of their parameters alone over [-1, 1]."""


@pytest.mark.parametrize("name", FEW_RUNS)
def test_errors_of_contributions_by_few_runs_hold(name):
    f, alone = FEW_RUNS[name]
    simulator = mb.FunctionSimulator(lambda **p: np.array([f(**p)]), dict.fromkeys("abc", 0.0), [0.0], ["y"])
    bounds = mb.propagate(simulator, mb.PolynomialChaos(), mb.Box(**dict.fromkeys("abc", (-1, 1))))
    axis = np.linspace(-1, 1, 81)
    Y = f(*np.meshgrid(axis, axis, axis, indexing="ij"))
    faces = [np.ptp(np.take(Y, 40, axis=i)) for i in range(3)]
    for runs in (None, 0, 10, 18, 22, 60, 100, 150, 300):
        found = bounds.contributions(runs=runs)
        assert found.runs <= (bounds.evaluations // 2 if runs is None else runs)
        assert (np.abs(found.alone - alone) <= found.errors[0] + 1e-3).all()
        assert (np.abs(found.saved - (np.ptp(Y) - faces)) <= found.errors[1] + 0.02).all()
        assert (found.alone <= found.width[..., None]).all()


def test_contributions_of_one_parameter_need_no_runs():
    jump = mb.FunctionSimulator(lambda a: np.array([float(a > 0.123)]), {"a": 0.0}, [0.0], ["y"])
    found = mb.propagate(jump, mb.PolynomialChaos(), mb.Box(a=(-1, 1))).contributions()
    assert found.runs == 0 and found.alone == pytest.approx(1.0) and found.saved == pytest.approx(1.0)
    assert found.errors.max() < 1e-3 and "do not sum" not in str(found)
