"""Malformed calls of the API and of the command line: python tests/benchmarks/malformed.py [CALLS] [SEED] makes them.

Each call, to a public name or method, takes good arguments and replaces one or two by nonsense. It must succeed, or
raise one of symmb's errors, which the command line tells in one sentence with exit status 2 (1 if a run breaks down).
What it returns is used: methods bound, solvers run, elements and tables become equations. No number may then be nan
without a word. A call that takes what is no number for a number is a fault, and so is a good number in another form
(NumPy's integers, long doubles, read-only arrays) that gives another result. No call may take 10 s, or crash.

Call k of a seed has the seed SEED + k; every third one is a command. It prints the number of calls, and each fault.
"""

# ruff: noqa: E501  (tables of arguments)

import contextlib
import faulthandler
import io
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parent))
import _malformed_methods as methods
import _malformed_uses as uses
from _malformed_values import NONSENSE, ODD, is_wrong, other_form

import symmb as mb
from symmb.show.cli.main import main

MOST = 10.0
"""Time for a call [s]."""
MEMORY = 8 * 2**30
"""Address space of a process that makes calls [bytes]."""
FOLDER = tempfile.TemporaryDirectory()
"""Where calls run: they write where their nonsense says."""
T = np.linspace(0.0, 0.2, 5)


def rod_scene() -> mb.Scene:
    """A pendulum with a spring."""
    p = mb.Parameters(l=1.0, k=5.0)
    rod = mb.Body("rod", 1.0, p.l**2 / 12, mb.Planar())
    ground = mb.Ground()
    system = mb.System(
        rod,
        mb.Revolute("hinge", ground.point(0, 0), rod.point(-p.l / 2, 0)),
        mb.Spring("spring", ground.point(1, 1), rod.point(p.l / 2, 0), p.k, 0.5),
        mb.Gravity(0, -9.81),
        parameters=p,
    )
    return mb.Scene(system, times=T, outputs={"x": rod.x}, box=mb.Box(l=(0.95, 1.05)))


SCENE = rod_scene()
DECAY = mb.FunctionSimulator(lambda **p: np.exp(-p["l"] * T), {"l": 1.0}, T, ["x"])
BOX = mb.Box(l=(0.95, 1.05))
ROD, GROUND, HINGE = SCENE.system.bodies[0], mb.Ground(), SCENE.system.elements[1]
uses.AROUND += [ROD, HINGE]
uses.PARAMETERS += [SCENE.system.parameters]
A, B = GROUND.point(0, 0), ROD.point(0.5, 0)
BOUNDS = mb.propagate(DECAY, mb.PolynomialChaos(order=2), BOX)
RUN = mb.simulate(SCENE)
DAE = mb.compile_dae(SCENE.system)
COMPARISON = mb.compare(DECAY, [mb.Vertex()], BOX, mb.Scanning(3))

BEAM = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), mb.Material(2e11, 7800.0, nu=0.3), elements=2)


def in_a_scene(kind: type, *others: Any) -> Callable[..., mb.DAESimulator]:
    """A function that declares an element, and derives the equations of a scene with it and others."""

    def derived(*args: Any, **options: Any) -> mb.DAESimulator:
        system = mb.System(ROD, *others, kind(*args, **options), parameters=SCENE.system.parameters)
        return mb.DAESimulator(mb.Scene(system, times=T, guess={"rod.x": 0.5}))

    derived.__qualname__ = kind.__name__
    return derived


def body_in_a_scene(*args: Any, **options: Any) -> mb.DAESimulator:
    """A body under gravity."""
    return mb.DAESimulator(mb.Scene(mb.System(mb.Body(*args, **options), mb.Gravity(0, -9.81)), times=T))


