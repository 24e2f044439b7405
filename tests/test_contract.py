"""Signatures that files outside this repository rely on, executed, and what its texts and workflows promise."""

import ast
import builtins
import doctest
import inspect
import re
import runpy
import tomllib
import typing
from concurrent.futures import ThreadPoolExecutor
from email.message import Message
from importlib.metadata import version
from pathlib import Path

import casadi as ca
import numpy as np
import planted_faults
import pytest
import sympy
import yaml
from faults import refused

import symmb as mb
from symmb import _citation

ROOT = Path(__file__).parents[1]
SHORT = np.linspace(0.0, 0.5, 6)


def text_of(path):
    return (ROOT / path).read_text(encoding="utf-8")


TABLES = tomllib.loads(text_of("pyproject.toml"))
PROJECT, README, HOST = TABLES["project"], text_of("README.md"), ROOT / ".github"


@pytest.fixture(scope="module")
def scene():
    """The double pendulum of Wang & Yang (2021), sec. 4.2, as its file declares it, with four outputs."""
    scene = runpy.run_path(str(ROOT / "models" / "double_pendulum.py"))["scene"]()
    rod1, rod2 = scene.system.bodies
    tip_y = rod2.point(0, scene.system.parameters.l2 / 2).y
    return scene.with_outputs({"x1": rod1.x, "theta1": -rod1.theta, "x2_dot": rod2.vx, "tip_y": tip_y})


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
    assert all(getattr(rod.point(0, 0.5), name).numel() == 1 for name in ("x", "y", "z", "vx", "vy", "vz"))
    assert ca.is_equal(mb.ddt(rod.x), rod.vx)
    top = mb.Body("top", mass=1.0, inertia=(1, 2, 3), pose=mb.Spatial())
    assert top.omega.shape == (3, 1) and top.z.is_symbolic()


def test_compiled_functions_take_q_v_p_t(scene, tmp_path):
    dae = mb.compile_dae(scene.system)
    for f in (dae.M, dae.Q, dae.Phi, dae.Phi_q, dae.gamma, dae.rhs):
        assert f.n_in() == 4
        f(np.zeros(6), np.zeros(6), [1.0, 1.0], 0.0)
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
    refused("Did you mean 'PolynomialChaos'", lambda: mb.PolynomalChaos, error=AttributeError)
    assert not hasattr(mb, "__wrapped__")
    assert mb.__version__ == version("symmb")


def test_the_version_of_the_checkout_is_that_of_the_citation_and_the_newest_of_the_changes():
    assert re.findall(r"^version: (.*)$", text_of("CITATION.cff"), re.MULTILINE) == [PROJECT["version"]]
    releases = re.findall(r"^## (.*)$", text_of("examples/guide/changes.md"), re.MULTILINE)
    assert releases[0] == PROJECT["version"]
    assert releases == sorted(releases, key=lambda name: [int(part) for part in name.split(".")], reverse=True)


def test_changes_are_dated_sentences_below_their_release():
    _, *releases = text_of("examples/guide/changes.md").split("\n## ")
    days = [day.split("\n", 1) for release in releases for day in release.split("\n### ")[1:]]
    dates = [date for date, _ in days]
    assert dates == sorted(set(dates), reverse=True)
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", date) for date in dates)
    entries = [entry for _, text in days for entry in f"\n{text.strip()}".split("\n- ")[1:]]
    assert len(entries) > 100
    assert not [entry for entry in entries if not re.match(r"(?s)(Added|Changed|Fixed|Removed): \S.*\.$", entry)]


