"""Every signature that scene files and scripts outside this repository rely on, executed."""

import ast
import builtins
import doctest
import inspect
import re
import tomllib
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy

import symmb as mb
from symmb.show.cli.specs import method, solver

ROOT = Path(__file__).parents[1]
SCENE = '''
"""Planar double pendulum of two homogeneous rods (Wang & Yang 2021, sec. 4.2)."""
import numpy as np
import symmb as mb

def scene():
    p = mb.Parameters(l1=1.0, l2=1.0)                    # nominal values [m]; p.l1 is a CasADi SX symbol
    ground = mb.Ground()
    rod1 = mb.Body("rod1", mass=p.l1, inertia=p.l1**3 / 12, pose=mb.Planar())    # 1 kg/m
    rod2 = mb.Body("rod2", mass=p.l2, inertia=p.l2**3 / 12, pose=mb.Planar())
    system = mb.System(
        rod1, rod2,
        mb.Revolute("shoulder", ground.point(0, 0), rod1.point(0, -p.l1 / 2)),
        mb.Revolute("elbow", rod1.point(0, p.l1 / 2), rod2.point(0, -p.l2 / 2)),
        mb.Gravity(0, 9.81),                             # the paper's y points down
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"rod1.theta": -np.pi / 4, "rod2.theta": -np.pi / 3},
        times=np.linspace(0.0, 10.0, 1001),
        outputs={"x1": rod1.x, "theta1": -rod1.theta, "x2_dot": rod2.vx, "tip_y": rod2.point(0, p.l2 / 2).y},
        box=mb.Box.around(p, 0.05),
    )
'''
SHORT = np.linspace(0.0, 0.5, 6)


@pytest.fixture(scope="module")
def scene():
    namespace = {}
    exec(SCENE, namespace)
    return namespace["scene"]()


def test_system_gives_vectors_matrices_and_reactions(scene):
    system = scene.system
    assert [v.numel() for v in (system.q, system.v, system.p, system.lam)] == [6, 6, 2, 4]
    shapes = {"M": (6, 6), "N": (6, 6), "Q": (6, 1), "Phi": (4, 1), "Phi_q": (4, 6), "Phi_t": (4, 1), "gamma": (4, 1)}
    assert {name: getattr(system, name).shape for name in shapes} == shapes
    assert all(isinstance(getattr(system, name), ca.SX) for name in (*shapes, "q", "v", "p", "lam"))
    assert system.lam("elbow").shape == (2, 1)
    reaction = system.reaction("elbow")
    assert reaction.force.shape == reaction.torque.shape == (3, 1)
    assert isinstance(system.to_sympy()["M"], sympy.MatrixBase)
    assert r"\Phi" in system.latex()
    assert "n_q = 6" in str(system)


def test_names_of_bodies_are_symbols_or_plain_combinations(scene):
    rod = scene.system.bodies[0]
    assert all(getattr(rod, name).is_symbolic() for name in ("x", "y", "theta", "vx", "vy", "omega"))
    tip = rod.point(0, 0.5)
    assert all(getattr(tip, name).numel() == 1 for name in ("x", "y", "z", "vx", "vy", "vz"))
    assert ca.is_equal(mb.ddt(rod.x), rod.vx)
    top = mb.Body("top", mass=1.0, inertia=(1, 2, 3), pose=mb.Spatial())
    assert top.omega.shape == (3, 1) and top.z.is_symbolic()


def test_compiled_functions_take_q_v_p_t(scene, tmp_path):
    dae = mb.compile_dae(scene.system)
    q, v = np.zeros(6), np.zeros(6)
    for f in (dae.M, dae.Q, dae.Phi, dae.Phi_q, dae.gamma, dae.rhs):
        assert f.n_in() == 4
        f(q, v, [1.0, 1.0], 0.0)
    assert {file.name for file in dae.save_c(tmp_path / "c")} >= {"model.c", "model.h", "main.c"}