CALLS: list[tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]] = [
    (mb.simulate, (SCENE,), {"solver": mb.CVODES(), "parameters": {"l": 1.0}, "times": T, "outputs": {"x": ROD.x}}),
    (mb.propagate, (DECAY, mb.Vertex()), {"box": BOX, "solver": None, "executor": None, "progress": None}),
    (mb.propagate, (SCENE, mb.PolynomialChaos(order=2)), {"box": BOX, "solver": mb.DormandPrince()}),
    (mb.compare, (DECAY, [mb.Vertex()]), {"box": BOX, "reference": mb.Scanning(3), "executor": None}),
    (mb.compare, (SCENE, [mb.Vertex()]), {"box": BOX, "reference": mb.Scanning(3), "times": T, "outputs": {"x": ROD.x}}),
    (mb.stability, (), {"scene": "no scene"}),
    (mb.Scene, (SCENE.system,), {"start": {"rod.theta": 0.1}, "times": T, "outputs": {"x": ROD.x}, "box": BOX, "guess": {"rod.x": 0.5}, "name": "scene"}),
    (mb.System, (ROD, mb.Gravity(0, -9.81)), {"parameters": SCENE.system.parameters}),
    (mb.Parameters, (), {"l": 1.0, "k": 2.0}),
    (mb.Box, (), {"l": (0.9, 1.1)}),
    (mb.Box.around, ({"l": 1.0}, 0.05), {"names": ["l"]}),
    (mb.Box.plus_minus, ({"l": 0.04, "k": 1.0},), {"l": "40 H7", "k": (-1e-3, 2e-3)}),
    (BOX.__or__, (mb.Box(k=(4.0, 6.0)),), {}),
    (mb.simulate, (SCENE,), {"parameters": [{"l": 1.0}, {"k": 4.0}]}),
    (mb.sweep, (DECAY, {"l": [0.9, 1.1]}), {"executor": None, "progress": None}),
    (mb.sweep, (SCENE, {"l": [0.9, 1.1]}), {"solver": mb.CVODES(), "times": T, "outputs": {"x": ROD.x}}),
    (mb.sensitivities, (SCENE, ["k"]), {"solver": mb.CVODES(), "times": T, "outputs": {"x": ROD.x}}),
    (mb.calibrate, (SCENE, {"x": np.full(5, 0.1)}, ["k"]), {"solver": mb.CVODES(), "noise": {"x": 0.1}}),
    (BOUNDS.check, ({"x": (0.1, None)},), {}),
    (BOUNDS.worst, ("x",), {"time": 0.1}),
    (body_in_a_scene, ("rod", 1.0, 0.1), {"pose": mb.Planar(), "com": (0, 0)}),
    (in_a_scene(mb.Revolute), ("hinge", A, B), {"axis": (0, 0, 1)}),
    (in_a_scene(mb.Prismatic), ("slide", A, B), {"axis": (1, 0, 0)}),
    (in_a_scene(mb.Distance), ("bar", A, B, 1.0), {}),
    (in_a_scene(mb.Gear), ("gear", A, B), {"ratio": 2.0}),
    (in_a_scene(mb.VelocityConstraint), ("rolls", (ROD.vx,)), {}),
    (in_a_scene(mb.Motion), ("drive", ROD.theta, mb.t), {}),
    (in_a_scene(mb.Impact), ("floor", ROD.y, 0.5), {}),
    (in_a_scene(mb.Spring), ("spring", A, B, 5.0, 0.5), {}),
    (in_a_scene(mb.Damper), ("damper", A, B, 5.0), {}),
    (in_a_scene(mb.SpringDamper), ("strut", A, B, 5.0, 1.0, 0.5), {}),
    (in_a_scene(mb.TorsionSpring), ("coil", GROUND, ROD, 5.0), {"damping": 0.1, "angle": 0.2}),
    (in_a_scene(mb.Bushing), ("bush", A, B, 5.0), {"damping": 1.0}),
    (in_a_scene(mb.NonlinearSpring), ("gas", A, B, mb.GasSpring(1e5, 1e-3, 1e-3, 0.1)), {}),
    (in_a_scene(mb.Contact), ("contact", B, A, (0, 1, 0), mb.HuntCrossley(1e5, 0.5, 0.1)), {"radius": 0.0}),
    (in_a_scene(mb.BushContact), ("bush", A, B, (0, 0, 1), 1e-3, mb.HuntCrossley(1e5, 0.5, 0.1)), {}),
    (in_a_scene(mb.BoxContact), ("box", B, (0.1, 0.2), A, mb.KelvinVoigt(1e5, 10.0)), {"normal": (0, 1)}),
    (in_a_scene(mb.CircleContact), ("circles", A, B, 0.1, 0.2, mb.KelvinVoigt(1e5, 10.0)), {"inside": False}),
    (in_a_scene(mb.CurveContact), ("track", A, mb.Curve([(0, 0), (1, 0)]), B, 0.1, mb.KelvinVoigt(1e5, 10.0)), {}),
    (mb.Curve, ([(0, 0), (1, 0), (2, 1)],), {"closed": False, "corners": [1]}),
    (mb.Curve, (lambda s: (s, s**2), 0.0, 1.0), {"closed": False, "corners": [0.5]}),
    (SCENE.system.force, ("spring",), {}),
    (mb.calibrate, (SCENE, {"x": np.full(5, 0.1)}, ["k"], mb.CVODES()), {}),
    (in_a_scene(mb.Friction), ("friction", A, B, (1, 0, 0), 10.0, mb.Coulomb(0.3, 1e-3)), {}),
    (in_a_scene(mb.Soil), ("soil", A, B, (0, 1, 0), mb.KelvinVoigt(1e5, 10.0)), {}),
    (in_a_scene(mb.Force), ("force", B, (1.0, 0.0)), {}),
    (in_a_scene(mb.Torque), ("torque", ROD, 1.0), {}),
    (in_a_scene(mb.Gravity), (0.0, -9.81), {}),
    (in_a_scene(mb.Actuator, HINGE), ("motor", HINGE, -ROD.theta), {"coordinate": "angle"}),
    (in_a_scene(mb.Stop, HINGE), ("stop", HINGE, -1.0, 2.0, mb.KelvinVoigt(1e5, 10.0)), {"coordinate": "angle"}),
    (in_a_scene(mb.Stop, HINGE), ("stop", HINGE, -1.0, 2.0), {"restitution": 0.5}),
    (in_a_scene(mb.State), ("state",), {"rate": lambda z: -z + ROD.theta}),
    (in_a_scene(mb.States), (["first", "second"], lambda x, y: (y, -x)), {}),
    (in_a_scene(mb.Sampled), ("held", 0.1), {"law": ROD.theta}),
    (lambda **start: mb.DAESimulator(mb.Scene(SCENE.system, start={f"hinge.{k}": v for k, v in start.items()}, times=T)), (), {"angle": 0.1, "angle_rate": 2.0}),
    (mb.HuntCrossley, (1e5, 0.5, 0.1), {"exponent": 1.5}),
    (mb.KelvinVoigt, (1e5, 10.0), {}),
    (mb.Coulomb, (0.3, 1e-3), {"static": 0.4}),
    (mb.Bristle, (0.3, 1e5), {}),
    (mb.Optimization, (), {"budget": 100, "tolerance": 1e-3}),
    (mb.Swarm, (), {"particles": 10, "steps": 5, "seed": 0}),
    (mb.Bernstein, (), {"boxes": 2}),
    (mb.Rosenbrock, (), {"step": 1e-3}),
    (mb.HHT, (), {"step": 1e-3}),
    (mb.GeneralizedAlpha, (), {"step": 1e-3, "rho": 0.8}),
    (mb.Newmark, (), {"step": 1e-3}),
    (mb.Baumgarte, (), {"alpha": 5.0, "beta": 5.0}),
    (mb.AugmentedLagrangian, (), {"penalty": 1e6, "iterations": 2}),
    (mb.FiniteElements.beams, (BEAM,), {}),
    (mb.FiniteElements.beams(BEAM).modes, (), {"count": 2, "clamped": 0, "damping": 0.01}),
    (mb.FiniteElements.matrices, (np.eye(3), np.eye(9), np.eye(9)), {}),
    (ROD.point, (0.1, 0.2), {}),
    (mb.ddt, (ROD.x,), {}),
    (mb.Expansion, (np.array([[0], [1]]), np.zeros((2, 1, 1)), ("l",)), {}),
    (mb.FunctionSimulator, (lambda **p: np.exp(-p["l"] * T), {"l": 1.0}, T, ["x"]), {}),
    (mb.MonteCarlo, (10,), {"seed": 0, "sampler": mb.Sobol()}),
    (mb.Scanning, (3,), {}),
    (mb.Taylor, (), {"order": 2, "subintervals": 1}),
    (mb.PolynomialChaos, (), {"order": 2, "nodes": mb.Gauss(), "basis": mb.TotalDegree(), "range": mb.Exact(), "lockstep": False}),
    (mb.PolynomialChaos, (), {"tolerance": 1e-2, "budget": 100}),
    (mb.PolynomialChaos.paper, (2,), {"nodes": mb.Gauss()}),
    (mb.SparseGrid, (), {"rule": mb.Leja(), "level": 2}),
    (mb.HyperbolicCross, (), {"q": 0.5}),
    (mb.Exact, (), {"tolerance": 1e-3, "budget": 100}),
    (mb.CVODES, (), {"rtol": 1e-8, "atol": 1e-10, "stiff": False, "stabilization": None}),
    (mb.DormandPrince, (), {"rtol": 1e-8, "atol": 1e-10, "stabilization": None}),
    (mb.RungeKutta, (), {"steps": 100}),
    (mb.NSTIFFSI2, (), {"step": 1e-3}),
    (mb.Collocation, (), {"degree": 4, "steps": 10}),
    (mb.Table, ([0, 1], [0, 1]), {}),
    (mb.Section.circle, (0.02,), {}),
    (mb.Material, (2e11, 7800.0), {"nu": 0.3}),
    (mb.Beam, ([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), mb.Material(2e11, 7800.0, nu=0.3)), {"elements": 3}),
    (mb.rotation, (), {"axis": (1, 0, 0), "angle": 0.3}),
    (BOUNDS.__getitem__, ("x",), {}),
    (BOUNDS.doubtful, (0.1,), {}),
    (BOUNDS.save, ("b.npz",), {}),
    (BOUNDS.plot, ("b.png",), {}),
    (BOUNDS.report, ("b.html",), {"limits": {"x": (None, 1.0)}, "author": "A", "revision": "1"}),
    (BOUNDS.check, ({"x": (None, 1.0)},), {}),
    (BOUNDS.live, ("l.html",), {"limits": {"x": (None, 1.0)}}),
    (mb.design, (DECAY, {"l": (0.8, 1.2)}, ("x", "upper")), {"limits": {"x": (0.5, None)}, "box": BOX, "costs": None}),
    (mb.tolerances, (DECAY, {"x": (0.8, None)}), {"box": BOX, "costs": None}),
    (mb.calibrate, (DECAY, {"x": DECAY.run([[1.0]]).Y[0, :, 0]}), {"parameters": ["l"], "box": BOX}),
    (mb.Bounds.load, ("saved.npz",), {}),
    (mb.Comparison.load, ("saved.json",), {}),
    (mb.Trajectory.load, ("run.npz",), {"scene": SCENE}),
    (mb.Modes.load, ("modes.npz",), {}),
    (RUN.__getitem__, ("x",), {}),
    (RUN, (ROD.x,), {}),
    (RUN.reaction, ("hinge",), {}),
    (RUN.save, ("r.csv",), {}),
    (RUN.plot, ("r.png",), {}),
    (COMPARISON.save, ("c.json",), {}),
    (COMPARISON.plot, ("c.svg",), {}),
    (COMPARISON.report, ("c.html",), {}),
    (SCENE.with_times, (T,), {}),
    (SCENE.with_outputs, ({"x": ROD.x},), {}),
    (SCENE.with_box, (BOX,), {}),
    (SCENE.with_name, ("name",), {}),
    (SCENE.system.reaction, ("hinge",), {}),
    (SCENE.system.lam, ("hinge",), {}),
    (DAE.save_c, ("c",), {"start": None}),
    (mb.DAESimulator, (SCENE,), {"solver": mb.CVODES()}),
    (mb.compile_dae, (SCENE.system,), {}),
]  # fmt: skip

