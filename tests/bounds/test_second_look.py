"""Studies look at their nominal run and at one corner of the box in another way."""

import casadi as ca
import numpy as np
import pytest
from faults import warned
from scipy.special import ellipj, ellipk

import symmb as mb
from models import double_pendulum
from symmb.run.simulation import DAESimulator

TIMES = np.linspace(0.0, 2.0, 41)


def wrong_simulator(at_nominal):
    """Outputs in coordinates of joints that are wrong at the nominal parameters, or at all others only."""
    simulator = DAESimulator(double_pendulum.scene().with_times(TIMES))
    form = simulator.program.forms.joints
    x, p, t = (ca.SX.sym(name, form.y.numel_in(k)) for k, name in enumerate(("x", "p", "t")))
    y = form.y(x, p, t) + t * (1 if at_nominal else p[0] - simulator.dae.p_nominal[0])
    return simulator._by(simulator.program.with_outputs(ca.Function("y", [x, p, t], [y])))


@pytest.mark.parametrize("method", [mb.Vertex(), mb.PolynomialChaos(), mb.Taylor(2), mb.MonteCarlo(20)], ids=repr)
@pytest.mark.parametrize("at_nominal", [True, False])
def test_what_is_wrong_in_one_way_is_a_doubt(method, at_nominal):
    simulator, box = wrong_simulator(at_nominal), mb.Box(l1=(0.95, 1.05), l2=(0.95, 1.05))
    where = "l1 = 1, l2 = 1" if at_nominal else "l1 = 1.05, l2 = 0.95"
    bounds = warned("exceed a thousandth of their range", mb.propagate, simulator, method, box)
    assert sum(f"s and {where}, " in doubt and "CVODES" in doubt for doubt in bounds.doubts) == 1
    with pytest.warns(mb.SymmbWarning, match=where):
        assert any(where in doubt for doubt in mb.compare(simulator, method, box, reference=mb.Vertex()).doubts)


def test_right_studies_have_no_doubt():
    bounds = mb.propagate(double_pendulum.scene().with_times(TIMES), mb.PolynomialChaos())
    assert not bounds.doubts and not bounds.remarks


def swinging(amplitude, periods, spread):
    """A rod's scene, and the range of its angle (2, n_t) by Jacobi's elliptic functions."""
    p = mb.Parameters(l=1.0)
    rod = mb.Body("rod", 1.0, p.l**2 / 12, mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(0, p.l / 2))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    k = np.sin(amplitude / 2) ** 2
    times = np.linspace(0, periods * 4 * ellipk(k) / np.sqrt(1.5 * 9.81), 307)[:-3]
    box = mb.Box(l=(1 - spread, 1 + spread))
    scene = mb.Scene(system, start={"rod.theta": amplitude}, times=times, outputs={"angle": rod.theta}, box=box)
    lengths = np.linspace(1 - spread, 1 + spread, 201)[:, None]
    angles = 2 * np.arcsin(np.sqrt(k) * ellipj(ellipk(k) - np.sqrt(1.5 * 9.81 / lengths) * times, k)[0])
    return scene, np.array([angles.min(axis=0), angles.max(axis=0)])


def miss(bounds, truth):
    """The largest error over the largest width."""
    return np.abs(np.array(bounds["angle"]) - truth).max() / np.ptp(truth, axis=0).max()


@pytest.mark.parametrize("method", [mb.Vertex(), mb.PolynomialChaos()], ids=repr)
@pytest.mark.parametrize(("amplitude", "periods", "spread"), [(2.5, 90, 1e-6), (2.0, 150, 1e-7), (2.8, 60, 1e-6)])
def test_errors_of_runs_that_are_large_beside_the_width_are_a_doubt(method, amplitude, periods, spread):
    scene, truth = swinging(amplitude, periods, spread)
    bounds = warned(r"errors of angle exceed 2% of the width of their bounds: at t = ", mb.propagate, scene, method)
    assert miss(bounds, truth) > 0.02
    bounds = mb.propagate(scene, method, solver=mb.DormandPrince(rtol=1e-12))
    assert miss(bounds, truth) < 0.02 and not bounds.doubts