def test_simulate_takes_solver_parameters_times_outputs(scene):
    rod1 = scene.system.bodies[0]
    traj = mb.simulate(scene, solver=None, parameters=None, times=SHORT)
    assert traj["x1"].shape == traj(rod1.x**2).shape == traj.t.shape == (6,)
    assert traj.q.shape == traj.v.shape == (6, 6) and traj.lam.shape == (6, 4)
    assert traj.drift.position.shape == traj.energy.kinetic.shape == (6,)
    assert "start" in traj.statistics
    other = mb.simulate(scene, mb.IDAS(rtol=1e-8), {"l1": 1.02}, times=SHORT, outputs={"half": rod1.x / 2})
    assert other.names == ("half",)


@pytest.mark.parametrize(
    "made, runs",
    [
        (mb.PolynomialChaos.paper(order=2), 9), (mb.PolynomialChaos(order=4), 25), (mb.Taylor(order=2), 6),
        (mb.MonteCarlo(50, seed=0), 50), (mb.Scanning(5), 25), (mb.Vertex(), 4),
    ],
    ids=repr,
)  # fmt: skip
def test_propagate_gives_bounds(scene, made, runs):
    bounds = mb.propagate(scene.with_times(SHORT), made, box=None, solver=None, executor=None)
    assert bounds.evaluations == runs
    assert bounds.lower.shape == bounds.upper.shape == (6, 4)
    assert bounds.names == ("x1", "theta1", "x2_dot", "tip_y")
    assert bounds.kind in ("enclosure", "estimate", "sampled")
    assert (bounds.outer[0] <= bounds.lower).all() and bounds.seconds > 0 and not bounds.failed
    with ThreadPoolExecutor(2) as executor:
        again = mb.propagate(mb.DAESimulator(scene.with_times(SHORT)), made, box=scene.box, executor=executor)
    np.testing.assert_array_equal(again.lower, bounds.lower)


def test_adaptive_polynomial_chaos_meets_its_tolerance_or_budget(scene):
    short = scene.with_times(SHORT)
    bounds = mb.propagate(short, mb.PolynomialChaos())
    width = bounds.upper - bounds.lower
    assert bounds.estimate is not None and bounds.estimate[1:].max() < 0.05 * width[1:].max()
    assert mb.propagate(short, mb.PolynomialChaos(tolerance=1e-3)).evaluations >= bounds.evaluations
    assert mb.propagate(short, mb.PolynomialChaos(budget=30)).evaluations <= 30


def test_function_simulator_and_scene_without_bodies():
    simulator = mb.FunctionSimulator(lambda k: np.exp(-k * SHORT)[:, None], {"k": 1.0}, SHORT, ["x"])
    assert mb.propagate(simulator, mb.Scanning(5), mb.Box(k=(0.5, 2.0))).upper[-1, 0] == pytest.approx(np.exp(-0.25))
    p = mb.Parameters(x=0.5)
    cubic = mb.Scene(mb.System(parameters=p), outputs={"f": p.x**3 - 2 * p.x**2 + p.x + 0 * mb.t}, box=mb.Box(x=(0, 1)))
    bounds = mb.propagate(cubic, mb.IntervalArithmetic())
    assert (bounds.lower[0, 0], bounds.upper[0, 0]) == pytest.approx((-2, 2), abs=1e-12)


@pytest.mark.parametrize(
    "spec, made",
    [
        ("pce:2:paper", mb.PolynomialChaos.paper(order=2)), ("pce:4", mb.PolynomialChaos(order=4)),
        ("pce", mb.PolynomialChaos()), ("pce:tol=1e-3", mb.PolynomialChaos(tolerance=1e-3)),
        ("pce:budget=200", mb.PolynomialChaos(budget=200)), ("taylor:2", mb.Taylor(order=2)),
        ("mc:10000", mb.MonteCarlo(10_000, seed=0)), ("scan:21", mb.Scanning(21)),
    ],
)  # fmt: skip
def test_specs_of_methods(spec, made):
    assert method(spec) == made


