"""Random inputs: the spectrum by Welch's method, a quarter car by Lyapunov's equation, a half car by SciPy's FFT."""

from typing import Any, cast

import casadi as ca
import numpy as np
import pytest
import scipy
from faults import refused, warned
from machines import ball

import symmb as mb
from symmb.run.simulation import Subject

STOP, GAP, HALF, SPEED = 3e5, 0.035, 1.3, 20.0
WINDOW = 1.0, None


def half_car(box=None, outputs=None, *, step=1 / 60, end=4.0, **options):
    """A half car with bump stops on a road of class C."""
    p = mb.Parameters(speed=SPEED, suspension=22e3, tyre=190e3, damper=1600.0, mass=690.0)
    body, road = mb.Body("body", mass=p.mass, inertia=1200.0), mb.RoadProfile("road", "C", **options)
    elements, travels = [body, road], []
    for name, x in (("front", HALF), ("rear", -HALF)):
        wheel, seat = mb.Body(name, mass=40.0, pose=mb.Particle()), body.point(x, 0)
        travels.append(travel := wheel.y - seat.y)
        strut = p.suspension * travel + p.damper * (wheel.vy - seat.vy) + STOP * ca.fmax(travel - GAP, 0)
        tyre = p.tyre * (road(p.speed * mb.t + x - HALF) - wheel.y)
        on_wheel = mb.Force(f"{name}_tyre", wheel.point(0, 0), (0, tyre - strut))
        elements += [wheel, mb.Force(f"{name}_strut", seat, (0, strut)), on_wheel]
    given = {"travel": mb.rms(travels[0], WINDOW), "hit": mb.probability(travels[0] >= GAP, WINDOW)}
    given |= {"peak": mb.percentile(mb.maximum(travels[0], WINDOW), 0.9)} if box is None else {}
    times = np.linspace(0.0, end, round(end / step) + 1)
    return mb.Scene(mb.System(*elements, parameters=p), times=times, outputs=outputs or given, box=box)


def averages(scene, solver=None):
    simulator = Subject.of(scene, solver).simulator
    return simulator.run(np.array([[*simulator.parameters.values()]])).Y[0, 0]


def heights(road, seeds, x):
    """Heights (n, m) of roads at the ways x (m,)."""
    height = ca.Function("height", [road.value, mb.t], [road(mb.t)])
    return np.array([height(seed, x[None]).full()[0] for seed in seeds])


def test_profiles_have_the_density_of_iso_8608():
    profiles = heights(mb.RoadProfile("road", "H"), range(32), np.arange(0, 800, 0.15))
    n, density = scipy.signal.welch(profiles, 1 / 0.15, nperseg=2048)
    for middle in (0.05, 0.1, 0.5, 1.0):
        octave = (n > middle / 2**0.5) & (n < middle * 2**0.5)
        exact = 16e-6 * 4.0**7 * (n[octave] / 0.1) ** -2.0
        assert density.mean(axis=0)[octave].sum() == pytest.approx(exact.sum(), rel=0.06)


def test_heights_are_gaussian():
    road, variance = mb.RandomInput("gust", lambda f: 1 / (1 + f**2), (0.1, 20.0)), np.arctan(20.0) - np.arctan(0.1)
    values = heights(road, range(1024), np.linspace(0, 40, 81))
    assert np.mean(values**2) == pytest.approx(variance, rel=1e-2)
    # Bounds of Kolmogorov's statistic for 1024 values with 1 % probability of error
    assert scipy.stats.kstest(values[:, 7] / variance**0.5, "norm").statistic < 1.63 / 32


