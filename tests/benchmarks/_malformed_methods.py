"""Calls of every public name and of every public method of what they return, found by their signatures.

Each is a function with good arguments, chosen by the names of its parameters. `malformed.py` spoils one or two of them.
"""

# ruff: noqa: E501  (tables of arguments)

import inspect
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any

import numpy as np

import symmb as mb

T = np.linspace(0.0, 0.2, 5)

RESULTS = {
    "Bounds", "Calibration", "Comparison", "ConsistentSet", "Contributions", "Design", "Event", "LimitCheck", "Linearization", "Modes", "Moments", "RootLocus", "Sensitivities", "Stability",
    "Sweep", "Tolerances", "Trajectory",
}  # fmt: skip
"""What symmb makes and nobody else does; its methods are called."""
BETWEEN_ROOMS = {
    "around", "bounds", "carried", "course", "crossings", "engine", "get", "good_surrogate", "inertial", "integration", "joint_space", "keeping", "kink", "march", "measured", "nearest", "number", "planned_runs", "position_rows", "positive", "pressure", "remembered", "response", "retract",
    "round", "run_seconds", "sizes", "solve", "sign_faults", "solved_by", "tighter", "turns", "velocity_rows", "with_elements", "with_inputs", "with_mass", "with_nominal", "with_states", "without",
}  # fmt: skip
"""Methods that one room calls of another; the guide and the docstrings of public names do not mention them."""
OPTIONAL = {"jax_function": "jax", "torch_function": "torch", "load_mjcf": "mujoco"}
"""Functions that need a package, which takes seconds to load."""


def _is_missing(package: str) -> bool:
    try:
        import_module(package)
    except ModuleNotFoundError:
        return True
    return False


MISSING = {name for name, package in OPTIONAL.items() if _is_missing(package)}
INTERNAL = frozenset(RESULTS | BETWEEN_ROOMS | MISSING | {"view", "stability"})
"""Names that are left out. `view` opens windows, and `stability` takes minutes where it is called rightly."""

OF_OWNER: dict[str, dict[str, Any]] = {
    "sweep": {"values": {"k": [4.0, 5.0]}},
    "sensitivities": {"parameters": ["k"]},
    "calibrate": {"data": {"x": np.full(5, 0.1)}, "parameters": ["k"], "noise": {"x": 0.1}},
    "Box.plus_minus": {"parameters": {"l": 1.0}},
    "critical": {"range": (4.0, 6.0), "parameter": "k"},
    "root_locus": {"range": (4.0, 6.0), "parameter": "k"},
    "CommandSimulator": {"outputs": ["x"]},
    "FMUSimulator": {"outputs": ["x"]},
    "FunctionSimulator": {"outputs": ["x"]},
    "Box3": {"size": (1.0, 0.1, 0.1)},
    "Mesh": {"path": "part.stl"},
    "Table": {"x": [0.0, 1.0, 2.0], "y": [1.0, 2.0, 3.0]},
    "Tabulated": {"curve": mb.Table([0.0, 1e-3], [0.0, 10.0])},
    "Table.__call__": {"at": 0.5},
    "Material": {"G": None},
    "Section": {"area": 1e-3, "Iy": 1e-6, "Iz": 1e-6, "J": 2e-6},
    "PolynomialChaos.paper": {"nodes": mb.Gauss()},
    "Coulomb": {"kinetic": 0.3},
    "Bristle": {"kinetic": 0.3},
    "GasSpring": {"pressure": 1e5, "volume": 1e-3, "area": 1e-3},
    "Orifice": {"area": 1e-3, "opening": 1e-4},
    "Bushing": {"stiffness": 5.0},
    "Expansion": {"exponents": np.array([[0], [1]]), "parameters": ("l",)},
    "Expansion.values": {"points": np.array([[0.5]])},
    "Box.from_unit": {"unit": np.array([[0.5]])},
    "Box.to_unit": {"values": np.array([[1.0]])},
    "BlackBox.run": {"P": np.array([[1.0]])},
    "BlackBox.stream": {"P": np.array([[1.0]])},
    "StoredSimulator.run": {"P": np.array([[1.0]])},
    "StoredSimulator.stream": {"P": np.array([[1.0]])},
    "Modes.carried": {"position": np.array([0.1, 0.2]), "nodes": 0},
    "Modes.load": {"path": "modes.npz"},
    "Bounds.load": {"path": "saved.npz"},
    "Comparison.load": {"path": "saved.json"},
    "LimitCheck.load": {"path": "limits.npz"},
    "Tolerances.load": {"path": "tolerances.npz"},
    "Trajectory.load": {"path": "run.npz"},
    "Trajectory.reaction": {"joint": "hinge"},
    "System.reaction": {"name": "hinge"},
    "Parameters.__getitem__": {"name": "l"},
    "load_urdf": {"path": "arm.urdf"},
    "load_mjcf": {"path": "arm.xml"},
    "Rotation.__matmul__": {"other": mb.rotation(axis=(0, 0, 1), angle=0.1)},
    "FiniteElements.modes": {"clamped": 0, "count": 2},
}
"""Good values of parameters of some names only."""

Call = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]