@pytest.mark.parametrize(
    "spec, made",
    [
        ("idas", mb.IDAS()), ("idas:1e-10", mb.IDAS(rtol=1e-10)), ("cvodes:1e-8", mb.CVODES(rtol=1e-8)),
        ("collocation", mb.Collocation()), ("rk", mb.RungeKutta()), ("nstiff-si2:5e-3", mb.NSTIFFSI2(step=5e-3)),
        ("gen-alpha", mb.GeneralizedAlpha()), ("hht", mb.HHT()),
    ],
)  # fmt: skip
def test_specs_of_solvers(spec, made):
    assert solver(spec) == made


def test_spatial_scene_with_rotations_every_joint_and_force_constructs():
    p = mb.Parameters(k=100.0, m=1.0)
    ground, box = mb.Ground(), (0.1, 0.2, 0.3)
    top = mb.Body("top", mass=p.m, inertia=box, pose=mb.Spatial(), com=(0.0, 0.0, 0.1))
    rod = mb.Body("rod", mass=1.0, inertia=0.1, pose=mb.Planar())
    ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    a, b = ground.point(0, 0, 0), top.point(0, 0, 0)
    joints = [
        mb.Revolute("r", a, b), mb.Prismatic("p", a, b, axis=(1, 0, 0)), mb.Cylindrical("c", a, b, axis=(0, 1, 0)),
        mb.Spherical("s", a, b), mb.Universal("u", a, b, axis=(1, 0, 0), axis_b=(0, 1, 0)),
        mb.PlanarJoint("pl", a, b, axis=(0, 0, 1)), mb.Weld("w", a, b), mb.Distance("d", a, top.point(0, 0, 1), 1.0),
        mb.PointOnLine("l", a, b, axis=(1, 0, 0)), mb.Gear("g", a, b, ratio=2.0), mb.Screw("sc", a, b, pitch=0.1),
        mb.Motion("m", top.x, ca.sin(mb.t)),
    ]  # fmt: skip
    for joint in joints:
        assert mb.System(top, joint, parameters=p).Phi.numel() > 0
    forces = [
        mb.Gravity(0, -9.81), mb.Spring("k", a, ball.point(0, 0), p.k, 1.0), mb.Damper("c", a, ball.point(0, 0), 2.0),
        mb.SpringDamper("kc", a, rod.point(0, 0), p.k, 1.0, 0.5), mb.TorsionSpring("t", ground, rod, 5.0, damping=0.1),
        mb.Bushing("b", a, top.point(0, 0, 0), 10.0), mb.Force("f", rod.point(0, 1), (1, ca.cos(mb.t))),
        mb.Torque("tz", rod, 1.0), mb.Torque("txyz", top, (1, 0, 0)),
    ]  # fmt: skip
    rotation = mb.rotation(axis=(0, 0, 1), angle=0.3) @ mb.rotation(axis=(1, 0, 0), angle=0.1)
    start = {"top.x": 0.1, "top.vx": 0.2, "top.rotation": rotation, "top.omega": (0, 0, 1), "ball.x": 1.0, "rod.x": 0.5}
    scene = mb.Scene(mb.System(top, rod, ball, *forces, parameters=p), start=start, times=SHORT)
    assert np.isfinite(mb.simulate(scene).values).all()