MODES = mb.FiniteElements.beams(BEAM).modes(count=2, clamped=0)
PIECES = {
    "rod": ROD,
    "ground": GROUND,
    "hinge": HINGE,
    "scene": SCENE,
    "box": BOX,
    "decay": DECAY,
    "run": RUN,
    "beam": [BEAM],
    "reduction": None,
}
RECEIVERS = {
    "scene": SCENE, "system": SCENE.system, "body": ROD, "point": A, "joint": HINGE, "box": BOX, "bounds": BOUNDS, "run": RUN, "comparison": COMPARISON, "function": DECAY,
    "simulator": mb.DAESimulator(SCENE), "linearization": mb.linearize(SCENE), "modal": mb.ModalSimulator(SCENE), "mesh": mb.FiniteElements.beams(BEAM), "modes": MODES, "parameters": SCENE.system.parameters,
    "table": mb.Table([0, 1], [0, 1]), "locus": mb.root_locus(SCENE, "k", (4.0, 5.0), count=3), "expansion": mb.Expansion(np.array([[0], [1]]), np.zeros((2, 1, 1)), ("l",)),
    "stored": mb.StoredSimulator(DECAY, Path(FOLDER.name, "runs.db")), "rotation": mb.rotation(axis=(0, 0, 1), angle=0.3), "method": mb.MonteCarlo(10), "check": BOUNDS.check({"x": (None, 1.0)}), "tolerances": mb.tolerances(DECAY, {"x": (0.8, None)}, box=BOX),
}  # fmt: skip
CALLS += methods.calls(RECEIVERS, methods.arguments(PIECES), methods.INTERNAL)

