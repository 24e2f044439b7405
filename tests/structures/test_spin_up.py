"""The spin-up beam against a geometrically exact one, and what its modes can show at best."""

import numpy as np
import pytest
from problems import read

import symmb as mb
from models import spin_up_beam

KNOWN = read("spin_up_beam")


@pytest.mark.parametrize(("count", "largest"), [(3, 1e-3), (5, 1e-3)])
def test_the_tip_is_within_a_millimetre_of_the_exact_beam(count: int, largest: float) -> None:
    run = mb.simulate(spin_up_beam.scene(count=count), times=KNOWN["times"])
    exact = np.array(KNOWN["exact"])
    for name, column in (("u1", 0), ("u2", 1), ("tip_x", 2), ("tip_y", 3)):
        assert np.abs(run[name] - exact[:, column]).max() < largest
    assert run["u2"].min() == pytest.approx(KNOWN["least_u2"], abs=1e-3)
    assert run["u1"][-1] == pytest.approx(KNOWN["last_u1"], abs=1e-3)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_as_many_modes_show_what_galerkin_s_method_does(count: int) -> None:
    run = mb.simulate(spin_up_beam.scene(count=count), times=KNOWN["times"])
    assert run["u2"] == pytest.approx(np.array(KNOWN["galerkin_u2"][str(count)]), abs=2e-5)


def test_without_foreshortening_it_diverges() -> None:
    """Centrifugal forces overcome the first mode's stiffness at 3.8 rad/s, which the root reaches at 9 s."""
    scene = spin_up_beam.scene(count=3, stiffening=False)
    with pytest.warns(mb.SymmbWarning, match="'beam': it turns at .* at t = 12 s, which is 1.5 times its first"):
        bend = np.abs(mb.simulate(scene, times=[0.0, 4.0, 12.0])["u2"])
    assert bend[1] < 0.4 and bend[2] > 10