def test_joints_are_handles_for_motors_stops_states_and_controllers():
    p = mb.Parameters(a=0.3)
    ground, link = mb.Ground(), mb.Body("link", 1.0, (0.1, 0.1, 0.1), mb.Spatial())
    cart = mb.Body("cart", 1.0, (0.1, 0.1, 0.1), mb.Spatial())
    elbow = mb.Revolute("elbow", ground.point(0, 0, 0), link.point(0, 0, 0))
    slide = mb.Prismatic("slide", link.point(0, 0, 0), cart.point(0, 0, 0), axis=(1, 0, 0))
    z = mb.State("z", rate=lambda z: (elbow.angle - z) / 0.1)
    u = mb.Sampled("u", period=0.01, law=-elbow.angle_rate)
    elements = [
        mb.Actuator("motor", elbow, u.value + z.value), mb.Stop("limit", slide, -1.0, 1.0, mb.KelvinVoigt(1e3)),
        mb.Stop("end", elbow, None, 2.0, restitution=0.5),
    ]  # fmt: skip
    system = mb.System(link, cart, elbow, slide, z, u, *elements, parameters=p)
    start = {"elbow.angle": p.a, "elbow.angle_rate": 1.0, "slide.displacement": 0.1, "z": 0.2}
    handles = (elbow.angle, elbow.angle_rate, slide.displacement, slide.displacement_rate, z.value, u.value)
    outputs = {str(i): handle for i, handle in enumerate(handles)}
    scene = mb.Scene(system, start, SHORT, outputs, guess={"slide.displacement": 0.0})
    np.testing.assert_allclose(mb.simulate(scene).values[0], [0.3, 1.0, 0.1, 0.0, 0.2, -1.0], atol=1e-12)


def test_compare_in_python(scene, tmp_path):
    methods = [mb.PolynomialChaos.paper(order=2), mb.Vertex()]
    comparison = mb.compare(scene, methods, box=None, reference=mb.Scanning(7), solver=mb.RungeKutta(), times=SHORT)
    assert "Vertex()" in str(comparison)
    comparison.save(tmp_path / "c.json")
    comparison.plot(tmp_path / "c.png")
    assert mb.Comparison.load(tmp_path / "c.json").rows[0].evaluations == 9


def test_names_that_are_nearly_right_and_the_version():
    with pytest.raises(AttributeError, match="Did you mean 'PolynomialChaos'"):
        mb.PolynomalChaos  # noqa: B018
    assert not hasattr(mb, "__wrapped__")
    assert mb.__version__ == version("symmb")


def test_the_version_of_the_checkout_is_that_of_the_citation_and_the_newest_of_the_changes():
    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("CITATION.cff", "examples/guide/changes.md")}
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert re.findall(r"^version: (.*)$", texts["CITATION.cff"], re.MULTILINE) == [declared]
    releases = re.findall(r"^## (.*)$", texts["examples/guide/changes.md"], re.MULTILINE)
    assert releases[0] == declared and releases == sorted(releases, key=_parts, reverse=True)


def test_changes_are_dated_sentences_below_their_release():
    _, *releases = (ROOT / "examples/guide/changes.md").read_text(encoding="utf-8").split("\n## ")
    days = [day.split("\n", 1) for release in releases for day in release.split("\n### ")[1:]]
    dates = [date for date, _ in days]
    assert dates == sorted(set(dates), reverse=True)
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", date) for date in dates)
    entries = [entry for _, text in days for entry in f"\n{text.strip()}".split("\n- ")[1:]]
    assert len(entries) > 100
    assert not [entry for entry in entries if not re.match(r"(?s)(Added|Changed|Fixed): \S.*\.$", entry)]


def test_extras_that_texts_name_are_declared_and_all_has_those_of_runs():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    files = [*(ROOT / "symmb").rglob("*.py"), *(ROOT / "examples").rglob("*.md"), ROOT / "README.md", ROOT / ".ci/run"]
    texts = [path.read_text(encoding="utf-8") for path in files]
    named = {n for text in texts for part in re.findall(r"(?:symmb|\.)\[([a-z,]+)\]'", text) for n in part.split(",")}
    assert {"all", "compiler", "data", "fmu"} <= named <= set(extras)
    assert extras["all"] == [f"symmb[{','.join(sorted(set(extras) - {'all', 'docs', 'test'}))}]"]


