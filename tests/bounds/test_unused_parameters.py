"""A parameter of the box on which nothing of a scene depends is a doubt about its bounds."""

import warnings

import numpy as np
import pytest
from black_boxes import black_box_bounds, quietly
from conftest import ALL_MODELS
from faults import warned
from machines import ball

import symmb as mb
from symmb.equations.model import unused_parameters

DOUBT = (
    "length is in the box, but nothing in the scene depends on length. "
    'Use the symbol p.length; p["length"] is a number.'
)


def pendulum(is_symbol, **more):
    """A hanging rod, built of the symbol of its length or of its nominal value."""
    p = mb.Parameters(length=1.0, other=0.1)
    L = p.length if is_symbol else p["length"]
    rod = mb.Body("rod", mass=1.0, inertia=L**2 / 12, pose=mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-L / 2, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    options = {"start": {"rod.theta": 0.0}, "outputs": {"tip": rod.point(L / 2, 0).y}, **more}
    return mb.Scene(system, times=np.linspace(0.0, 0.2, 5), box=mb.Box(length=(0.9, 1.1)), **options)


@pytest.mark.parametrize(
    "method", [mb.PolynomialChaos(), mb.Vertex(), mb.MonteCarlo(5), mb.Taylor(2), mb.TaylorModel()], ids=repr
)
def test_number_in_the_place_of_the_symbol_is_a_doubt(method):
    bounds = warned("nothing in the scene depends on ", mb.propagate, pendulum(False), method)
    assert bounds.doubts.count(DOUBT) == 1
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Check runs show errors", mb.SymmbWarning)  # of few samples
        assert DOUBT not in mb.propagate(pendulum(True), method).doubts


def test_limits_tolerances_and_comparisons_are_doubted():
    scene, limits = pendulum(False), {"tip": (-1.0001, None)}
    told = "nothing in the scene"
    assert "warning" in str(warned(told, mb.propagate, scene, mb.Vertex()).check(limits))
    assert DOUBT in warned(told, mb.tolerances, scene, limits).bounds.doubts
    compared = warned(told, mb.compare, scene, [mb.Vertex(), mb.Scanning(3)], reference=mb.Vertex())
    assert compared.doubts.count(DOUBT) == 1


def test_fixed_parameter_is_no_doubt():
    mb.propagate(pendulum(True), mb.Vertex(), mb.Box(length=(0.9, 1.1), other=(0.1, 0.1)))


def test_start_guess_and_outputs_count():
    scene = pendulum(True)
    p = scene.system.parameters
    others = [{name: {"rod.theta": p.other}} for name in ("start", "guess")]
    for options in ({}, *others, {"outputs": {"y": p.other}}):
        other = mb.Scene(scene.system, times=[0.0], **{"outputs": scene.outputs, **options})
        assert unused_parameters(other, ["length", "other"]) == (() if options else ("other",))


def test_states_events_and_held_values_count():
    elements = (
        lambda m: mb.State("level", rate=lambda z: m.p.rate - z),
        lambda m: mb.Impact("floor", m.ball.y - m.p.gap, restitution=m.p.e),
        lambda m: mb.Sampled("held", period=0.1, law=m.p.law * m.ball.y),
    )
    machine = ball(*elements, rate=1.0, begin=0.2, e=0.5, gap=0.1, law=2.0)
    scene = machine.scene("y", [0.0, 0.1], {"ball.y": 1.0, "level": machine.p.begin})
    assert unused_parameters(scene, machine.p) == ()


@pytest.mark.parametrize("model", ALL_MODELS, ids=lambda model: model.__name__)
def test_shipped_scenes_use_their_parameters(model):
    scene = model.scene()
    assert unused_parameters(scene, scene.box.names) == ()


def test_parameters_of_a_function_that_change_nothing_are_named():
    """The square of b is even, so that no polynomial of first degree sees it: it is not named."""
    box = dict.fromkeys("abc", (-1, 1))
    for method in (mb.PolynomialChaos(), mb.PolynomialChaos(order=1), mb.PolynomialChaos(order=2)):
        bounds = quietly(black_box_bounds, lambda a, b, c, d: a + b**2, method, **box, d=(0, 0))
        (told,) = [text for text in bounds.remarks if "no output" in text]
        assert told.startswith("c changes no output in the runs of the study")