def arguments(pieces: Mapping[str, Any]) -> dict[str, Any]:
    """Good values of parameters by their names, of the pieces of a small scene."""
    rod, ground, scene, box = pieces["rod"], pieces["ground"], pieces["scene"], pieces["box"]
    a, b = ground.point(0, 0), rod.point(0.5, 0)
    return {
        "scene": scene, "system": scene.system, "simulator": pieces["decay"], "subject": scene, "box": box, "times": T,
        "outputs": {"x": rod.x}, "output": "x", "name": "x", "names": ("x",), "path": "file.npz", "file": "file.npz",
        "folder": "folder", "method": mb.Vertex(), "methods": [mb.Vertex()], "reference": mb.Scanning(3),
        "solver": mb.CVODES(), "parameters": {"l": 1.0}, "parameter": "l", "time": 0.1, "P": np.array([[1.0, 5.0]]), "p": np.array([1.0, 5.0]),
        "p0": np.array([1.0, 5.0]), "directions": np.eye(2), "order": 2, "executor": None, "progress": None, "reduction": pieces["reduction"], "body": rod, "body_a": ground, "body_b": rod,
        "a": a, "b": b, "point": b, "point_a": a, "point_b": b, "joint": pieces["hinge"], "axis": (0, 0, 1), "angle": 0.3, "expression": rod.theta, "law": rod.theta, "symbol": rod.x,
        "x": 0.1, "y": 0.2, "z": 0.0, "count": 2, "tolerance": 1e-2, "clamped": 0, "values": (1.0, 2.0), "value": 0.5, "bounds": (0.5, 1.5), "lower": 0.5, "upper": 1.5,
        "mass": 1.0, "inertia": 0.1, "pose": mb.Planar(), "stiffness": 5.0, "damping": 0.1, "length": 0.5, "ratio": 2.0, "pitch": 0.1, "rate": lambda z: -z, "period": 0.1,
        "radius": 0.02, "elements": 2, "start": {"rod.theta": 0.1}, "guess": {"rod.x": 0.5}, "d": 2, "n": 3, "level": 2, "nominal": {"l": 1.0}, "spread": 0.05, "seed": 0, "size": 5, "spec": "pce:2",
        "stride": 1, "f": lambda **p: np.exp(-p["l"] * T), "run": pieces["run"], "command": ["true"], "templates": {"in.txt": "{k}"}, "read": "out.csv", "axes": None,
        "section": mb.Section.circle(0.02), "material": mb.Material(2e11, 7800.0, nu=0.3), "beams": pieces["beam"], "nodes": np.eye(3), "K": np.eye(9), "M": np.eye(9), "stiffness_matrix": np.eye(9),
        "inputs": ("l",), "share": 0.1, "threshold": 0.1, "samples": np.array([[1.0, 5.0]]), "indices": np.arange(2), "block": 2, "ranges": (0, 1), "range": mb.Exact(), "basis": mb.TotalDegree(),
        "coefficients": np.zeros((2, 1, 1)), "exponents": np.array([[0], [1]]), "model": "file.fmu", "restitution": 0.5, "exponent": 1.5, "step": 1e-3, "steps": 10, "degree": 3, "rule": mb.Gauss(),
        "radii": (0.01, 0.02), "points": [(0, 0, 0), (1, 0, 0)], "coordinate": "angle", "potential": 0.0, "force": (1.0, 0.0), "torque": 1.0, "gx": 0.0, "gy": -9.81, "gz": 0.0,
        "rows": (rod.vx,), "gap": rod.y, "width": 0.1, "height": 0.1, "thickness": 0.01, "E": 2e11, "density": 7800.0, "mode": 0, "frames": 3, "scale": 1.0, "alpha": 5.0, "beta": 5.0,
        "number": 0, "which": (0,), "data": {"x": 1.0}, "key": "x", "index": 0, "element": pieces["hinge"], "coordinates": None, "friction": 0.3, "normal": (0, 1, 0), "speed": 0.1,
    }  # fmt: skip


def calls(receivers: Mapping[str, Any], good: Mapping[str, Any], left_out: frozenset[str]) -> list[Call]:
    """Calls of the public names, of their class methods, and of the methods of receivers."""
    found: list[Call] = []
    for name in sorted(mb.__all__):
        public = getattr(mb, name)
        if (
            callable(public)
            and name not in left_out
            and not (inspect.isclass(public) and issubclass(public, Exception | Warning))
        ):
            found += filter(None, [_call(public, good)])
        if inspect.isclass(public):
            found += _methods(public, good, left_out, of_class=True)
    for receiver in receivers.values():
        found += _methods(receiver, good, left_out)
    return found


def _methods(owner: Any, good: Mapping[str, Any], left_out: frozenset[str], of_class: bool = False) -> Iterator[Call]:
    for name in dir(owner):
        if (name.startswith("_") and name not in ("__getitem__", "__call__", "__matmul__")) or name in left_out:
            continue
        raw = inspect.getattr_static(owner if of_class else type(owner), name, None)
        if (of_class and not isinstance(raw, classmethod | staticmethod)) or isinstance(raw, property):
            continue
        method = getattr(owner, name, None)
        if inspect.ismethod(method) or inspect.isfunction(method):
            call = _call(method, good)
            if call is not None:
                yield call


def _call(f: Callable[..., Any], good: Mapping[str, Any]) -> Call | None:
    """The function with good arguments; None if it has no parameters."""
    try:
        parameters = inspect.signature(f).parameters.values()
    except (ValueError, TypeError):
        return None
    args, options = [], {}
    receiver = getattr(f, "__self__", None)
    owner = receiver if inspect.isclass(receiver) else type(receiver)
    own = OF_OWNER.get(f.__qualname__, {}) | OF_OWNER.get(f"{owner.__name__}.{f.__name__}", {})
    for parameter in parameters:
        value = (good | own).get(
            parameter.name, None if parameter.default is inspect.Parameter.empty else parameter.default
        )
        if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD):
            if parameter.default is inspect.Parameter.empty:
                args.append(value)
            else:
                options[parameter.name] = parameter.default
        elif parameter.kind is parameter.KEYWORD_ONLY:
            options[parameter.name] = value
        elif parameter.kind is parameter.VAR_POSITIONAL and not args:
            args.append(value)
    return (f, tuple(args), options) if args or options else None
