"""Designs against closed forms, and against optimisers that try all corners of the tolerances."""

import itertools

import casadi as ca
import numpy as np
import pytest
from designs import outcome
from faults import refused
from scipy.optimize import differential_evolution

import symmb as mb

RATIOS = np.linspace(0.7, 1.3, 121)
MASS = 0.1
SIGNS = np.array([*itertools.product((-1.0, 0.0, 1.0), repeat=3)])


def amplitude(f: float, zeta: float, k: float) -> np.ndarray:
    """Amplitude of a mass 1 on a spring k with an absorber of mass MASS, over frequencies of an exciting force."""
    spring, damper = MASS * f**2, 2 * MASS * f * zeta
    coupling = spring + 1j * damper * RATIOS
    relative = coupling - MASS * RATIOS**2
    return np.abs(relative / ((k - RATIOS**2) * relative - MASS * RATIOS**2 * coupling))


ABSORBER = mb.FunctionSimulator(amplitude, {"f": 0.95, "zeta": 0.15, "k": 1.0}, RATIOS, ["amplitude"])
RANGES = {"f": (0.8, 1.0), "zeta": (0.08, 0.3)}
BOX = mb.Box(f=(0.93, 0.97), zeta=(0.12, 0.18), k=(0.95, 1.05))
HALF = np.array([0.02, 0.03, 0.05])


def worst_amplitude(x: np.ndarray, half: np.ndarray = HALF) -> float:
    return max(amplitude(*p).max() for p in np.array([*x, 1.0]) + half * SIGNS)


def test_den_hartogs_absorber():
    """Without tolerances the best absorber is that of Den Hartog, Mechanical Vibrations (1956), section 3.3."""
    found = mb.design(ABSORBER, RANGES, ("amplitude", "upper"))
    assert found.objectives["upper amplitude"] == pytest.approx(np.sqrt(1 + 2 / MASS), rel=5e-3)
    assert found.values["f"] == pytest.approx(1 / (1 + MASS), rel=2e-3)
    assert found.values["zeta"] == pytest.approx(np.sqrt(3 * MASS / (8 * (1 + MASS))), rel=1e-2)
    assert found.binding == () and not found.front and not found.factors


def test_an_absorber_with_tolerances_against_brute_force():
    found = mb.design(ABSORBER, RANGES, ("amplitude", "upper"), box=BOX)
    best = differential_evolution(worst_amplitude, [*RANGES.values()], seed=1, tol=1e-5, maxiter=40).fun
    own = worst_amplitude(np.array([*found.values.values()]))
    assert own < 1.01 * best and found.objectives["upper amplitude"] == pytest.approx(own, rel=5e-3)
    nominal = mb.design(ABSORBER, RANGES, ("amplitude", "upper"))
    assert own < 0.99 * worst_amplitude(np.array([*nominal.values.values()]))
    assert found.box.radius == pytest.approx(HALF) and found.box["k"] == (0.95, 1.05)
    assert found.bounds.nominal == pytest.approx(amplitude(**found.values, k=1.0)[:, None])
    assert found.runs < 600


def test_the_cheapest_tolerances_of_an_absorber_with_its_nominal_values():
    limits = {"amplitude": (None, 5.5)}
    found = mb.design(ABSORBER, RANGES, "cost", limits, BOX, costs={})
    factors = np.array([*found.factors.values()])
    own = worst_amplitude(np.array([*found.values.values()]), factors * HALF)
    assert found.check.kept and 5.45 < own < 5.5 and found.binding == ("The limit amplitude <= 5.5 is active.",)
    assert found.objectives["cost"] == pytest.approx((1 / factors).sum())

    def price(x: np.ndarray) -> float:
        excess = worst_amplitude(x[:2], np.exp(x[2:]) * HALF) - 5.5
        return np.exp(-x[2:]).sum() + 100 * max(excess, 0.0)

    ranges = [*RANGES.values(), *[(-1.0, 0.5)] * 3]
    assert found.objectives["cost"] < 1.01 * differential_evolution(price, ranges, seed=1, maxiter=60).fun


def test_no_design_satisfies_a_limit():
    none, goal = r"no design was found.*amplitude <= 5 is violated by 0.8", ("amplitude", "upper")
    refused(none, mb.design, ABSORBER, RANGES, goal, {"amplitude": (None, 5.0)}, BOX, error=mb.PropagationError)