ANYTHING: set[tuple[Any, Any]] = {(mb.Box.plus_minus, "l"), (mb.Box.plus_minus, "k"), (mb.Box.around, 1)}
"""Places of calls where values of every kind are legal."""

WORDS = [
    "", "-", "--", "1", "nan", "-1", "1e999", "l=1", "l=", "=1", "l=a", "l==1", "k=1e-300", "pce", "pce:2", "pce:-1", "pce:2:paper", "pce:x", "taylor:99",
    "mc:0", "mc:1e3", "mc:999999999999", "scan:1", "vertex", "vertex:1", "cvodes", "cvodes:2", "cvodes:-1e-8", "idas:nan", "rk:0", "rk:1e-3",
    "dopri:1", "foo", "foo:1", "5%", "0%", "500%", "%", "five", "/nonexistent/x.json", "/", ".", "..", "x.txt", "x.npz", "x.png", "x.json", "x.csv",
    "scene.py", "broken.py", "empty.py", "double_pendulum", "no_such_scene", "--methods", "--solver", "--set", "--spread", "--json", "--csv", "--plot", "--report",
    "--latex", "--box", "--limit", "--tolerances", "l=0.9:1.1", "x=:1", "x=1:", "x=::", "l=:", "x=nan:1", "--urdf", "arm.urdf", "a.b=1", "arm.mass=1", "arm.mass=nan", "link.mass=-1", "--inputs", "-o", "--help", "\x00", "a\nb", "é", "*/",
]  # fmt: skip
COMMANDS = ["simulate", "bound", "compare", "equations", "codegen", "cache", "stability", "linearize", "runs", "fly"]
FILES = {
    "scene.py": Path(__file__).read_text(encoding="utf-8").split("def rod_scene")[1].split("\n\n\nSCENE")[0],
    "broken.py": "def scene(:\n",
    "empty.py": "",
    "exits.py": "def scene():\n    raise SystemExit(3)\n",
    "bare.py": "class E(BaseException): pass\ndef scene():\n    raise E('stop')\n",
    "path.py": "import sys\nsys.path.clear()\ndef scene():\n    return None\n",
    "number.py": "def scene():\n    return 3\n",
    "list.py": "scene = []\n",
    "arm.urdf": (Path(__file__).parents[1] / "data" / "urdf" / "branch.urdf").read_text(encoding="utf-8"),
    "arm.xml": '<mujoco><worldbody><body name="arm"><joint name="elbow"/><geom size="0.1"/></body></worldbody></mujoco>',
    "part.stl": "solid part facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet endsolid",
    "robot.urdf": '<robot name="r"><link name="a b"/><link name="\x01"/></robot>',
    "odd.urdf": '<robot name="r"><link name="&#x202E;"/><link name="b"/><joint name="" type="revolute"><parent link="b"/><child link="&#x202E;"/></joint></robot>',
    "name.py": "def scene():\n    import symmb as mb\n    p = mb.Parameters(a=1.0)\n    return mb.Scene(mb.System(parameters=p), outputs={3: p.a})\n",
}  # fmt: skip


