"""What the states of a run show must be among the passes and events that it made: faults are planted in these."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import symmb as mb
from symmb.run.events import Kinks
from symmb.run.integrate import compiled, multistep


def wheel(rate, level):
    """A wheel that turns evenly, and a particle that it pushes for a part of each turn."""
    body, rotor = mb.Body("body", 1.0, pose=mb.Particle()), mb.Body("rotor", 1.0, 0.1)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rotor.point(0, 0))
    act = ca.if_else(ca.cos(hinge.angle) < level, 1.0, 0.0) + ca.fmax(ca.sin(hinge.angle) - 0.5, 0)
    push = mb.Force("push", body.point(0, 0, 0), (act, 0, 0))
    start = {"hinge.angle": 0.0, "hinge.angle_rate": rate}
    return mb.Scene(mb.System(body, rotor, hinge, push), start, np.linspace(0, 5, 501), {"v": body.vx})


@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), mb.CVODES()], ids=repr)
@pytest.mark.parametrize(("rate", "level"), [(6.3, -0.9), (-2.1, 0.2), (11.0, -0.5)])
def test_a_pass_that_the_states_show_and_the_run_did_not_make_is_doubted(rate, level, solver, monkeypatch):
    assert not mb.simulate(wheel(rate, level), solver).doubts

    def without_one(stops):
        return stops._replace(passes=np.where(np.arange(stops.passes.shape[-1]) == 3, np.inf, stops.passes))

    of_engine, of_passes = compiled.stops_at, multistep.SwitchPasses.stops
    monkeypatch.setattr(compiled, "stops_at", lambda passes: without_one(of_engine(passes)))
    monkeypatch.setattr(multistep.SwitchPasses, "stops", lambda self, *of: without_one(of_passes(self, *of)))
    with pytest.warns(mb.SymmbWarning, match="passes a switch after t = .* no step of the run ended"):
        mb.simulate(wheel(rate, level), solver)


def test_values_that_are_rounding_are_on_no_side():
    x, p, t = ca.SX.sym("x", 2), ca.SX.sym("p", 0), ca.SX.sym("t")
    located = np.array([True, True])
    kinks = Kinks(("fabs",), ca.Function("switches", [x, p, t], [x]), located, located)
    times = np.linspace(0, 1, 101)
    X = np.column_stack([np.where(np.arange(101) < 50, 1.0, 1e-9 * (-1.0) ** np.arange(101)), times - 0.7051])
    values = kinks.values(X, np.empty(0), times)
    assert kinks.passed_over(values, times, np.empty(0)) == pytest.approx(0.70)
    assert np.isnan(kinks.passed_over(values, times, np.array([0.7051])))


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("height", [1.0, 1e-3])
def test_a_gap_below_0_is_doubted(restitution, height, monkeypatch):
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Gravity(0, -9.81), mb.Impact("floor", ball.y, restitution))
    scene = mb.Scene(system, {"ball.y": height}, np.linspace(0, 0.9 * np.sqrt(8 * height / 9.81), 5))
    assert not mb.simulate(scene).doubts

    def blind(self, x0, p, threads=1, real=compiled.CompiledIntegration.run):
        """The ball falls through the floor."""
        (run,) = real(self, x0, p, threads)
        y, v = height - 9.81 / 2 * self.times**2, -9.81 * self.times
        return [replace(run, X=np.column_stack([y, v, np.zeros_like(y)]), events=())]

    monkeypatch.setattr(compiled.CompiledIntegration, "run", blind)
    with pytest.warns(mb.SymmbWarning, match="gap of Impact 'floor' is -.* m at t = .*the run missed an impact"):
        mb.simulate(scene.with_times(scene.times))  # nothing is prepared for this one