def test_a_four_bar_as_a_path_generator_against_brute_force():
    """Outputs are squared distances from a path, which no four-bar follows exactly."""
    angles = np.linspace(0, 2 * np.pi, 37)
    nominal = {"crank": 0.3, "coupler": 0.9, "rocker": 0.8, "u": 0.5, "v": 0.4}
    half = dict.fromkeys(("coupler", "rocker"), 0.01) | {"crank": 0.004}

    def path(crank: float, coupler: float, rocker: float, u: float, v: float) -> np.ndarray:
        pin = crank * np.exp(1j * angles)
        base = 1.0 - pin
        cosine = (coupler**2 + abs(base) ** 2 - rocker**2) / (2 * coupler * abs(base))
        if (abs(cosine) > 1).any():
            raise ValueError("The four-bar does not close.")
        return pin + (u + 1j * v) * np.exp(1j * (np.angle(base) + np.arccos(cosine)))

    target = path(0.3, 0.95, 0.87, 0.45, 0.5) + 0.01 * np.exp(2j * angles) + 0.006 * np.exp(-1j * angles)
    ranges = {"coupler": (0.8, 1.1), "rocker": (0.75, 1.0), "u": (0.3, 0.7), "v": (0.3, 0.7)}

    def worst(x: np.ndarray) -> float:
        values = nominal | dict(zip(ranges, x, strict=True))
        try:
            runs = [
                path(**values | {name: values[name] + s * h for s, (name, h) in zip(signs, half.items(), strict=True)})
                for signs in SIGNS
            ]
        except ValueError:
            return 1.0
        return float((np.abs(np.array(runs) - target) ** 2).max())

    simulator = mb.FunctionSimulator(lambda **q: abs(path(**q) - target) ** 2, nominal, angles, ["error"])
    found = mb.design(simulator, ranges, ("error", "upper"), box=mb.Box.plus_minus(nominal, **half))
    best = differential_evolution(worst, [*ranges.values()], seed=1, tol=1e-7, maxiter=120, popsize=10)
    own = worst(np.array([*found.values.values()]))
    assert own < 1.01 * best.fun
    without = mb.design(simulator, ranges, ("error", "upper"))
    assert own < 0.9 * worst(np.array([*without.values.values()]))
    assert found.runs < 1500 and found.binding == ("rocker is at the lower end of its range.",)


def quarter_car() -> mb.Scene:
    """A quarter of a car with a bump stop drives over a bump. Coordinates are deviations from the equilibrium."""
    p = mb.Parameters(spring=22e3, damper=1.8e3, payload=80.0)
    car, wheel = mb.Body("car", 350 + p.payload, pose=mb.Particle()), mb.Body("wheel", 40.0, pose=mb.Particle())
    way, travel = 8.0 * mb.t - 0.4, wheel.y - car.y
    road = ca.if_else(ca.logic_and(way > 0, way < 2.0), 0.07 * ca.sin(np.pi * way / 2.0) ** 2, 0)
    force = p.spring * travel + p.damper * (wheel.vy - car.vy) + 150e3 * ca.fmax(travel - 0.03, 0)
    strut = mb.Force("up", car.point(0, 0), (0, force)), mb.Force("down", wheel.point(0, 0), (0, -force))
    tyre = mb.Force("tyre", wheel.point(0, 0), (0, 200e3 * (road - wheel.y)))
    box = mb.Box(spring=(20e3, 24e3), damper=(1.5e3, 2.1e3), payload=(0.0, 160.0))
    outputs = {"acceleration": force / (350 + p.payload), "travel": travel}
    system = mb.System(car, wheel, *strut, tyre, parameters=p)
    return mb.Scene(system, times=np.linspace(0, 0.8, 81), outputs=outputs, box=box, name="quarter car")


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_a_front_of_comfort_and_cost_of_a_suspension_with_a_bump_stop():
    scene, ranges = quarter_car(), {"spring": (10e3, 40e3), "damper": (0.8e3, 4e3)}
    found = mb.design(scene, ranges, [("acceleration", "upper"), "cost"], costs={"payload": None})
    simulator = mb.DAESimulator(scene)

    def worst(x: np.ndarray, factors: np.ndarray, signs: np.ndarray = SIGNS) -> float:
        P = np.array([*x, 80.0]) + np.array([2e3, 300.0, 80.0]) * np.array([*factors, 1.0]) * signs
        return float(simulator.run(P).Y[:, :, 0].max())

    assert tuple(simulator.parameters) == ("spring", "damper", "payload")
    points = [(point.objectives["upper acceleration"], point.objectives["cost"]) for point in found.front]
    assert len(points) == 5 and sorted(points) == points and sorted(points, key=lambda p: -p[1]) == points
    for point, (value, cost) in list(zip(found.front, points, strict=True))[1::3]:

        def at_cost(x: np.ndarray, cost: float = cost) -> float:
            factors = np.exp(x[2:]) * max(np.exp(-x[2:]).sum() / cost, 1.0)
            return worst(x[:2], factors) if (factors <= 4.001).all() else 50.0

        grid = np.linspace(-1, 1, 9)
        every = np.array([*itertools.product(grid, repeat=3)])
        assert worst([*point.values.values()], [*point.factors.values()], every) == pytest.approx(value, rel=5e-3)
        brute = differential_evolution(at_cost, [*ranges.values(), *[(-1.386, 1.386)] * 2], seed=1, maxiter=40)
        assert value < 1.01 * brute.fun
    assert found.runs <= 2300 and found.values in [point.values for point in found.front]
    nominal = mb.design(scene, ranges, ("acceleration", "upper"), box=mb.Box(payload=(80.0, 80.0)))
    robust = mb.design(scene, ranges, ("acceleration", "upper"))
    assert worst([*robust.values.values()], [1, 1]) < worst([*nominal.values.values()], [1, 1])