class TooLong(BaseException):
    """A call took longer than it may."""


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """A context that ends after `MOST` seconds."""

    def end(number: int, frame: Any) -> None:
        raise TooLong

    previous = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, MOST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


@contextlib.contextmanager
def in_own_folder() -> Iterator[None]:
    """Make this folder the working directory."""
    before = os.getcwd()
    os.chdir(FOLDER.name)
    try:
        yield
    finally:
        os.chdir(before)


@in_own_folder()
def api_fault(choice: random.Random) -> str:
    """A malformed call of the API: what is wrong with its outcome; empty if nothing."""
    f, args, options = choice.choice(CALLS)
    places = dict(enumerate(args)) | options
    if choice.random() < SHARE_OF_FORMS:
        forms = {place: form for place, good in places.items() if (form := other_form(good, choice)) is not None}
        if forms:
            place = choice.choice([*forms])
            return form_fault(f, places, place, forms[place])
    good, at = places.copy(), []
    for _ in range(choice.choice((1, 1, 2))):
        at.append(choice.choice([*places]))
        places[at[-1]] = choice.choice(choice.choice((NONSENSE, ODD)))
    text = told(f, places)
    try:
        with limited():
            result = called(f, places)
            fault = uses.use(result)
    except BaseException as error:
        own = "progress" in at and not isinstance(error, TooLong)  # what the caller's function raises is the caller's
        return "" if own else fault_of(text, error)
    if fault:
        return f"{text}: {fault}"
    wrong = len(at) == 1 and (f, at[0]) not in ANYTHING and is_wrong(good[at[0]], places[at[0]])
    return f"{text}: accepts {short(places[at[0]])}" if wrong else ""