def test_root_mean_squares_of_a_quarter_car_satisfy_lyapunovs_equation():
    sprung, unsprung, k, tyre, c = 300.0, 40.0, 22e3, 190e3, 1600.0
    body, wheel = (mb.Body(name, mass, pose=mb.Particle()) for name, mass in (("body", sprung), ("wheel", unsprung)))
    road = mb.RoadProfile("road", "C", (0.004, 8.0))
    force = k * (wheel.y - body.y) + c * (wheel.vy - body.vy)
    strut = mb.Force("strut", body.point(0, 0), (0, force))
    on_wheel = mb.Force("tyre", wheel.point(0, 0), (0, tyre * (road(SPEED * mb.t) - wheel.y) - force))
    outputs = {"travel": mb.rms(wheel.y - body.y, (4.0, None)), "acceleration": mb.rms(force / sprung, (4.0, None))}
    scene = mb.Scene(mb.System(body, wheel, road, strut, on_wheel), times=np.linspace(0, 8, 1281), outputs=outputs)
    # States: travel, speed of the body, deflection of the tyre, speed of the wheel. The road's rate is white noise.
    row = np.array([k, -c, 0, c]) / sprung
    A = np.array([[0, -1, 0, 1], row, [0, 0, 0, -1], [-k / unsprung, c / unsprung, tyre / unsprung, -c / unsprung]])
    noise = np.diag([0, 0, 256e-6 * 0.1**2 * (2 * np.pi) ** 2 * SPEED / 2, 0])
    X = scipy.linalg.solve_continuous_lyapunov(A, -noise)
    assert averages(scene) == pytest.approx(np.sqrt([X[0, 0], row @ X @ row]), rel=1e-3)


def test_a_half_car_hits_its_stops_as_often_as_with_fine_spectra():
    rng, step, period, n = np.random.default_rng(5), 2e-3, 40.0, 3000
    f = np.arange(round(period / step) // 2 + 1) / period
    inside = (f >= 0.011 * SPEED) & (f <= 2.83 * SPEED)
    sizes = np.sqrt(256e-6 * 0.01 * SPEED / np.where(inside, f, np.inf) ** 2 / period) / 2 * round(period / step)
    z = np.fft.irfft(sizes * (rng.standard_normal((n, len(f))) + 1j * rng.standard_normal((n, len(f))))).T
    lag = round(2 * HALF / SPEED / step)
    x, squares, peaks = np.zeros((8, n)), [], np.full(n, -np.inf)  # body, pitch, wheels, and their rates

    def rates(x, front, rear):
        travels, speeds = (x[2:4] - x[0] - np.outer([HALF, -HALF], x[1])), x[6:] - x[4] - np.outer([HALF, -HALF], x[5])
        struts = 22e3 * travels + 1600.0 * speeds + STOP * np.maximum(travels - GAP, 0)
        tyres = 190e3 * (np.array([front, rear]) - x[2:4])
        turn = HALF * (struts[0] - struts[1]) / 1200.0
        return np.array([*x[4:], struts.sum(axis=0) / 690.0, turn, *((tyres - struts) / 40.0)])

    for k in range(lag, lag + round(4.0 / step), 2):  # the classical Runge-Kutta method with steps of 4 ms
        roads = [(z[i], z[i - lag]) for i in (k, k + 1, k + 2)]
        h = 2 * step
        k1 = rates(x, *roads[0])
        k2 = rates(x + h / 2 * k1, *roads[1])
        k3 = rates(x + h / 2 * k2, *roads[1])
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + h * k3, *roads[2]))
        if k >= lag + 1.0 / step:
            travel = x[2] - x[0] - HALF * x[1]
            squares.append(np.mean(travel**2))
            peaks = np.maximum(peaks, travel)
    rms, hit, peak = averages(half_car())
    assert rms == pytest.approx(np.mean(squares) ** 0.5, rel=0.015)
    assert hit == pytest.approx(np.mean(peaks >= GAP), abs=4 * (hit / n + hit / 1024) ** 0.5)
    assert peak == pytest.approx(np.quantile(peaks, 0.9), rel=0.03)


def test_bounds_contain_the_averages_of_the_box():
    box = mb.Box(suspension=(20e3, 24e3), damper=(1400, 1800))
    scene = half_car(box, end=2.5, realizations=64)
    bounds, simulator = mb.propagate(scene), cast(Any, Subject.of(scene).simulator)
    U = np.array([(x, y) for x in (-1, 0.3, 1) for y in (-1, -0.2, 1)])
    P = np.tile([*simulator.parameters.values()], (len(U), 1))
    P[:, [1, 3]] = box.from_unit(U)
    Y = simulator.run(P).Y
    width = (Y.max(axis=0) - Y.min(axis=0))[0]
    assert np.all(abs(np.array([bounds.lower - Y.min(axis=0), bounds.upper - Y.max(axis=0)])) < 0.01 * width)
    assert any("standard errors travel" in remark for remark in bounds.remarks)


