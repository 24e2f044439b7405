"""FMUs of six scenes against the scenes: validity, runs, bounds, leaks and speed.

    PYTHONPATH=tests python tests/benchmarks/exported_fmus.py [SETS [MODEL ...]] [--seed SEED]

For each model and each version of FMI it prints what FMPy's validator finds, and the largest difference of an output
between FMPy's run of the FMU and `simulate`, over the largest value of the output, for SETS random sets of
parameters, and that of bounds by `propagate` of the FMU and of the scene. For three of these sets it compares with
CVODES as well. A program of C, built from the sources in the FMU, makes 200 runs of one instance under the sanitizers
of gcc and clang, and tells runs per second, beside those of one lane of the compiled ensemble. Another calls each FMU
in 1,000 random orders, right and wrong ones, and tells the first call that the standard answers otherwise. At last FMPy
makes 200 runs of one instance, and the memory of the process is told.
"""

import argparse
import importlib
import resource
import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path

import fmpy
import numpy as np
from _timing import median, pin
from fmi_orders import compile_orders
from fmpy.validation import validate_fmu

import symmb as mb

MODELS = {
    "double_pendulum": mb.DormandPrince(1e-10),
    "half_car": mb.DormandPrince(1e-10),  # contact
    "bouncing_ball": mb.EventDriven(),  # impacts
    "four_bar": mb.DormandPrince(1e-10),  # a loop
    "flexible_pendulum": mb.DormandPrince(1e-10),
    "heavy_top": mb.DormandPrince(1e-10),  # in space
}
SPREAD = 0.01
RUNS = 200
ORDERS = 1000
SANITIZED = "-std=gnu11 -O0 -g -Wall -Wextra -Werror -fsanitize=address,undefined -fno-sanitize-recover=all".split()
FAST = "-std=gnu11 -O2 -fno-math-errno -fno-trapping-math -ffp-contract=fast".split()
DRIVER = """
#include <stdbool.h>
#include <stdio.h>
#include <time.h>
#include "scene.h"
void *fmi3InstantiateCoSimulation(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *,
                                  size_t, void *, void *, void *);
int fmi3EnterInitializationMode(void *, bool, double, double, bool, double);
int fmi3ExitInitializationMode(void *);
int fmi3DoStep(void *, double, double, bool, bool *, bool *, bool *, double *);
int fmi3GetFloat64(void *, const unsigned *, size_t, double *, size_t);
int fmi3SetFloat64(void *, const unsigned *, size_t, const double *, size_t);
int fmi3Reset(void *);
void fmi3FreeInstance(void *);
int main(void) {
  void *fmu = fmi3InstantiateCoSimulation("run", SCENE_TOKEN, "", 0, 0, 0, 0, 0, 0, 0, 0, 0);
  unsigned references[SCENE_N_Y], first = 1;
  double y[SCENE_N_Y], sum = 0.0, reached;
  for (unsigned k = 0; k < SCENE_N_Y; ++k) references[k] = 1 + SCENE_N_P + k;
  const clock_t begin = clock();
  int failed = 0;
  for (int run = 0; run < RUNS; ++run) {
    const double value = scene_nominal[0] * (1 + 1e-4 * run / RUNS);
    bool no;
    fmi3Reset(fmu);
    fmi3SetFloat64(fmu, &first, 1, &value, 1);
    failed |= fmi3EnterInitializationMode(fmu, 0, 0, scene_times[0], 1, scene_times[SCENE_N_T - 1]);
    failed |= fmi3ExitInitializationMode(fmu);
    for (int k = 1; k < SCENE_N_T; ++k) {
      failed |= fmi3DoStep(fmu, scene_times[k - 1], scene_times[k] - scene_times[k - 1], 1, &no, &no, &no, &reached);
      failed |= fmi3GetFloat64(fmu, references, SCENE_N_Y, y, SCENE_N_Y);
      sum += y[0];
    }
  }
  fprintf(stderr, "%g\\n", sum);
  printf("%.6g\\n", RUNS / ((double)(clock() - begin) / CLOCKS_PER_SEC));
  fmi3FreeInstance(fmu);
  return failed;
}
"""


def run_fmu(folder: str, description: object, simulator: mb.DAESimulator, p: np.ndarray) -> np.ndarray:
    """Outputs (n_t, n_y) of the FMU in FMPy."""
    rows = fmpy.simulate_fmu(
        folder,
        model_description=description,
        start_values=dict(zip(simulator.parameters, p.tolist(), strict=True)),
        fmi_type="CoSimulation",
        stop_time=float(simulator.times[-1]),
        output_interval=float(np.diff(simulator.times).max()),
        output=list(simulator.outputs),
    )
    return np.array([rows[name] for name in simulator.outputs]).T