def form_fault(f: Callable[..., Any], places: dict[Any, Any], place: Any, form: Any) -> str:
    """A call with a good value in another form: it gives what the call with the value gives, or is refused."""
    text, seen = told(f, places | {place: form}), []
    for values in places, places | {place: form}:
        try:
            with limited():
                seen.append(uses.digest(called(f, values)))
        except mb.SymmbError as error:
            return fault_of(text, error)
        except BaseException as error:
            return fault_of(text, error)
    return "" if seen[0] == seen[1] else f"{text}: gives {seen[1]} for {seen[0]}"


SHARE_OF_FORMS = 0.2
"""Share of calls with good values in other forms."""


def called(f: Callable[..., Any], places: dict[Any, Any]) -> Any:
    """The result of a function with arguments by their places: numbers and names."""
    args = [value for place, value in places.items() if isinstance(place, int)]
    return f(*args, **{place: value for place, value in places.items() if isinstance(place, str)})


def told(f: Callable[..., Any], places: dict[Any, Any]) -> str:
    """The call in a line."""
    words = (short(value) if isinstance(place, int) else f"{place}={short(value)}" for place, value in places.items())
    return f"{getattr(f, '__qualname__', f)}({', '.join(words)})"


def fault_of(text: str, error: BaseException) -> str:
    """What is wrong with an exception of a call; empty if nothing."""
    if isinstance(error, mb.SymmbError):
        return "" if len(str(error)) < 2000 else f"{text}: message of {len(str(error))} characters"
    if isinstance(error, TooLong):
        return f"{text}: longer than {MOST:g} s"
    where = traceback.extract_tb(error.__traceback__)[-1]
    return f"{text}: {type(error).__name__}: {str(error)[:100]} ({Path(where.filename).name}:{where.lineno})"


