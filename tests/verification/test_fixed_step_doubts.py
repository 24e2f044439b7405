"""Fixed steps that are too long change the energy, and a run tells it."""

import casadi as ca
import numpy as np
import pytest

import symmb as mb


@pytest.mark.parametrize(("length", "damping"), [(0.6, 0.0), (1.0, 0.0), (1.0, 0.05)])
@pytest.mark.parametrize(
    "solver", [mb.Newmark, mb.BDFI3, mb.NSTIFFSI2, mb.GeneralizedAlpha, mb.HHT], ids=lambda solver: solver.__name__
)
@pytest.mark.filterwarnings("ignore:.*energy drifts:symmb.SymmbWarning")
def test_runs_that_are_visibly_wrong_are_doubted(solver, length, damping):
    """A pendulum that falls from its side, free and in oil, in steps of four lengths, against another solver."""
    rod = mb.Body("rod", 1.0, length**2 / 3, mb.Planar())
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(-length / 2, 0))
    oil = mb.Torque("oil", rod, -damping * rod.omega)
    scene = mb.Scene(mb.System(rod, pin, oil, mb.Gravity(0, -9.81)), times=np.linspace(0, 5, 51))
    right = mb.simulate(scene, mb.CVODES(rtol=1e-10)).values
    told = {}
    for step in (0.1, 0.05, 0.02, 5e-4):
        run = mb.simulate(scene, solver(step))
        error = np.abs(run.values - right).max() / np.ptp(right)
        told[error] = any("Use shorter steps" in doubt for doubt in run.doubts)
        assert error < 0.04 or told[error]
        assert error > 0.005 or not told[error]
    assert len(set(told.values())) == 2


@pytest.mark.parametrize(
    ("solver", "period", "share"),
    [
        pytest.param(solver, *jumps, marks=() if i == k else pytest.mark.long)
        for i, solver in enumerate((mb.GeneralizedAlpha, mb.HHT, mb.NSTIFFSI2))
        for k, jumps in enumerate([(0.02, 0.35), (0.05, 0.2), (0.013, 0.5)])
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
@pytest.mark.filterwarnings("ignore:.*The equations switch:symmb.SymmbWarning")
def test_steps_that_pass_over_many_jumps_are_doubted(solver, period, share):
    """A motor on pulses, against runs whose steps end at them."""
    rotor = mb.Body("rotor", 1.0, 0.02, mb.Planar())
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), rotor.point(0, 0))
    pulses = ca.if_else(ca.fmod(mb.t, period) < share * period, 1.0, 0.0)
    system = mb.System(rotor, pin, mb.Torque("motor", rotor, pulses - 0.1 * rotor.omega))
    scene = mb.Scene(system, times=np.linspace(0, 1, 101), outputs={"omega": rotor.omega})
    right = mb.simulate(scene, mb.DormandPrince(rtol=1e-12)).values
    for step in (0.3 * period * share, 1e-4):
        run = mb.simulate(scene, solver(step))
        error = np.abs(run.values - right).max() / np.ptp(right)
        told = any("of the steps" in doubt for doubt in run.doubts)
        assert told if error > 0.01 else error > 0.001 or not told
