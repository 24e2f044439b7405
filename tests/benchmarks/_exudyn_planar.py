"""Planar scenes of bodies, revolute joints, gravity, springs and torques in exudyn, by generalised-alpha."""

import time
from collections.abc import Callable

import casadi as ca
import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    LoadForceVector,
    LoadTorqueVector,
    MarkerBodyPosition,
    MarkerBodyRigid,
    NodeRigidBody2D,
    ObjectConnectorSpringDamper,
    ObjectGround,
    ObjectJointRevolute2D,
    ObjectRigidBody2D,
)

import symmb as mb

Run = Callable[[int], tuple[np.ndarray, float]]


def planar(scene: mb.Scene) -> Run:
    """steps -> (x, y, angle of every body's centre of mass at the end (n_bodies, 3), seconds of the solver alone)."""
    system = scene.system
    p = np.array(list(system.parameters.values()))
    start = mb.simulate(scene.with_times(scene.times[:1]), mb.CVODES())

    def number(expression: object) -> np.ndarray:
        return np.array(ca.Function("f", [system.p], [ca.densify(ca.SX(expression))])(p)).ravel()

    def build() -> tuple[exu.SystemContainer, exu.MainSystem, list[int]]:
        container = exu.SystemContainer()
        mbs = container.AddSystem()
        ground = mbs.AddObject(ObjectGround())
        objects, nodes = {}, []
        for body in system.bodies:
            x, y, angle, vx, vy, omega = (
                float(start[f"{body.name}.{c}"][0]) for c in ("x", "y", "theta", "vx", "vy", "omega")
            )
            nodes.append(
                mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[x, y, angle], initialVelocities=[vx, vy, omega]))
            )
            mass, inertia = float(number(body.mass)[0]), float(number(body.inertia)[0])
            made = ObjectRigidBody2D(nodeNumber=nodes[-1], physicsMass=mass, physicsInertia=inertia)
            objects[body.name] = mbs.AddObject(made)

        def marker(point: mb.declare.mechanics.body.Point, kind: type = MarkerBodyPosition) -> int:
            s = number(point.s)
            on = objects.get(point.body.name, ground)
            return mbs.AddMarker(kind(bodyNumber=on, localPosition=[s[0], s[1], 0.0]))

        for element in system.elements:
            if isinstance(element, mb.Revolute):
                ends = [marker(element.point_a), marker(element.point_b)]
                mbs.AddObject(ObjectJointRevolute2D(markerNumbers=ends))
            elif isinstance(element, mb.Gravity):
                for body in system.bodies:
                    at = mbs.AddMarker(MarkerBodyPosition(bodyNumber=objects[body.name]))
                    weight = float(number(body.mass)[0]) * number(ca.vertcat(element.gx, element.gy))
                    mbs.AddLoad(LoadForceVector(markerNumber=at, loadVector=[*weight, 0.0]))
            elif isinstance(element, mb.SpringDamper):
                mbs.AddObject(
                    ObjectConnectorSpringDamper(
                        markerNumbers=[marker(element.point_a), marker(element.point_b)],
                        stiffness=float(number(element.stiffness)[0]),
                        referenceLength=float(number(element.length)[0]),
                    )
                )
            elif isinstance(element, mb.Torque):
                at = mbs.AddMarker(MarkerBodyRigid(bodyNumber=objects[element.body.name]))
                torque = [0.0, 0.0, float(number(element.torque)[0])]
                mbs.AddLoad(LoadTorqueVector(markerNumber=at, loadVector=torque))
            elif element not in system.bodies:
                raise TypeError(f"no counterpart of {element!r}")
        mbs.Assemble()
        return container, mbs, nodes

    def run(steps: int) -> tuple[np.ndarray, float]:
        _container, mbs, nodes = build()  # which must outlive the run
        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = steps
        settings.timeIntegration.endTime = float(scene.times[-1] - scene.times[0])
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.solutionSettings.writeSolutionToFile = False
        if len(nodes) > 20:
            settings.linearSolverType = exu.LinearSolverType.EigenSparse
        begin = time.perf_counter()
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
        seconds = time.perf_counter() - begin
        coordinates = [mbs.GetNodeOutput(n, exu.OutputVariableType.Coordinates) for n in nodes]
        references = [mbs.GetNode(n)["referenceCoordinates"] for n in nodes]
        return np.array(coordinates) + np.array(references), seconds

    return run
