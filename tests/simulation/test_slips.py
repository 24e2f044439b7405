"""What is given in the place of a scene, a box or a solver, and told with the remedy."""

import pytest
from faults import refused, warned
from mechanisms import explosion

import symmb as mb

SCENE = explosion()
BOX = mb.Box(a=(0.1, 0.2))


@pytest.mark.parametrize(
    ("solver", "message"),
    [
        ("cvode", "There is no solver 'cvode'. Did you mean 'cvodes'"),
        (mb.IDAS, "solver: got the class IDAS; call it"),
        (mb.Projection(), r"solver: Projection\(\) is not a Solver"),
    ],
)
def test_solvers(solver, message):
    refused(message, mb.simulate, SCENE, solver)
    refused(message, mb.propagate, SCENE, mb.Vertex(), BOX, solver=solver)


def test_systems_are_no_scenes_and_intervals_no_boxes():
    refused(r"Expected a Scene, got System. Scene\(system, times=...\)", mb.simulate, SCENE.system)
    refused(r"Expected a Scene or a simulator, got System. Scene\(", mb.propagate, SCENE.system, mb.Vertex(), BOX)
    refused(r"box: \{'a': \(0.1, 0.2\)\} is not a Box", mb.propagate, SCENE, mb.Vertex(), {"a": (0.1, 0.2)})
    refused("No box", mb.propagate, SCENE.with_box(None), mb.Vertex())


def test_a_failed_run_of_a_scene_tells_its_parameters_and_time_once():
    bounds = warned("1 of 2 runs failed", mb.propagate, SCENE, mb.Vertex(), mb.Box(a=(0.2, 1.0)), mb.CVODES(rtol=1e-9))
    assert str(bounds.failed[0]).startswith("t = 0.99")
    assert str(bounds.failed[0]).count("0.99") == 1
