"""A soft bar tumbles and bends: symmb's floating frame beside exudyn's, with the same finite elements and modes.

PYTHONPATH=.:tests/flexible python tests/benchmarks/flexible.py [file for exudyn's motion]
"""

import json
import sys
import time
from pathlib import Path

import exudyn as exu
import numpy as np
from bricks import bar
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from exudyn.utilities import Force, MarkerSuperElementPosition, SensorSuperElement
from scipy.sparse import csr_matrix

import symmb as mb

MODES, OMEGA, GRAVITY, PULL = 8, (3.0, 12.0, 20.0), (0.0, -9.81, 0.0), (0.0, 40.0, 25.0)
TIMES = np.linspace(0.0, 0.5, 51)


def with_exudyn(steps: int) -> tuple[np.ndarray, float]:
    """Places (n_t, 3) of the last node, and seconds."""
    positions, K, M = bar()
    elements = FEMinterface()
    elements.nodes = {"Position": positions}
    elements.massMatrix, elements.stiffnessMatrix = csr_matrix(M), csr_matrix(K)
    modes = mb.FiniteElements.matrices(positions, K, M).modes(count=MODES)
    elements.modeBasis = {"matrix": modes.shapes.reshape(-1, MODES), "type": "NormalModes"}
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    body = ObjectFFRFreducedOrderInterface(elements).AddObjectFFRFreducedOrder(
        mbs, initialAngularVelocity=list(OMEGA), gravity=list(GRAVITY)
    )
    sensor = mbs.AddSensor(
        SensorSuperElement(
            bodyNumber=body["oFFRFreducedOrder"],
            meshNodeNumber=len(positions) - 1,
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.Position,
        )
    )
    marker = MarkerSuperElementPosition(
        bodyNumber=body["oFFRFreducedOrder"], meshNodeNumbers=[0], weightingFactors=[1.0]
    )
    mbs.AddLoad(Force(markerNumber=mbs.AddMarker(marker), loadVector=list(PULL)))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = steps, float(TIMES[-1])
    settings.solutionSettings.sensorsWritePeriod = float(TIMES[1])
    settings.solutionSettings.writeSolutionToFile = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    begin = time.process_time()
    mbs.SolveDynamic(settings)
    seconds = time.process_time() - begin
    return mbs.GetSensorStoredData(sensor)[:, 1:], seconds


def with_symmb() -> tuple[np.ndarray, float]:
    positions, K, M = bar()
    body = mb.FlexibleBody("bar", mb.FiniteElements.matrices(positions, K, M).modes(count=MODES))
    corner = body.node(len(positions) - 1)
    scene = mb.Scene(
        mb.System(body, mb.Gravity(*GRAVITY), mb.Force("pull", body.node(0), PULL)),
        start={"bar.omega": OMEGA},
        times=TIMES,
        outputs={"x": corner.x, "y": corner.y, "z": corner.z, "eta1": body.eta[0]},
    )
    run = mb.simulate(scene, mb.DormandPrince(rtol=1e-9))
    print(f"first frequencies {body.modes.frequencies[:4].round(2)} Hz, eta1 up to {np.abs(run['eta1']).max():.3g}")
    return run.values[:, :3], run.run_seconds


if __name__ == "__main__":
    ours, seconds = with_symmb()
    for steps in (4000, 16000, 64000):
        theirs, peer = with_exudyn(steps)
        apart = np.linalg.norm(ours - theirs, axis=1).max()
        print(f"exudyn, {steps} steps, {peer:.2f} s: {apart:.2e} m apart; symmb {seconds:.4f} s")
    if len(sys.argv) > 1:
        known = {
            "source": f"exudyn {exu.__version__}, ObjectFFRFreducedOrder, {steps} steps",
            "omega": OMEGA,
            "gravity": GRAVITY,
            "pull": PULL,
            "modes": MODES,
            "times": TIMES.tolist(),
            "corner": theirs.tolist(),
        }
        Path(sys.argv[1]).write_text(json.dumps(known), encoding="utf-8")