def difference(Y: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of outputs (n_t, n_y) over their largest values."""
    largest = np.abs(expected).max(axis=0)
    return float((np.abs(Y - expected) / np.maximum(largest, 1e-6 * largest.max())).max())


def programs(folder: Path, work: Path) -> list[str]:
    """What sanitizers say about 200 runs of one instance, and runs per second."""
    sources = [work / "driver.c", folder / "sources" / "fmi.c", folder / "sources" / "scene.c"]
    sources[0].write_text(DRIVER)
    told = []
    for compiler, kind, flags in (
        ("gcc", "sanitized", SANITIZED),
        ("clang", "sanitized", SANITIZED),
        ("gcc", "fast", FAST),
    ):
        if not shutil.which(compiler):
            continue
        command = [compiler, *flags, f"-DRUNS={RUNS}", f"-I{folder / 'sources'}", *map(str, sources)]
        subprocess.run([*command, "-o", str(work / "program"), "-lm"], check=True)
        run = subprocess.run([str(work / "program")], capture_output=True, text=True)
        fault = f" FAULT {run.returncode} {run.stderr[-300:]}" if run.returncode else ""
        told.append(f"{compiler} {kind}: {float(run.stdout or 'nan'):,.0f} runs/s{fault}")
    return told


def lane(simulator: mb.DAESimulator) -> tuple[float, int]:
    """Runs per second of one lane of the ensemble on one core, and the number of lanes."""
    engine = simulator.program.engine()
    P = np.tile(simulator.dae.p_nominal, (engine.width, 1))
    x0 = np.empty((len(P), 0)) if engine.starts else simulator.formulation.start.states(P)[0]
    return 1 / median(lambda: engine.values(x0, P), calls=20), engine.width


def bounds_difference(path: Path, simulator: mb.DAESimulator, scene: mb.Scene) -> float:
    """The largest difference of bounds of the FMU and of the scene, over the largest value of the output."""
    box = mb.Box(**{name: scene.box.bounds[k] for k, name in enumerate(scene.box.names[:2])})
    times = simulator.times[:: max(1, len(simulator.times) // 40)]
    of_fmu = mb.FMUSimulator(path, simulator.parameters, times=times, outputs=list(simulator.outputs))
    method = mb.PolynomialChaos(order=2)
    one = mb.propagate(of_fmu, method, box)
    other = mb.propagate(scene.with_times(times), method, box, solver=simulator.solver)
    return max(difference(one.lower, other.lower), difference(one.upper, other.upper))


def orders(scene: mb.Scene, version: int, seed: int, work: Path) -> str:
    """What sanitizers and the standard say about calls in random orders."""
    program = compile_orders(scene, version, work)
    run = subprocess.run([str(program), str(seed * ORDERS), str(ORDERS)], capture_output=True, text=True)
    return run.stdout.strip() + (f" FAULT {run.returncode} {run.stderr[:300]}" if run.returncode else "")


def main(sets: int = 50, *models: str, seed: int = 0) -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    pin()
    for name in models or MODELS:
        scene = importlib.import_module(f"models.{name}").scene()
        outputs = {f"y {output}": expression for output, expression in scene.outputs.items()}
        scene = scene.with_outputs(outputs)  # an FMU has one name for each variable
        simulator = mb.DAESimulator(scene, MODELS[name])
        nominal = simulator.dae.p_nominal
        P = nominal * np.random.default_rng(0).uniform(1 - SPREAD, 1 + SPREAD, (sets, len(nominal)))
        if "restitution" in simulator.parameters:
            P = np.minimum(P, 1.0)
        named = [dict(zip(simulator.parameters, p.tolist(), strict=True)) for p in P]
        expected = [mb.simulate(simulator, parameters=each).values for each in named]
        print(f"{name}: {simulator.solver!r} in {simulator.coordinates} coordinates, {len(simulator.times)} times")
        with tempfile.TemporaryDirectory() as place:
            for version in (3, 2):
                path = Path(place, f"{name}{version}.fmu")
                mb.save_fmu(simulator, path, version=version)
                folder = fmpy.extract(str(path), str(Path(place, f"extracted{version}")))
                description = fmpy.read_model_description(folder)
                runs = [run_fmu(folder, description, simulator, p) for p in P]
                worst = max(difference(Y, own) for Y, own in zip(runs, expected, strict=True))
                bounds = bounds_difference(path, simulator, scene)
                print(f"  FMI {version}: {validate_fmu(str(path)) or 'valid'}; runs {worst:.1e}, bounds {bounds:.1e}")
                print(f"  {ORDERS:,} orders: {orders(scene, version, seed, Path(place))}")
                if version == 3 and simulator.dae.impacts is None:
                    solver = mb.CVODES(1e-12)
                    other = [mb.simulate(scene, solver, parameters=each).values for each in named[:3]]
                    print(f"  CVODES: {max(map(difference, runs, other)):.1e}")
                if version == 3:
                    print("\n".join(f"  {line}" for line in programs(Path(folder), Path(place))))
                    speed, lanes = lane(simulator)
                    print(f"  one lane of {lanes}: {speed:,.0f} runs/s")
            before, peaks = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, []
            for _ in range(RUNS // 50):
                memory(folder, description, simulator, 50)
                peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
            print(f"  growth of memory in 50, 100, ... runs of one instance in FMPy: {peaks} kB", flush=True)


def memory(folder: str, description: object, simulator: mb.DAESimulator, count: int) -> None:
    """Runs of one instance of FMI 2."""
    model = fmpy.instantiate_fmu(folder, description, "CoSimulation")
    for _ in range(count):
        fmpy.simulate_fmu(
            folder,
            model_description=description,
            fmu_instance=model,
            fmi_type="CoSimulation",
            stop_time=float(simulator.times[-1]),
            output_interval=float(np.ptp(simulator.times)) / 50,
        )
        model.reset()
    model.freeInstance()


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("sets", nargs="?", type=int, default=50)
    parser.add_argument("models", nargs="*")
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    main(words.sets, *words.models, seed=words.seed)
