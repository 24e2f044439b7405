"""The command line from outside: what it prints and writes, how it refuses, and the methods that it knows."""

import csv
import inspect
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from faults import printed, refused, refused_command

import symmb as mb
from symmb.bound.methods.method import Method
from symmb.run.integrate.solver import Solver
from symmb.show.cli import specs
from symmb.show.cli.main import main
from symmb.show.cli.scene_file import load_scene, shipped_names

PENDULUM = """
import numpy as np
import symmb as mb

def scene():
    p = mb.Parameters(l=1.0, damping=0.0)
    rod = mb.Body("rod", mass=2.0, inertia=p.l**2 / 6, pose=mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(0, -p.l / 2))
    friction = mb.Torque("friction", rod, -p.damping * rod.omega)
    system = mb.System(rod, hinge, mb.Gravity(0, 9.81), friction, parameters=p)
    times, outputs = np.linspace(0.0, 0.5, 6), {"theta": rod.theta, "x": rod.x}
    return mb.Scene(system, {"rod.theta": 0.5}, times, outputs, box=mb.Box(l=(0.9, 1.1)), name="pendulum")
"""
CUBIC = """
import symmb as mb

def scene():
    p = mb.Parameters(x=1.0, y=0.0)
    f, box = {"f": p.x * mb.t + p.y}, mb.Box(x=(0.5, 1.5), y=(-1.0, 1.0))
    return mb.Scene(mb.System(parameters=p), times=[0.0, 1.0, 2.0], outputs=f, box=box, name="cubic")
"""


@pytest.fixture
def scene(tmp_path):
    """Writes a scene file and gives its path."""
    path = tmp_path / "scene_file.py"
    return lambda text: path.write_text(text) and str(path)


def test_compare_prints_and_writes(scene, tmp_path, capsys):
    json_file, whole, picture = (str(tmp_path / name) for name in ("c.json", "c.npz", "c.png"))
    methods = ["vertex", "pce:2:paper", "mc:20"]
    arguments = ["compare", scene(CUBIC), "--methods", *methods, "--json", json_file, "--plot", picture]
    told = printed(capsys, *arguments, "--save", whole)
    assert "PolynomialChaos.paper(order=2)" in told and "sampled" in told
    layout = json.loads(Path(json_file).read_text())
    names = ["Vertex()", "PolynomialChaos.paper(order=2)", "MonteCarlo(20)"]
    assert [method["name"] for method in layout["methods"]] == names
    assert layout["box"] == {"x": [0.5, 1.5], "y": [-1.0, 1.0]}
    assert set(layout) >= {"scene", "times", "outputs", "box", "solver", "reference", "methods"}
    loaded = mb.Comparison.load(whole)
    np.testing.assert_allclose(loaded.rows[0].lower, [[-1.0], [-0.5], [0.0]])
    for row, method in zip(loaded.rows, layout["methods"], strict=True):  # the table, without bounds over time
        assert row.score.error.tolist() == method["error"] and row.evaluations == method["evaluations"]
        assert "lower" not in method and "inner_upper" not in method
    refused("reference/lower is missing", mb.Comparison.load, json_file)
    assert Path(picture).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("spread", ["20%", "0.2"])
def test_spread_replaces_the_box(scene, tmp_path, spread, capsys):
    json_file = tmp_path / "c.json"
    arguments = ["compare", scene(PENDULUM), "--spread", spread, "--methods", "vertex", "--json", str(json_file)]
    assert main([*arguments, "--solver", "cvodes:1e-6"]) == 0
    layout = json.loads(json_file.read_text())
    assert layout["box"] == {"l": pytest.approx([0.8, 1.2])}  # damping is not boxed in the scene
    assert layout["solver"] == "CVODES(rtol=1e-06)"


def test_simulate_prints_and_writes(scene, tmp_path, capsys):
    json_file, table, picture = tmp_path / "t.json", tmp_path / "t.csv", tmp_path / "t.png"
    arguments = ["simulate", scene(PENDULUM), "--set", "l=1.02", "damping=0.1", "--solver", "idas"]
    assert main([*arguments, "--json", str(json_file), "--csv", str(table), "--plot", str(picture)]) == 0
    layout = json.loads(json_file.read_text())
    drifts = {f"{kind}_drift" for kind in ("position", "velocity", "energy")}
    assert {*layout} >= drifts | {*"scene times outputs values solver statistics setup_seconds run_seconds".split()}
    rows = list(csv.reader(io.StringIO(table.read_text())))
    assert rows[0] == ["t", "theta", "x"]
    expected = np.column_stack([layout["times"], layout["values"]])
    np.testing.assert_array_equal(np.array(rows[1:], dtype=float), expected)
    assert layout["values"][0][0] == pytest.approx(0.5)
    assert layout["solver"] == "IDAS()"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "l = 1.02" in capsys.readouterr().out


