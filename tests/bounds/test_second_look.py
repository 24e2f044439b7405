"""Studies look at their nominal run and at one corner of the box in another way."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import symmb as mb
from models import double_pendulum
from symmb.simulation import DAESimulator

TIMES = np.linspace(0.0, 2.0, 41)


def wrong_simulator(at_nominal):
    """Outputs in coordinates of joints that are wrong at the nominal parameters, or at all others only."""
    simulator = DAESimulator(double_pendulum.scene().with_times(TIMES))
    form = simulator._joints
    x, p, t = (ca.SX.sym(name, form.y.numel_in(k)) for k, name in enumerate(("x", "p", "t")))
    y = form.y(x, p, t) + t * (1 if at_nominal else p[0] - simulator.dae.p_nominal[0])
    faulty = simulator._with(_joints=replace(form, y=ca.Function("y", [x, p, t], [y])))
    faulty._use(simulator.solver)
    return faulty


@pytest.mark.parametrize("method", [mb.Vertex(), mb.PolynomialChaos(), mb.Taylor(2), mb.MonteCarlo(20)], ids=repr)
@pytest.mark.parametrize("at_nominal", [True, False])
def test_what_is_wrong_in_one_way_is_a_doubt(method, at_nominal):
    simulator, box = wrong_simulator(at_nominal), mb.Box(l1=(0.95, 1.05), l2=(0.95, 1.05))
    where = "l1 = 1, l2 = 1" if at_nominal else "l1 = 1.05, l2 = 0.95"
    with pytest.warns(mb.SymmbWarning, match="exceed a thousandth of their range"):
        bounds = mb.propagate(simulator, method, box)
    assert sum(f"s and {where}, " in doubt and "CVODES" in doubt for doubt in bounds.doubts) == 1
    with pytest.warns(mb.SymmbWarning, match=where):
        assert any(where in doubt for doubt in mb.compare(simulator, method, box, reference=mb.Vertex()).doubts)


def test_right_studies_have_no_doubt():
    scene = double_pendulum.scene().with_times(TIMES)
    bounds = mb.propagate(scene, mb.PolynomialChaos())
    assert not bounds.doubts and not bounds.remarks
