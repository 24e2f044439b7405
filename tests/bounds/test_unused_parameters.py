"""A parameter of the box on which nothing of a scene depends is a doubt about its bounds."""

import warnings

import numpy as np
import pytest
from conftest import ALL_MODELS

import symmb as mb
from symmb.equations.model import unused_parameters

DOUBT = (
    "length is in the box, but nothing in the scene depends on length. "
    'Use the symbol p.length; p["length"] is a number.'
)
BOX = mb.Box(length=(0.9, 1.1))


def pendulum(is_symbol, **more):
    """A hanging rod, built of the symbol of its length or of its nominal value."""
    p = mb.Parameters(length=1.0, other=0.1)
    L = p.length if is_symbol else p["length"]
    rod = mb.Body("rod", mass=1.0, inertia=L**2 / 12, pose=mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-L / 2, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    options = {"start": {"rod.theta": 0.0}, "outputs": {"tip": rod.point(L / 2, 0).y}, **more}
    return mb.Scene(system, times=np.linspace(0.0, 0.2, 5), box=BOX, **options)


METHODS = [mb.PolynomialChaos(), mb.Vertex(), mb.MonteCarlo(5), mb.Taylor(2), mb.TaylorModel()]


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_number_in_the_place_of_the_symbol_is_a_doubt(method):
    with pytest.warns(mb.SymmbWarning, match="nothing in the scene depends on "):
        bounds = mb.propagate(pendulum(False), method)
    assert bounds.doubts.count(DOUBT) == 1
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Check runs show errors", mb.SymmbWarning)  # of few samples
        assert DOUBT not in mb.propagate(pendulum(True), method).doubts


def test_limits_tolerances_and_comparisons_are_doubted():
    scene, limits = pendulum(False), {"tip": (-1.0001, None)}
    with pytest.warns(mb.SymmbWarning, match="nothing in the scene"):
        assert "warning" in str(mb.propagate(scene, mb.Vertex()).check(limits))
    with pytest.warns(mb.SymmbWarning, match="nothing in the scene"):
        assert DOUBT in mb.tolerances(scene, limits).bounds.doubts
    with pytest.warns(mb.SymmbWarning, match="nothing in the scene"):
        assert mb.compare(scene, [mb.Vertex(), mb.Scanning(3)], reference=mb.Vertex()).doubts.count(DOUBT) == 1


def test_fixed_parameter_is_no_doubt():
    mb.propagate(pendulum(True), mb.Vertex(), mb.Box(length=(0.9, 1.1), other=(0.1, 0.1)))


def test_start_guess_and_outputs_count():
    scene = pendulum(True)
    p = scene.system.parameters
    for options in (
        {},
        {"start": {"rod.theta": p.other}},
        {"guess": {"rod.theta": p.other}},
        {"outputs": {"y": p.other}},
    ):
        other = mb.Scene(scene.system, times=[0.0], **{"outputs": scene.outputs, **options})
        assert unused_parameters(other, ["length", "other"]) == (() if options else ("other",))


def test_states_events_and_held_values_count():
    p = mb.Parameters(rate=1.0, begin=0.2, e=0.5, gap=0.1, law=2.0, mass=1.0, g=9.81)
    ball = mb.Body("ball", mass=p.mass, pose=mb.Particle())
    state = mb.State("level", rate=lambda z: p.rate - z)
    floor = mb.Impact("floor", ball.y - p.gap, restitution=p.e)
    held = mb.Sampled("held", period=0.1, law=p.law * ball.y)
    system = mb.System(ball, mb.Gravity(0, -p.g), state, floor, held, parameters=p)
    scene = mb.Scene(system, {"ball.y": 1.0, "level": p.begin}, [0.0, 0.1], {"y": ball.y})
    assert unused_parameters(scene, p) == ()


@pytest.mark.parametrize("model", ALL_MODELS, ids=lambda model: model.__name__)
def test_shipped_scenes_use_their_parameters(model):
    scene = model.scene()
    assert unused_parameters(scene, scene.box.names) == ()


def test_parameters_of_a_function_that_change_nothing_are_named():
    """The square of b is even, so that no polynomial of first degree sees it: it is not named."""
    function = mb.FunctionSimulator(lambda a, b, c, d: [a + b**2], dict.fromkeys("abcd", 0.0), [0.0], ["y"])
    box = mb.Box(a=(-1, 1), b=(-1, 1), c=(-1, 1), d=(0, 0))
    for method in (mb.PolynomialChaos(), mb.PolynomialChaos(order=1), mb.PolynomialChaos(order=2)):
        with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
            (told,) = [text for text in mb.propagate(function, method, box).remarks if "no output" in text]
        assert told.startswith("c changes no output in the runs of the study")