def test_lower_bounds_are_maximised_and_widths_minimised():
    """The lower bound of y = 4 - (a - b)^2 is best for a = 2. It is 2 for a = 3 - sqrt(2). The width of c a is a."""
    f = lambda a, b, c: [[4 - (a - b) ** 2, c * a]]  # noqa: E731
    hill = mb.FunctionSimulator(f, {"a": 1.0, "b": 2.0, "c": 0.0}, [0.0], ["y", "z"])
    box = mb.Box(b=(1.0, 3.0), c=(-0.5, 0.5))
    highest = mb.design(hill, {"a": (0.5, 5.0)}, ("y", "lower"), box=box)
    assert highest.values["a"] == pytest.approx(2, abs=1e-2) and highest.objectives["lower y"] == pytest.approx(3)
    narrow = mb.design(hill, {"a": (0.5, 5.0)}, ("z", "width"), {"y": (2.0, None)}, box)
    assert narrow.values["a"] == pytest.approx(3 - np.sqrt(2), abs=0.02) and narrow.check.kept
    assert narrow.binding == ("The limit 2 <= y is active.",)


def test_a_design_beside_failed_runs_and_in_a_narrow_valley():
    """Runs fail below a = 5, so the least (a - 1)^2 with a tolerance of 0.1 is near a = 5.1. The valley is at 4.2."""

    scene = mb.FunctionSimulator(lambda a: [[(a - 1) ** 2 if a >= 5 else np.nan]], {"a": 5.5}, [0.0], ["y"])
    found = mb.design(scene, {"a": (0.0, 6.0)}, ("y", "upper"), box=mb.Box(a=(5.4, 5.6)))
    assert 5.1 <= found.values["a"] < 5.2 and found.objectives["upper y"] < 1.05 * 4.2**2
    well = lambda a: [[1 - np.exp(-(((a - 4.2) / 0.15) ** 2)) - 0.5 * np.exp(-((a - 1) ** 2))]]  # noqa: E731
    valley = mb.FunctionSimulator(well, {"a": 1.0}, [0.0], ["y"])
    assert mb.design(valley, {"a": (0.0, 6.0)}, ("y", "upper")).values["a"] == pytest.approx(4.2, abs=1e-2)
    never, goal = mb.FunctionSimulator(lambda a: [[np.nan]], {"a": 1.0}, [0.0], ["y"]), ("y", "upper")
    all_fail = "design: 256 of 256 runs in the ranges fail"
    refused(all_fail, mb.design, never, {"a": (0.0, 6.0)}, goal, error=mb.PropagationError)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_a_kink_in_three_variables():
    """The worst distance from a point is best at this point. The tolerance of y then gives 0.08 + 0.08^2 / 2 + 0.2."""

    def distance(x: float, y: float, z: float) -> list[list[float]]:
        apart = np.array([x - 0.3, y + 0.4, z - 0.7])
        return [[np.abs(apart).max() + 0.5 * np.square(apart).sum() + 0.2]]

    own = mb.FunctionSimulator(distance, dict.fromkeys("xyz", 0.0), [0.0], ["distance"])
    found = mb.design(own, dict.fromkeys("xyz", (-1.0, 1.0)), ("distance", "upper"), box=mb.Box(y=(-0.08, 0.08)))
    assert found.objectives["upper distance"] == pytest.approx(0.08 + 0.08**2 / 2 + 0.2, rel=0.01)