def test_simulate_tells_the_extremes_of_every_output(scene, capsys):
    lines = printed(capsys, "simulate", scene(CUBIC), "--set", "x=1.0", "--set", "y=-0.5").splitlines()
    assert lines[-2].split() == ["output", "at", "0", "s", "at", "2", "s", *"lowest at [s] highest at [s]".split()]
    assert lines[-1].split() == ["f", "-0.5", "1.5", "-0.5", "0", "1.5", "2"]


def test_rounding_is_told_as_zero(scene, capsys):
    own = '{"large": 1e9 * (1 + mb.t), "from_zero": mb.t + 1e-16, "small": 1e-9 * mb.t, "nothing": 1e-49 + 0 * mb.t}'
    lines = printed(capsys, "simulate", scene(CUBIC.replace('{"f": p.x * mb.t + p.y}', own))).splitlines()[-4:]
    told = {name: numbers for name, *numbers in map(str.split, lines)}
    assert told["from_zero"] == ["0", "2", "0", "0", "2", "2"]
    assert told["small"] == ["0", "2e-09", "0", "0", "2e-09", "2"]
    assert told["nothing"] == ["0"] * 4


def test_equations(scene, capsys):
    told = printed(capsys, "equations", scene(PENDULUM))
    assert "1 Revolute" in told
    for part in ("[M  Φ_qᵀ; Φ_q  0] [q̈; λ] = [Q; γ]", "M = ", "19.62", "-damping⋅ω_rod", "Φ = ", "Φ_q = ", "γ = "):
        assert part in told
    assert "Φ_t" not in told
    assert r"\Phi_q = " in printed(capsys, "equations", scene(PENDULUM), "--latex")


def test_equations_that_are_long_are_printed_by_entries(capsys):
    told = printed(capsys, "equations", "andrews", "--joint")
    assert re.search(r"^M\[q̇_\w+, q̇_\w+\] = ", told, re.MULTILINE) and re.search(r"^Φ_q\[λ_", told, re.MULTILINE)
    for name in ("double_pendulum", "half_car", "cubic"):
        told = printed(capsys, "equations", name)
        assert told.startswith("System")
    assert "M =" not in told


@pytest.mark.parametrize("command", ["compare", "simulate", "equations", "codegen"])
def test_usage_has_the_scene_first(capsys, command):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert capsys.readouterr().out.startswith(f"usage: symmb {command} SCENE ")


def test_codegen_lists_the_files_it_wrote(scene, tmp_path, capsys):
    folder = tmp_path / "generated"
    written = [Path(line) for line in printed(capsys, "codegen", scene(PENDULUM), "-o", str(folder)).splitlines()]
    assert {path.suffix for path in written} == {".c", ".h"}
    assert sorted(written) == sorted(folder.iterdir())


def test_a_scene_finds_itself_and_its_neighbours(scene, tmp_path, capsys):
    (tmp_path / "neighbour_of_scene.py").write_text("LENGTH = 2.5\n")
    (tmp_path / "start.txt").write_text("0.25")
    text = """
        from pathlib import Path
        import symmb as mb
        from neighbour_of_scene import LENGTH

        def scene():
            start = float((Path(__file__).parent / "start.txt").read_text())
            system = mb.System(parameters=mb.Parameters(p=1.0))
            return mb.Scene(system, times=[0.0], outputs={"f": start * LENGTH + 0 * mb.t})
    """
    before = list(sys.path)
    told = printed(capsys, "simulate", scene(text.replace("\n        ", "\n")))
    assert told.splitlines()[-1].split()[:2] == ["f", "0.625"]
    assert sys.path == before


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_scenes_go_by_name(name):
    assert load_scene(name).outputs


