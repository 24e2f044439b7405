"""What must hold for every shipped scene."""

from functools import cache
from importlib import import_module

import numpy as np
import pytest
from conftest import ALL_MODELS, SMOOTH_MODELS, but_long

import symmb as mb
from models import cubic, slider_crank_flexible
from symmb import Scanning, propagate

MOVING = [model for model in ALL_MODELS if model is not cubic]  # which has no bodies


def _name(model):
    return model.__name__.removeprefix("models.")


@cache
def scene_of(model):
    return model.scene()


@pytest.fixture(scope="module", params=MOVING, ids=_name)
def run(request):
    return mb.simulate(scene_of(request.param))


def test_constraints_hold(run):
    assert run.position_drift < 1e-5
    assert run.velocity_drift < 1e-5


def test_energy_balances(run):
    assert run.energy_drift < 1e-5


def test_mass_matrix_is_positive_definite(run):
    dae = run.program.bodies.dae
    M = dae.M(*dae.arguments(run.x[-1], dae.p_nominal, run.t[-1])).full()
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() > 0


def test_listed_start_holds(run):
    for name, value in run.scene.start.items():
        if name in run.program.bodies.dae.q_names and isinstance(value, float):
            assert run[name][0] == pytest.approx(value, rel=2e-16, abs=1e-15)  # sums of what joints do are rounded


@pytest.mark.filterwarnings("ignore:.*Check runs show errors:symmb.SymmbWarning")
@pytest.mark.parametrize("model", but_long(ALL_MODELS, slider_crank_flexible), ids=_name)
def test_box_runs_to_its_corners(model):
    scene = scene_of(model)
    few = scene.with_times(scene.times[:: max(1, len(scene.times) // 10)])
    result = propagate(few, Scanning(3))
    assert not result.failed
    assert (result.upper - result.lower).max() > 0


def test_smooth_models_are_those_without_impacts():
    assert SMOOTH_MODELS == tuple(model for model in ALL_MODELS if not scene_of(model).system.collected.impacts)


def test_scenes_are_modules_of_the_package():
    """In a wheel, in an editable installation and in a checkout."""
    assert isinstance(import_module("symmb.models.four_bar").scene(), mb.Scene)


@pytest.mark.parametrize("model", ALL_MODELS, ids=_name)
def test_module_tells_source_and_has_a_sketch(model):
    assert "Source: " in model.__doc__
    assert model.__doc__.count("\n    ") >= 4


INSTRUCTIONS = {
    "andrews": (1132, 1046), "car_axis": (206, 141), "chain": (435, 389), "double_pendulum": (152, 135),
    "four_bar": (320, 296), "heavy_top": (434, 280), "n_four_bar": (559, 522), "rolling_disc": (615, 338),
    "slider_crank": (251, 235), "slider_crank_spatial": (1601, 1253), "spherical_pendulum": (64, 37),
}  # fmt: skip
"""Of the right side and of the accelerations, before there were flexible bodies and contacts."""


@pytest.mark.parametrize("model", [m for m in ALL_MODELS if _name(m) in INSTRUCTIONS], ids=_name)
def test_what_a_scene_does_not_need_costs_nothing(model):
    dae = mb.compile_dae(scene_of(model).system)
    counts = dae.rhs.n_instructions(), dae.forward.n_instructions()
    assert all(count <= known for count, known in zip(counts, INSTRUCTIONS[_name(model)], strict=True))