def test_the_best_design_at_the_boundary_of_failed_runs():
    """Runs fail for x + y < 1. On this line, f = 1 - 3 y / 2 + 7 y^2 / 2 is least for y = 3 / 14."""

    def f(x: float, y: float) -> list[list[float]]:
        if x + y < 1:
            raise ValueError("No assembly.")
        return [[x**2 + 3 * y**2 + 0.5 * x * y]]

    own = mb.FunctionSimulator(f, {"x": 1.0, "y": 1.0}, [0.0], ["f"])
    found = mb.design(own, {"x": (0.0, 1.7), "y": (0.0, 1.7)}, ("f", "upper"))
    assert found.objectives["upper f"] == pytest.approx(1 - 9 / 56, rel=5e-3)


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize(("seed", "k"), [(0, 16), (0, 19), (0, 23), (1, 15)])
def test_random_designs_at_the_boundary_of_failed_runs(seed, k):
    excess, _, words = outcome(np.random.default_rng([seed, k]))
    assert excess < 0.01, words


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"variables": {}}, "variables must be ranges by name"),
        ({"variables": {"q": (1, 2)}}, "q"),
        ({"variables": {"f": (0.9, 0.9)}}, "the range of f has no width"),
        ({"variables": {"f": {0.9, 1.0}}}, r"ranges must be pairs \(lower, upper\), without choices"),
        ({"objective": ("amplitude", "up")}, "objective must be a pair such as"),
        ({"objective": ("speed", "upper")}, "speed"),
        ({"objective": "cost"}, "needs costs"),
        ({"limits": {"cost": (None, 3)}}, "'cost' needs costs"),
        ({"costs": {"q": None}}, "costs: no parameter 'q'"),
        ({"progress": 3}, "^progress must be a function"),
        ({"objective": [("amplitude", "upper")] * 2}, "the two objectives are the same"),
        ({"objective": "cost", "costs": {}}, "needs a limit of an output"),
        ({"costs": {}, "box": None}, "costs need a box"),
        ({"box": mb.Box(k=(1.1, 1.2))}, "k = 1 is outside of its interval"),
    ],
)
def test_wrong_arguments(change, message):
    given = {"variables": RANGES, "objective": ("amplitude", "upper"), "box": BOX} | change
    refused(message, mb.design, ABSORBER, **given)


@pytest.mark.parametrize(
    ("variables", "objective", "limits", "pattern"),
    [
        ({1: (0.0, 5.0)}, ("y", "upper"), None, "a name must be a text, got 1"),
        ({"a": (0.0, 5.0)}, np.array(["y", "upper"]), None, "objective must be a pair"),
        ({"a": (0.0, 5.0)}, ("y", np.arange(2)), None, "objective must be a pair"),
        ({"a": (0.0, 5.0)}, ("y", "upper"), 3.0, "limits must be a dictionary"),
        ({"a": (0.0, 5.0)}, ("y", "upper"), np.array([1.0, 2.0]), "limits must be a dictionary"),
    ],
)
def test_arguments_of_other_types_are_told_in_a_sentence(variables, objective, limits, pattern):
    f = mb.FunctionSimulator(lambda a, b: [[(a - b) ** 2]], {"a": 1.0, "b": 2.0}, [0.0], ["y"])
    refused(pattern, mb.design, f, variables, objective, limits, mb.Box(b=(1.0, 3.0)))