def test_the_installed_command_runs_from_a_process(scene):
    command = [sys.executable, "-m", "symmb", "equations", scene(PENDULUM)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


NO_SPREADS = "0", "-5%", "nan"
EMPTY = "import symmb as mb\ndef scene():\n    "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((text, r"defines no function scene\(\)") for text in ("x = 1\n", "scene = 3\n")),
        ("def scene(:\n", r"SyntaxError: [^(]*\(scene_file\.py, line 1\)\.$"),
        ("import no_such_module_at_all\n", r"ModuleNotFoundError: .*no_such_module_at_all.* \(line 1\)\."),
        ("def scene():\n    x = 0\n    return 1 / x\n", r"ZeroDivisionError: division by zero \(line 3\)\."),
        ("def scene(length):\n    pass\n", r"TypeError: .*length"),
        ("import sys\nsys.exit(3)\n", r"SystemExit: 3 \(line 2\)\."),
        (EMPTY + "return mb.System()\n", r"scene\(\) returned a System"),
        (PENDULUM.replace("np.linspace(0.0, 0.5, 6)", "[]"), "times"),
        (PENDULUM.replace("np.linspace(0.0, 0.5, 6)", "[0.0, 2.0, 1.0]"), "times"),
        (PENDULUM.replace("np.linspace(0.0, 0.5, 6)", "[0.0, np.nan]"), "NaN"),
        (PENDULUM.replace("l=(0.9, 1.1)", "l=(1.1, 0.9)"), "lower 1.1 above upper 0.9"),
        (PENDULUM.replace("l=(0.9, 1.1)", "l=(0.9, np.nan)"), "finite"),
        (PENDULUM.replace("l=(0.9, 1.1)", "length=(0.9, 1.1)"), "'length'"),
        (PENDULUM.replace("l=1.0,", "l=np.nan,"), "nan"),
        (PENDULUM.replace('"x": rod.x', '"x": p.length'), "length"),
        (PENDULUM.replace('"rod.theta"', '"rod.theat"'), "Did you mean 'rod.theta'"),
    ],
)
@pytest.mark.parametrize("command", ["simulate", "compare"])
def test_scenes_that_are_wrong(scene, capsys, command, text, words):
    path = scene(text)
    error = refused_command(capsys, command, path)
    assert re.search(words, error) and path in error and error.startswith(f"symmb {command}: ")


def test_a_line_is_told_of_a_scene_given_by_a_relative_path(scene, capsys, monkeypatch, tmp_path):
    scene("def scene():\n    x = 0\n    return 1 / x\n")
    monkeypatch.chdir(tmp_path)
    assert "division by zero (line 3)." in refused_command(capsys, "simulate", "scene_file.py")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "no/such.py"], "no scene file no/such.py"),
        (["simulate", "no_such_scene"], "no scene file and no shipped scene 'no_such_scene'"),
        (["compare", "PENDULUM", "--methods", "tailor:2"], "no method 'tailor'. Did you mean 'taylor'"),
        (["compare", "PENDULUM", "--methods", "taylor:two"], "ORDER must be a whole number, got 'two'"),
        (["compare", "PENDULUM", "--methods", "pce:tol=small"], "TOL must be a number, got 'small'"),
        (["compare", "PENDULUM", "--methods", "pce:2:papier"], "pce:ORDER:paper"),
        (["compare", "PENDULUM", "--methods", "mc:0"], "samples must be an integer of at least 1"),
        (["compare", "PENDULUM", "--methods", "pce:tol=2"], "tolerance must be a number above 0 and below 1"),
        (["compare", "PENDULUM", "--solver", "idaz"], "no solver 'idaz'. Did you mean 'idas'"),
        (["compare", "PENDULUM", "--solver", "rk:4:5"], "rk"),
        (["compare", "PENDULUM", "--solver", "stiff"], "Write the name of a solver first"),
        (["compare", "PENDULUM", "--solver", "dopri:projection:baumgarte"], "sets an option twice"),
        (["compare", "PENDULUM", "--solver", "dopri:stiff"], "has no option 'stiff'"),
        (["compare", "PENDULUM", "--solver", "idas:lagrangian"], "for solvers that eliminate the multipliers"),
        (["compare", "PENDULUM", "--spread", "many"], "--spread must be a positive number such as 5%"),
        *((["compare", "PENDULUM", f"--spread={a}"], "--spread must be a positive number") for a in NO_SPREADS),
        (["compare", "PENDULUM", "--spread", "5"], "--spread 5 is 500 %.*Did you mean 5%"),
        (["compare", "PENDULUM", "--spread", "150%"], "--spread 150% is 150 %.*by their ends in the Box"),
        (["compare", "CUBIC", "--spread", "5%"], "nominal value of 'y' is 0"),
        (["compare", "NO_BOX", "--spread", "5%"], r"no box.*box=mb\.Box\.around\(p, 0\.05\)"),
        (["compare", "--methods", "vertex", "PENDULUM"], "required: SCENE .*put SCENE first: --methods"),
        (["simulate", "--set", "l=1.0", "PENDULUM"], "required: SCENE .*put SCENE first: --methods and --set"),
        (["compare", "NO_BOX"], "[Nn]o box"),
        (["compare", "CUBIC", "--methods", "vertex", "--plot", "picture.doc"], r"must end in \.png"),
        (["compare", "CUBIC", "--methods", "vertex", "--json", "no/such/folder/c.json"], "does not exist"),
        (["simulate", "PENDULUM", "--set", "k=1.0"], "[Nn]o parameter 'k'"),
        *((["simulate", "PENDULUM", "--set", a], f"--set takes name=number, got '{a}'") for a in ("l", "l=long")),
        (["simulate", "PENDULUM", "--set", "l=nan"], "finite"),
        (["simulate", "PENDULUM", "--csv", "table.doc"], r"must end in \.csv"),
        (["codegen", "PENDULUM", "-o", "PENDULUM"], "is a file"),
        (["codegen", "PENDULUM"], "required: -o"),
        (["fly", "PENDULUM"], "invalid choice: 'fly'"),
        (["cache", "SCENE"], "unrecognized arguments: SCENE"),
        ([], "required: COMMAND"),
    ],
)
def test_arguments_that_are_wrong(scene, capsys, arguments, words):
    files = {"PENDULUM": PENDULUM, "CUBIC": CUBIC, "NO_BOX": CUBIC.replace("box=box, ", "")}
    error = refused_command(capsys, *[scene(files[word]) if word in files else word for word in arguments])
    assert re.search(words, error) and len(error.splitlines()) == 1


