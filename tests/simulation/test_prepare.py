"""What is prepared once: a scene remembers its equations, its solvers, and what was compiled for them."""

import gc
import importlib
import pickle
import weakref

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from small_scenes import particle

import symmb as mb
from symmb.run.formulations import Program, formulation


def rod(length=1.0):
    p = mb.Parameters(length=length, stiffness=40.0)
    ground = mb.Ground()
    body = mb.Body("rod", mass=p.length, inertia=p.length**3 / 12, pose=mb.Planar())
    hinge = mb.Revolute("hinge", ground.point(0, 0), body.point(-p.length / 2, 0))
    spring = mb.Spring("spring", ground.point(1, 1), body.point(p.length / 2, 0), p.stiffness, length=0.8)
    system = mb.System(body, hinge, spring, mb.Gravity(0, -9.81), parameters=p)
    box = mb.Box(length=(0.98, 1.02), stiffness=(36, 44))
    return mb.Scene(system, {"rod.theta": 0.0}, np.linspace(0, 1, 21), {"y": body.y}, box=box, name="rod")


@pytest.fixture
def derivations(monkeypatch):
    """Names of the scenes whose equations are derived, in order."""
    names, derive = [], formulation._formulations
    monkeypatch.setattr(formulation, "_formulations", lambda scene: names.append(scene.name) or derive(scene))
    return names


def test_equations_are_derived_once_whatever_is_asked(derivations):
    scene = rod()
    mb.simulate(scene)
    mb.simulate(scene, mb.IDAS(), {"length": 1.01}, check=True)
    mb.propagate(scene, mb.Vertex())
    mb.propagate(scene, mb.PolynomialChaos())
    mb.compare(scene, [mb.Vertex(), mb.Taylor(2)])
    repr(mb.DAESimulator(scene))
    assert derivations == ["rod"]


def test_prepared_scenes_are_taken_in_the_place_of_scenes(derivations, tmp_path):
    prepared = mb.prepare(rod(), mb.DormandPrince(rtol=1e-9))
    assert prepared is mb.prepare(prepared.scene, mb.DormandPrince(rtol=1e-9))
    run = mb.simulate(prepared, parameters={"length": 1.02})
    assert run.solver == "DormandPrince(rtol=1e-09)"
    assert_array_equal(run.values, mb.simulate(rod(), prepared.solver, {"length": 1.02}).values)
    assert mb.propagate(prepared, mb.Vertex()).evaluations == 4
    with pytest.warns(mb.SymmbWarning, match="neither an equilibrium nor a steady motion"):
        assert mb.linearize(prepared).frequencies.size
    mb.view(prepared, tmp_path / "rod.svg")
    for options in ({"solver": mb.CVODES()}, {"times": [0.0, 1.0]}, {"outputs": {}}):
        with pytest.raises(mb.DeclarationError, match="has its own solver, times, outputs and device"):
            mb.simulate(prepared, **options)


@pytest.mark.parametrize("solver", [None, mb.CVODES(), mb.DormandPrince(), mb.Rosenbrock(), mb.HHT(1e-3)], ids=repr)
def test_a_second_run_derives_and_compiles_nothing(solver, monkeypatch):
    scene = rod()
    first = mb.simulate(scene, solver, {"length": 1.01})

    def made(*arguments):
        raise AssertionError(f"{arguments[1:2]} is made anew")

    with monkeypatch.context() as patched:
        patched.setattr(ca.Function, "__init__", made)
        other = mb.simulate(scene, solver, {"stiffness": 41.0})
        again = mb.simulate(scene, solver, {"length": 1.01})
    assert_array_equal(again.x, first.x)
    assert again.reason == first.reason
    assert_array_equal(other.x, mb.simulate(rod(), solver, {"stiffness": 41.0}).x)  # whatever ran before