def test_extras_that_texts_name_are_declared_and_all_has_those_of_runs():
    extras = PROJECT["optional-dependencies"]
    files = [*(ROOT / "symmb").rglob("*.py"), *(ROOT / "examples").rglob("*.md"), ROOT / "README.md", ROOT / ".ci/run"]
    parts = [part for path in files for part in re.findall(r"(?:symmb|\.)\[([a-z,]+)\]'", text_of(path))]
    named = {name for part in parts for name in part.split(",")}
    assert {"all", "compiler", "data", "fmu"} <= named <= set(extras)
    assert extras["all"] == [f"symmb[{','.join(sorted(set(extras) - {'all', 'dev', 'docs', 'test'}))}]"]


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
    free = {name for name, _, own in signatures() if own and {a.kind.name for a in own} <= of_any_name}
    assert free == {"Box", "Parameters"}


def test_arguments_of_elements_that_may_be_none_have_a_default():
    kinds = [own for own in signatures() if inspect.isclass(own[1]) and own[1].__module__.startswith("symmb.declare.")]
    assert {"Stop", "Coulomb", "Body", "Box3"} <= {name for name, *_ in kinds}
    arguments = [(name, a) for name, _, own in kinds for a in own]
    assert not [(name, a.name) for name, a in arguments if "None" in str(a.annotation) and a.default is a.empty]


def names_without_import(text):
    """Names that the examples of a docstring use, and neither import nor define."""
    known, missing = {*dir(builtins)}, set()
    for example in doctest.DocTestParser().get_examples(text):
        nodes = [*ast.walk(ast.parse(example.source))]
        names = [node for node in nodes if isinstance(node, ast.Name)]
        known |= {name.id for name in names if isinstance(name.ctx, ast.Store)}
        known |= {node.arg for node in nodes if isinstance(node, ast.arg)}
        known |= {node.name for node in nodes if isinstance(node, ast.ExceptHandler | ast.FunctionDef | ast.ClassDef)}
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


WORKFLOWS = {path.stem: yaml.safe_load(text_of(path)) for path in HOST.glob("workflows/*.yml")}


@pytest.mark.parametrize("name", WORKFLOWS)
def test_jobs_have_limits_and_steps(name):
    workflow = WORKFLOWS[name]
    assert workflow["name"] == name and workflow["permissions"] == {"contents": "read"}
    for job in workflow["jobs"].values():
        assert job["runs-on"] and all(("uses" in step) != ("run" in step) for step in job["steps"])
        assert all(re.fullmatch(r"[\w./-]+@[\w./]+", step["uses"]) for step in job["steps"] if "uses" in step)
        assert "timeout-minutes" in job or not any("run" in step for step in job["steps"])
        assert set(job.get("needs", "").split()) <= set(workflow["jobs"])


def commands(name):
    return [step.get("run", "") for job in WORKFLOWS[name]["jobs"].values() for step in job["steps"]]


def test_workflows_run_what_texts_say_on_all_systems():
    texts = README + text_of(HOST / "CONTRIBUTING.md")
    for command in ("python -m pytest -q -n 2", "sphinx-build -W -b html examples/guide build/site", ".ci/run"):
        assert command in texts and any(command in run for name in WORKFLOWS for run in commands(name))
    for name in WORKFLOWS:
        for path in re.findall(r"\.ci/\w+", " ".join(commands(name))):
            assert (ROOT / path).stat().st_mode & 0o100
    matrix = WORKFLOWS["tests"]["jobs"]["fast"]["strategy"]["matrix"]
    assert matrix["os"] == ["ubuntu-latest", "macos-latest"]
    prefix = "Programming Language :: Python :: 3."
    classifiers = [classifier for classifier in PROJECT["classifiers"] if classifier.startswith(prefix)]
    assert [f"{prefix}{version.removeprefix('3.')}" for version in matrix["python"]] == classifiers


