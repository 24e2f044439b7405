"""The double pendulum by exudyn's kinematic tree, in joint angles."""

import exudyn as exu
import numpy as np
from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree, SensorNode


def tree(l1: float, l2: float, steps: int = 1000) -> np.ndarray:
    """Angles (steps + 1, 2) of the rods from the vertical over 10 s, by Runge-Kutta of order 4."""
    mbs = exu.SystemContainer().AddSystem()
    node = mbs.AddNode(
        NodeGenericODE2(
            referenceCoordinates=[0.0, 0.0],
            initialCoordinates=[np.pi / 4, np.pi / 12],  # of the second rod from the first
            initialCoordinates_t=[0.0, 0.0],
            numberOfODE2Coordinates=2,
        )
    )
    inertias, turns, offsets, centers = exu.Matrix3DList(), exu.Matrix3DList(), exu.Vector3DList(), exu.Vector3DList()
    for length, above in ((l1, 0.0), (l2, l1)):
        inertias.Append(np.diag([0.0, 0.0, length**3 / 12]))
        turns.Append(np.eye(3))
        offsets.Append([0.0, -above, 0.0])
        centers.Append([0.0, -length / 2, 0.0])
    mbs.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[exu.JointType.RevoluteZ] * 2,
            linkParents=[-1, 0],
            jointTransformations=turns,
            jointOffsets=offsets,
            linkInertiasCOM=inertias,
            linkCOMs=centers,
            linkMasses=[l1, l2],
            gravity=[0.0, -9.81, 0.0],
        )
    )
    sensor = mbs.AddSensor(
        SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=exu.OutputVariableType.Coordinates)
    )
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = 10.0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 10.0 / steps
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.RK44)
    return np.cumsum(mbs.GetSensorStoredData(sensor)[:, 1:], axis=1)