def test_runs_with_other_pulses_take_other_steps():
    pulse = lambda p, _: ca.exp(-(((mb.t - 0.5) / p.width) ** 2)) / (np.sqrt(np.pi) * p.width)  # noqa: E731
    scene = particle(pulse, [0.0, 100.0], {}, ("vx",), width=(0.1, 0.9))
    for solver in (mb.DormandPrince(), mb.CVODES()):
        assert mb.simulate(scene, solver)["vx"][-1] == pytest.approx(0.921350, abs=1e-5)  # (1 + erf(1)) / 2
        assert mb.simulate(scene, solver, {"width": 0.1})["vx"][-1] == pytest.approx(1.0, abs=1e-6)


def test_solvers_are_chosen_when_a_simulator_is_made(monkeypatch):
    simulator = mb.DAESimulator(rod())
    monkeypatch.setattr(Program, "runs", lambda *_: pytest.fail("a run is made"))
    assert repr(simulator) == "DAESimulator('rod', DormandPrince())"
    assert simulator.solver == mb.DormandPrince() and "a pilot run took" in simulator.reason
    assert simulator.setup_seconds > 0
    assert simulator.noise is None and not simulator.doubts


def test_what_is_prepared_has_taken_its_second_look(monkeypatch):
    prepared = mb.prepare(rod())
    monkeypatch.setattr(Program, "runs", lambda *_: pytest.fail("a run is made"))
    prepared.second_look()
    assert prepared.noise.shape == (1,) and 0 < prepared.noise[0] < 1e-6 and not prepared.doubts
    assert_array_equal(pickle.loads(pickle.dumps(prepared)).noise, prepared.noise)


def test_nothing_keeps_a_scene_alive_that_was_prepared():
    scene = rod()
    mb.simulate(scene)
    mb.propagate(scene, mb.Vertex())
    known = weakref.ref(scene)
    del scene
    gc.collect()
    assert known() is None


def test_copies_and_pickles_of_scenes_remember_nothing():
    scene = rod()
    simulator = mb.prepare(scene)
    assert not pickle.loads(pickle.dumps(scene)).memory and not scene.with_times([0.0, 1.0]).memory
    copy = pickle.loads(pickle.dumps(simulator))
    P = np.array([[1.01, 38.0]])
    assert_array_equal(copy.run(P).Y, simulator.run(P).Y)


@pytest.mark.parametrize("model", ["four_bar", "half_car", "six_axis_arm", "stick_slip"])
def test_models_run_again_with_what_was_prepared(model, monkeypatch):
    scene = importlib.import_module(f"models.{model}").scene()
    first = mb.simulate(scene)
    monkeypatch.setattr(ca.Function, "__init__", lambda *_: pytest.fail("a Function is made anew"))
    assert_array_equal(mb.simulate(scene).x, first.x)


@pytest.mark.parametrize("rate", [4e7, 9e8, 3e10])
def test_no_explicit_steps_are_tried_over_a_decay_beyond_their_limit(rate):
    """A damper of 1 s whose transient decays at a high rate, beside a spring: y = exp(-t) (1 + O(1 / rate))."""
    p = mb.Parameters(k=100.0, rate=rate)
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    force = mb.Force("damper", bob.point(0, 0), (-p.k * bob.x, -p.rate * (bob.vy + bob.y)))
    system = mb.System(bob, force, parameters=p)
    start = {"bob.x": 1.0, "bob.y": 1.0}
    prepared = mb.DAESimulator(mb.Scene(system, start, np.linspace(0, 1, 5), {"x": bob.x, "y": bob.y}))
    assert prepared.solver == mb.Rosenbrock() and "too fast for explicit steps" in prepared.reason
    assert "DormandPrince" not in prepared.reason
    (values,) = prepared.run([[90.0, rate]]).Y
    np.testing.assert_allclose(values.T, [np.cos(np.sqrt(90.0) * prepared.times), np.exp(-prepared.times)], atol=1e-6)