def test_errors_of_averages_are_those_of_other_roads():
    n = 256
    simulator = Subject.of(half_car(end=2.5, realizations=n)).simulator
    p, rng = [*simulator.parameters.values()], np.random.default_rng(3)
    samples = [np.column_stack([np.tile(p, (n, 1)), rng.integers(0, 2**20, n)]) for _ in range(16)]
    others = [simulator.runs.over_runs(P, n)[0] for P in samples]
    ratio = simulator.standard_errors / np.std(others, axis=0, ddof=1)
    assert np.all((ratio > 0.4) & (ratio < 3))


def test_single_runs_have_the_seed_as_an_input():
    outputs = {"travel": mb.rms(0.1 * ca.sin(mb.t)), "p": mb.percentile(mb.t, 0.25)}
    run = mb.simulate(half_car(outputs=outputs | {"tone": mb.psd(ca.sin(20 * np.pi * mb.t), 10.0)}))
    square = 0.01 * (0.5 - np.sin(8.0) / 16)
    assert [run["travel"], run["p"], run["tone"]] == pytest.approx([square**0.5, 1.0, 4 / 3], rel=1e-6)
    scene = half_car(realizations=3)
    own = scene.with_inputs(["road"])
    single = [mb.simulate(own, parameters={"road": seed})["travel"] for seed in range(3)]
    assert averages(scene, "dopri:1e-8")[0] == pytest.approx(np.mean(np.square(single)) ** 0.5, rel=1e-4)


def test_densities_of_outputs_are_those_of_the_input():
    gust, near = mb.RandomInput("gust", lambda f: 1 / (1 + f**2), (0.2, 12.0)), (1.5, 1.7, 1.9, 2.1, 2.3, 2.5)
    machine = ball(lambda m: (gust, mb.Force("push", m.at, (gust(mb.t) - m.ball.vx, 0))), g=None)
    speed, late = machine.ball.vx, (4.0, None)
    outputs = {f"psd {f}": mb.psd(speed, f, late) for f in near} | {"p95": mb.percentile(speed, 0.95, late)}
    *psd, p95 = averages(machine.scene(outputs, np.linspace(0, 12, 241)))

    def density(f):
        return 1 / (1 + f**2) / (1 + (2 * np.pi * f) ** 2)

    assert np.sum(psd) == pytest.approx(density(np.array(near)).sum(), rel=0.05)
    variance = scipy.integrate.quad(density, 0.2, 12.0)[0]
    assert p95 == pytest.approx(scipy.stats.norm.ppf(0.95) * variance**0.5, rel=0.02)


def test_faults_of_random_inputs_are_named():
    refused("no waves", mb.RoadProfile, "road", "C", (1.0, 1.0))
    refused("octaves", mb.RoadProfile, "road", "C", (1e-9, 1.0))
    refused("spectrum is -1 at", mb.RandomInput, "gust", lambda f: ca.SX(-1), (1.0, 2.0))
    for spectrum in (2.0, None, lambda f, width: 1 / f, lambda: 1.0):
        refused("frequency alone, got", mb.RandomInput, "gust", spectrum, (1.0, 2.0))
    refused("from 'A' to 'H'", lambda: mb.RoadProfile("road", "J"))
    refused("positive integer", lambda: mb.RoadProfile("road", "C", realizations=0))
    refused("does not change", lambda: mb.RoadProfile("road", "C")(3.0))
    refused("between 0 and 1", lambda: mb.percentile(mb.t, 95))
    refused("frequency must be", lambda: mb.psd(mb.t, 0.0))
    refused("input 'raod'", lambda: half_car().with_inputs(["raod"]))
    box = mb.Box(speed=(0.0, 20.0))
    refused("speed is 0 at speed = 0", lambda: mb.propagate(half_car(box)))
    refused("output over time", lambda: mb.propagate(half_car(box, {"t": mb.t})))
    refused("cannot compute", lambda: mb.live(half_car(mb.Box(speed=(10, 20))), "x.html"))
    coarse = half_car(mb.Box(damper=(1500, 1600)), step=0.05, realizations=4)
    warned("shortest wave", lambda: mb.propagate(coarse, mb.Vertex()))