@in_own_folder()
def command_fault(choice: random.Random) -> str:
    """A malformed command: what is wrong with its outcome; empty if nothing."""
    command = choice.choice(COMMANDS)
    words = [choice.choice([*FILES, *WORDS]) for _ in range(choice.randrange(5))]
    if choice.random() < 0.7:
        words.insert(0, choice.choice(list(FILES)))
    if command == "stability":
        words = ["number.py", *words[1:]]
    output, error = io.StringIO(), io.StringIO()
    text = f"symmb {command} {' '.join(map(repr, words))}"
    try:
        with limited(), contextlib.redirect_stdout(output), contextlib.redirect_stderr(error):
            status = main([command, *words])
    except SystemExit as end:
        status = end.code
    except BaseException as fault:
        return fault_of(text, fault)
    lines = [line for line in error.getvalue().splitlines() if not line.startswith("This comparison")]
    if status not in (0, 1, 2, 3):
        return f"{text}: exit status {status}"
    if status in (1, 2) and not lines:
        return f"{text}: no word"
    if any("Traceback" in line for line in lines):
        return f"{text}: traceback"
    return ""


def short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) < 60 else f"{text[:57]}..."


def study(calls: int, seed: int = 0, told: Callable[[int], None] = lambda k: None) -> list[str]:
    """The faults of so many malformed calls; `told` gets the seed of each call before it."""
    faults = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_files()
        for k in range(seed, seed + calls):
            told(k)
            choice = random.Random(k)
            fault = command_fault(choice) if k % 3 == 0 else api_fault(choice)
            if fault:
                faults.append(f"seed {k}: {fault}")
    return faults


@in_own_folder()
def write_files() -> None:
    """Write the files that commands take."""
    for name, text in FILES.items():
        Path(name).write_text(text if name != "scene.py" else _scene_file(text), encoding="utf-8")
    BOUNDS.save("saved.npz"), COMPARISON.save("saved.json"), RUN.save("run.npz"), MODES.save("modes.npz")
    RECEIVERS["check"].save("limits.npz"), RECEIVERS["tolerances"].save("tolerances.npz")


def _scene_file(body: str) -> str:
    return f"import numpy as np\nimport symmb as mb\n\nT = np.linspace(0.0, 0.2, 5)\n\n\ndef scene{body}\n"


def in_batches(calls: int, seed: int) -> list[str]:
    """The faults of so many calls in processes of their own. What follows a call that crashes or hangs is made anew."""
    found, first, end = [], seed, seed + calls
    while first < end:
        last = min(first + BATCH, end)
        command = [sys.executable, __file__, str(last - first), str(first), "--here"]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", preexec_fn=with_less_memory)
        lines = done.stdout.splitlines()
        found += [line for line in lines if line.startswith("seed ")]
        if done.returncode:
            last = max([first, *(int(line[1:]) for line in lines if line[:1] == "@" and line[1:].isdigit())]) + 1
            where = re.findall(r'File ".*?([^/"]+)", line (\d+) in (\w+)', done.stderr)[:6]
            found.append(f"seed {last - 1}: exit status {done.returncode}, {where or done.stderr[-400:]}")
        first = last
    return found


def with_less_memory() -> None:
    """Limit the memory of a process before symmb looks how much there is."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def here(calls: int, seed: int) -> None:
    """Print the faults of so many calls. A call that no signal ends, and memory beyond the limit, end this process."""
    faulthandler.enable()

    def told(k: int) -> None:
        print(f"@{k}", flush=True)
        faulthandler.dump_traceback_later(MOST + 5, exit=True)

    print(*study(calls, seed, told), sep="\n", flush=True)
    faulthandler.cancel_dump_traceback_later()


BATCH = 100
"""Calls in a process."""

if __name__ == "__main__":
    CALLS_TO_MAKE = int(sys.argv[1]) if len(sys.argv) > 1 else 1500
    FIRST = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    if "--here" in sys.argv:
        here(CALLS_TO_MAKE, FIRST)
    else:
        begin = time.perf_counter()
        faults_found = in_batches(CALLS_TO_MAKE, FIRST)
        print(f"{CALLS_TO_MAKE} calls in {time.perf_counter() - begin:.0f} s, {len(faults_found)} faults")
        print(*faults_found, sep="\n")