def test_help_lists_each_public_name_once_by_subject():
    listed = re.findall(r"\w+", "".join(re.findall(r"^ {4}.*$", mb.__doc__, re.MULTILINE)))
    assert sorted(listed) == sorted(set(dir(mb)) - {"__citation__", "__version__", "models"})


WITHOUT_EXAMPLE = {"t"}
"""A symbol of CasADi, which has a docstring of its own. Its page has an example."""


def test_public_names_have_examples_and_numpydoc_layout():
    docs = {name: inspect.getdoc(getattr(mb, name)) or "" for name in mb.__all__}
    assert {name for name, text in docs.items() if "\nExamples\n--------\n" not in text} == WITHOUT_EXAMPLE
    for name, text in docs.items():
        for title, section in re.findall(r"^(\w+)\n-{3,}\n(.*?)(?=\n\n|\Z)", text, re.MULTILINE | re.DOTALL):
            entries = [line for line in section.split("\n") if title != "Examples" and not line.startswith(" ")]
            assert not [line for line in entries if re.search(r"\S {2,}\S", line)], f"{name}: {title}"


def signatures():
    """Of public classes and functions, without errors and warnings, which take a text."""
    for name in mb.__all__:
        public = getattr(mb, name)
        if callable(public) and not (inspect.isclass(public) and issubclass(public, Exception)):
            yield name, public, inspect.signature(public).parameters.values()


def test_signatures_name_the_arguments():
    """`Parameters(l1=1.0)` and `Box(l1=(0.9, 1.1))` take names of the user."""
    of_any_name = {"VAR_POSITIONAL", "VAR_KEYWORD"}
    assert {name for name, _, own in signatures() if own and {a.kind.name for a in own} <= of_any_name} == {
        "Box",
        "Parameters",
    }


def test_arguments_of_elements_that_may_be_none_have_a_default():
    own = [(name, arguments) for name, kind, arguments in signatures() if inspect.isclass(kind) and is_declared(kind)]
    assert {"Stop", "Coulomb", "Body", "Box3"} <= {name for name, _ in own}
    needless = {(name, a.name) for name, arguments in own for a in arguments if "None" in str(a.annotation)}
    needless -= {(name, a.name) for name, arguments in own for a in arguments if a.default is not a.empty}
    assert not needless


def is_declared(kind):
    return kind.__module__.startswith("symmb.declare.")


def names_without_import(text):
    """Names that the examples of a docstring use, and neither import nor define."""
    known, missing = {*dir(builtins)}, set()
    for example in doctest.DocTestParser().get_examples(text):
        nodes = [*ast.walk(ast.parse(example.source))]
        names = [node for node in nodes if isinstance(node, ast.Name)]
        known |= {name.id for name in names if isinstance(name.ctx, ast.Store)}
        known |= {node.arg for node in nodes if isinstance(node, ast.arg)}
        known |= {node.name for node in nodes if isinstance(node, ast.ExceptHandler | ast.FunctionDef)}
        known |= {(node.asname or node.name).split(".")[0] for node in nodes if isinstance(node, ast.alias)}
        missing |= {name.id for name in names} - known
    return missing


def test_names_without_import_are_found():
    assert names_without_import(">>> import numpy as np\n>>> y = np.sin(x)\n>>> f = lambda a: a + y") == {"x"}


def test_examples_of_public_names_run_alone():
    """A reader copies them: what they use is imported by them."""
    missing = {}
    for name in mb.__all__:
        public = getattr(mb, name)
        methods = vars(public) if inspect.isclass(public) else {}
        own = {f"{name}.{k}": getattr(v, "__func__", v) for k, v in methods.items() if not k.startswith("_")}
        for place, value in {name: public, **own}.items():
            missing[place] = names_without_import(inspect.getdoc(value) or "")
    assert not {place: names for place, names in missing.items() if names}


def _parts(version):
    return [int(part) for part in version.split(".")]