def test_a_run_that_breaks_down_is_told_in_a_sentence(scene, capsys):
    text = PENDULUM.replace("-p.damping * rod.omega", "1e4 * rod.omega**3")
    assert main(["simulate", scene(text), "--solver", "rk"]) == 1
    error = capsys.readouterr().err
    assert "Traceback" not in error and "t = " in error


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_file_that_cannot_be_written_is_told_in_a_sentence(scene, capsys):
    assert main(["simulate", scene(CUBIC), "--json", "/dev/full"]) == 2
    assert "No space left" in capsys.readouterr().err


def test_an_interrupt_leaves_quietly(scene, capsys):
    assert main(["simulate", scene("def scene():\n    raise KeyboardInterrupt\n")]) == 130
    assert capsys.readouterr().err == ""


def test_cache_tells_and_clears(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = (tmp_path / "symmb").resolve()
    assert printed(capsys, "cache") == f"{folder}\n0 models, 0.0 MB\n"
    ours = [f"{k * 32}-{k * 64}.so" for k in "ab"]
    others = ["a.c", "b-2.so", f"{'c' * 32}-{'c' * 63}.so", "libm.so", "half.part", "main.c", "notes.txt"]
    sizes = dict.fromkeys(ours, 700_000) | {f"{'a' * 32}-x_1.part": 100_000} | dict.fromkeys(others, 9)
    for name, size in sizes.items():
        (folder / name).write_bytes(bytes(size))
    assert printed(capsys, "cache") == f"{folder}\n2 models, 1.5 MB\n"
    assert printed(capsys, "cache", "--clear") == f"{folder}\nremoved 2 models, 1.5 MB\n"
    assert sorted(path.name for path in folder.iterdir()) == sorted(others)


def test_cache_says_why_a_folder_is_not_used(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "symmb").mkdir()
    (tmp_path / "symmb").chmod(0o777)
    assert re.search(r"^symmb cache: .*others can write to .*chmod go-w", refused_command(capsys, "cache", "--clear"))


def test_a_scene_with_impacts(capsys, tmp_path):
    file = tmp_path / "run.json"
    main(["simulate", "bouncing_ball", "--json", str(file), "--plot", str(tmp_path / "run.png")])
    assert "impacts     6 of 'floor'" in capsys.readouterr().out
    run = json.loads(file.read_text(), parse_constant=pytest.fail)
    assert [event["what"] for event in run["events"]] == ["impact"] * 6 and run["energy_drift"] < 1e-10
    file = tmp_path / "bounds.json"
    main(["compare", "bouncing_ball", "--methods", "pce:2:paper", "taylor:4", "--json", str(file)])
    shown = capsys.readouterr().out
    assert "Taylor(order=4) did not run" in shown and "cannot be integrated" in shown
    found = json.loads(file.read_text(), parse_constant=pytest.fail)
    assert [method["name"] for method in found["methods"]] == ["PolynomialChaos.paper(order=2)"]
    main(["equations", "bouncing_ball"])
    assert "impacts      floor" in capsys.readouterr().out
    main(["codegen", "bouncing_ball", "-o", str(tmp_path / "c")])
    names = "main.c model.c model.h scene.c scene.h".split()
    assert sorted(path.name for path in (tmp_path / "c").iterdir()) == names
    assert "impulses" in (tmp_path / "c" / "model.h").read_text()


def test_what_was_found_before_an_interrupt_is_printed_and_written(scene, tmp_path, capsys, monkeypatch):
    def interrupted(*arguments, **options):
        interrupt = KeyboardInterrupt()
        f = mb.FunctionSimulator(lambda k: [k], {"k": 1.0}, [0.0], ["x"])
        interrupt.partial = mb.propagate(f, mb.Vertex(), box)
        raise interrupt

    box = mb.Box(k=(0.0, 1.0))
    monkeypatch.setattr(mb, "compare", interrupted)
    file = tmp_path / "out.json"
    assert main(["compare", scene(CUBIC), "--json", str(file)]) == 130
    told = capsys.readouterr()
    assert "Bounds by Vertex()" in told.out
    assert f"interrupted. The results so far are in {tmp_path / 'out.partial.json'}." in told.err
    assert mb.Bounds.load(tmp_path / "out.partial.json").evaluations == 2 and not file.exists()
    assert main(["compare", scene(CUBIC), "--json", "/dev/stdout"]) == 130
    assert capsys.readouterr().err == ""


def written(form):
    """A text of a form, everything in brackets given."""
    return re.sub(r"[A-Z]+", lambda name: "0.125" if "TOL" in name[0] else "3", re.sub(r"[][]", "", form))


LAGRANGIAN = mb.AugmentedLagrangian()


def concrete(kind):
    for child in kind.__subclasses__():
        yield from concrete(child)
        if child.__module__.startswith("symmb.") and not inspect.isabstract(child):
            yield child


def test_every_method_and_solver_has_a_spec():
    made = {type(specs.method(written(spec.form))) for spec in specs.METHODS}
    made |= {type(specs.solver(written(spec.form))) for spec in specs.SOLVERS}
    assert made == {*concrete(Method), *concrete(Solver)}


@pytest.mark.parametrize("spec", specs.METHODS, ids=lambda spec: spec.form)
def test_a_methods_spec_reads_as_its_text_says(spec):
    text = re.sub(r"(R?TOL)|[A-Z]{4,}", lambda name: "0.125" if name[1] else "3", spec.text)
    read = repr(specs.method(written(spec.form)))
    assert text.removesuffix(", adaptive") in (read, read.replace("(3)", "(order=3)"))


def test_help_prints_the_table(capsys):
    for arguments in (["--help"], ["compare", "--help"]):
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        assert stop.value.code == 0
        shown = capsys.readouterr().out
        for spec in (*specs.METHODS, *specs.SOLVERS):
            assert spec.form in shown and spec.text in shown


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("cvodes:stiff", mb.CVODES(stiff=True)), ("rosenbrock:lagrangian", mb.Rosenbrock(stabilization=LAGRANGIAN)),
        ("cvodes:1e-6:stiff:projection", mb.CVODES(1e-6, stiff=True, stabilization=mb.Projection())),
        ("dopri:1e-8:baumgarte", mb.DormandPrince(1e-8, stabilization=mb.Baumgarte())),
        ("idas", mb.IDAS()), ("idas:1e-10", mb.IDAS(rtol=1e-10)), ("cvodes:1e-8", mb.CVODES(rtol=1e-8)),
        ("collocation", mb.Collocation()), ("rk", mb.RungeKutta()), ("nstiff-si2:5e-3", mb.NSTIFFSI2(step=5e-3)),
        ("gen-alpha", mb.GeneralizedAlpha()), ("hht", mb.HHT()),
        ("pce:2:paper", mb.PolynomialChaos.paper(order=2)), ("pce:4", mb.PolynomialChaos(order=4)),
        ("pce", mb.PolynomialChaos()), ("pce:tol=1e-3", mb.PolynomialChaos(tolerance=1e-3)),
        ("pce:budget=200", mb.PolynomialChaos(budget=200)), ("taylor:2", mb.Taylor(order=2)),
        ("mc:10000", mb.MonteCarlo(10_000, seed=0)), ("scan:21", mb.Scanning(21)),
    ],
)  # fmt: skip
def test_specs_of_methods_and_solvers(text, made):
    assert (specs.method if isinstance(made, Method) else specs.solver)(text) == made
