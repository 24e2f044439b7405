"""A scene as C code that simulates the scene, and the data for users of this code."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from symmb._errors import DeclarationError
from symmb._units import units_of_parameters
from symmb.equations.model import Scene
from symmb.run.codegen import FixedStep, SceneSource
from symmb.run.events import time_switches
from symmb.run.integrate import CompiledSolver, Task
from symmb.run.simulation import DAESimulator, Subject, scene_of


@dataclass(frozen=True, eq=False)
class Exported:
    """A scene for programs without Python.

    Attributes
    ----------
    name : str
    source : SceneSource
    parameters, inputs, outputs, states : tuple of str
    units : tuple of str       units of the outputs, '' if not known
    parameter_units : dict     units of the parameters that have a unit
    tolerance : float          relative tolerance of adaptive steps; 0 for fixed steps
    """

    name: str
    source: SceneSource
    parameters: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    units: tuple[str, ...]
    parameter_units: Mapping[str, str]
    tolerance: float


def exported(subject: Scene | DAESimulator) -> Exported:
    """The C code of a scene. Pilot runs select its solver, as for studies. A prepared scene already has a solver.

    DeclarationError is raised if a part of the scene needs Python.
    """
    scene = scene_of(subject)
    if scene.figures:
        raise DeclarationError(
            f"{scene.name}: output {next(iter(scene.figures))!r} is a scalar output. Exported scenes need outputs "
            "over time. Leave this output out by scene.with_outputs(...)."
        )
    inputs, own = tuple(scene.system.inputs), Subject.of(subject)
    simulator = (Subject(scene.with_inputs(inputs), own.solver) if inputs else own).motion
    solver, form = simulator.solver, simulator.formulation
    dae = form.dae
    if not form.y.numel_in(0):
        raise DeclarationError(f"{scene.name} has no states. Only scenes with states are exported.")
    lanes = None
    if isinstance(solver, CompiledSolver):
        lanes = solver.lanes(Task(dae, simulator.times, form.y, start=form.start, alone=True))
    if lanes is None or (isinstance(lanes.control, FixedStep) and lanes.scheme is None):
        solvers = "DormandPrince(), EventDriven() or Rosenbrock()"
        raise DeclarationError(f"{solver!r} cannot be exported. Prepare the scene with {solvers}.")
    parameters, outputs = tuple(scene.system.parameters), tuple(simulator.outputs)
    switches = dae.remembered(time_switches, simulator.times)
    source = SceneSource(
        lanes=lanes,
        n_x=form.y.numel_in(0),
        nominal=dae.p_nominal,
        n_inputs=len(inputs),
        names=(*parameters, *inputs, *outputs),
        times=simulator.times,
        has_rates=lanes.scheme is None and not dae.n_r and dae.impacts is None and dae.sampling is None,
        stops=np.empty(0) if switches is None else switches.of_all_samples(),
        token=simulator.identity(),
    )
    states = (*dae.q_names, *dae.v_names, *dae.s_names)
    tolerance = getattr(solver, "rtol", None) or 0.0
    units = simulator.units, units_of_parameters(scene.system.parameters)
    return Exported(scene.name, source, parameters, inputs, outputs, states, *units, tolerance)