def test_a_tag_publishes_what_the_checks_have_seen(monkeypatch):
    build, publish = WORKFLOWS["release"]["jobs"].values()
    assert WORKFLOWS["release"][True] == {"push": {"tags": ["v*"]}}  # YAML reads the key `on` as true
    assert publish["permissions"] == {"id-token": "write"} and "password" not in str(publish)
    names = [step["uses"].split("@")[0] for step in publish["steps"]]
    assert names == ["actions/download-artifact", "pypa/gh-action-pypi-publish"]
    kept = [step["with"] for step in build["steps"] if "upload-artifact" in step.get("uses", "")]
    assert [kept[0]["name"], kept[0]["path"]] == [publish["steps"][0]["with"][key] for key in ("name", "path")]
    tag = next(step for step in build["steps"] if "TAG" in step.get("env", {}))
    code = re.sub(r'^python -c "|"$', "", tag["run"].strip())
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("TAG", f"v{PROJECT['version']}")
    exec(code)
    monkeypatch.setenv("TAG", "v9.9.9")
    with pytest.raises(AssertionError):
        exec(code)


@pytest.mark.parametrize("path", sorted(HOST.glob("ISSUE_TEMPLATE/[!c]*.yml")), ids=lambda path: path.stem)
def test_templates_ask_for_something(path):
    form = yaml.safe_load(text_of(path))
    assert form["name"] and form["description"] and form["labels"]
    names = [part["id"] for part in form["body"]]
    assert len(set(names)) == len(names) and any(part.get("validations") for part in form["body"])
    assert all(part["type"] in ("input", "textarea") and part["attributes"]["label"] for part in form["body"])


def test_the_citation_is_that_of_the_file():
    data = yaml.safe_load(text_of("CITATION.cff"))
    url = PROJECT["urls"].get("Repository", PROJECT["urls"].get("Homepage"))
    fields = dict(re.findall(r"^  (\w+) = \{(.*)\},$", mb.__citation__, re.MULTILINE))
    assert fields == {
        "author": "{The symmb authors}",
        "title": data["title"].replace("symmb", "{symmb}", 1),
        "year": str(data["date-released"].year),
        "version": data["version"],
        "license": data["license"],
    } | ({"url": url} if url else {})
    assert data["authors"] == [{"name": author["name"]} for author in PROJECT["authors"]]
    assert f"```bibtex\n{mb.__citation__}\n```" in README


def test_a_wheel_has_the_citation(tmp_path, monkeypatch):
    wheel = TABLES["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["force-include"] == {"CITATION.cff": "symmb/CITATION.cff"}
    text = text_of("CITATION.cff").replace("symmb:", "another:")
    (tmp_path / "CITATION.cff").write_text(text, encoding="utf-8")
    monkeypatch.setattr(_citation, "_PACKAGE", tmp_path)
    assert "title = {another:" in mb.__citation__


@pytest.mark.parametrize(
    ("named", "url"),
    [
        ([], None),
        (["Documentation, https://a.org/docs"], None),
        (["Homepage, https://a.org", "Repository, https://b.org/x, y"], "https://b.org/x, y"),
        (["Homepage, https://a.org"], "https://a.org"),
    ],
)
def test_the_citation_takes_the_address_of_the_metadata(named, url, monkeypatch):
    metadata = Message()
    for text in named:
        metadata["Project-URL"] = text
    monkeypatch.setattr(_citation, "metadata", lambda name: metadata)
    assert ("url" in mb.__citation__) == (url is not None)
    assert url is None or f"  url = {{{url}}},\n" in mb.__citation__


def test_readme_claims_no_address_but_those_of_the_project():
    urls = [url for url in re.findall(r"https?://[^\s)\"]+", README)]
    assert {*urls} == {*PROJECT["urls"].values()}
    assert ("the repository that you cloned" in README) == (not PROJECT["urls"])


@pytest.mark.parametrize("fault", planted_faults.FAULTS, ids=lambda fault: fault.name)
def test_a_planted_fault_has_its_place_and_its_tests(fault):
    assert fault.before != fault.after
    assert text_of(fault.file).count(fault.before) == 1
    assert all((ROOT / "tests" / room).is_dir() for room in fault.rooms.split())


def test_types_of_public_functions_are_known_when_asked():
    for name in mb.__all__:
        function = getattr(mb, name)
        if inspect.isfunction(function):
            assert typing.get_type_hints(function), name
