"""Reports: their numbers are those of results, no name is markup, and parts that are not known are left out."""

import datetime
import html
import re
from unittest.mock import MagicMock

import numpy as np
import pytest
from black_boxes import black_box_bounds, reloaded
from faults import refused
from machines import ball

import symmb as mb
from models import double_pendulum
from symmb.show.cli.main import main
from symmb.show.cli.scene_file import load_subject
from symmb.show.drawing import of_bounds, page

pytestmark = pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
T = np.linspace(0.0, 1.0, 11)
EVIL = "<script>alert(1)</script>\"'>&$x$"


def decay(name="x", parameter="k"):
    """A black box, and its box."""
    simulator = mb.FunctionSimulator(lambda **p: np.exp(-p[parameter] * T), {parameter: 1.0}, T, [name])
    return simulator, mb.Box(**{parameter: (0.5, 2.0)})


def decayed(method=None, **names):
    """Bounds of a black box."""
    simulator, box = decay(**names)
    return mb.propagate(simulator, method or mb.PolynomialChaos(), box)


def rolling(name="roll", output="x"):
    """A ball that rolls at an uncertain speed."""
    machine, box = ball(g=0.1, speed=1.0), mb.Box(speed=(0.9, 1.1))
    outputs = {output: machine.ball.x, "y": machine.ball.y}
    return machine.scene(outputs, T, {"ball.vx": machine.p.speed}, box=box, name=name)


def text_of(path):
    """What a reader sees, with one space between words and cells: no inner page, no tags; code is between backticks."""
    page = re.sub(r"<(style|iframe)\b.*?</\1>", " ", re.sub("</?code>", "`", path.read_text()), flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", page)).split())


def words(text):
    return " ".join(str(text).split())


def headings(path):
    return re.findall(r"<h2>(.*?)</h2>", path.read_text())


def reported(result, folder, *limits):
    """The text, the headings and the page of a report."""
    path = folder / "r.html"
    result.report(path, *limits)
    return text_of(path), headings(path), path.read_text()


LIMITS = {"x": (None, 1.05), "y": (-1, 1)}


@pytest.fixture(scope="module")
def scene_report(tmp_path_factory):
    """Bounds, and the text, the headings and the page of their report."""
    bounds = mb.propagate(rolling(), mb.PolynomialChaos())
    return bounds, *reported(bounds, tmp_path_factory.mktemp("report"), LIMITS)


def test_numbers_are_those_of_the_result(scene_report):
    bounds, text, *_ = scene_report
    check, rows = bounds.check(LIMITS), str(bounds).splitlines()[-2:]
    for line in (check._head(), check.worst):
        assert words(line) in text
    for case in bounds._all_worst():
        speed = [f"{case.parameters['speed']:.6g}"] * (case.output == "x")  # y = -t^2 / 20 in all runs
        side = {"lower": "lowest", "upper": "highest"}[case.side]
        place = f"{side} {case.output} {case.value + 0.0:.6g} {case.estimate:.1g} {case.time:.6g}"
        assert " ".join([place, *speed, f"{case.attained + 0.0:.6g}"]) in text
    for cells in (*check._rows(), *bounds.contributions()._rows(0, -1)):
        assert " ".join(filter(None, cells)) in text
    assert rows[0].split()[0] == "x"
    for row in rows:
        assert words(row.split(maxsplit=1)[1]) in text
    assert f"{bounds.evaluations} runs, {bounds.seconds:.3g} s" in text
    assert "PolynomialChaos()" in text and repr(bounds.study.solver) in text and bounds.study.simulator.reason in text


def test_the_order_of_the_parts_and_that_nothing_is_loaded_from_elsewhere(scene_report):
    _, text, found, page = scene_report
    answers = ["Result", "What to do next", "Curves", "The mechanism", "Assumptions"]
    annex = ["Limits", "Bounds", "How the errors were found", "Worst cases", "What each parameter contributes"]
    assert found == [*answers, *annex, "The start", "Settings", "Cost", "How to repeat it", "Equations"]
    assert page.index("Assumptions</h2>") < page.index('id="annex"') < page.index("Limits</h2>")
    equations = rolling().system.equations()
    assert "M q̈ = Q" in equations
    folded, printed = text.split("Equations")[1:]
    assert words(equations) in folded and words(equations) in printed
    loaded = r"""(?:src|href)=["'](?!data:)|url\((?!["']?data:)|https?://(?!www\.w3\.org)"""
    assert not re.findall(loaded, html.unescape(page))


def test_the_worst_run_moves(scene_report):
    """The inner page is that of `view` for the output that is closest to its limit."""
    bounds, _, _, shown = scene_report
    motion = of_bounds(bounds, "x", 1.0, None)
    screen, printed = shown.split('<div class="printed still">')
    for ghost in motion.ghosts:  # the page shows their labels; a picture that is printed has them beside it
        label = html.escape(ghost.label)
        assert label not in re.sub(r'srcdoc="[^"]*"', "", screen) and label in printed
    (source,) = re.findall(r'srcdoc="([^"]*)"', shown)
    assert html.unescape(source) == page(motion)


def test_the_lines_repeat_the_bounds(scene_report):
    bounds, *_, shown = scene_report
    needed, lines = shown.split("How to repeat it</h2>")[1].split("</pre>")[0].split("<pre")
    lines = html.unescape(lines.split(">", 1)[1])
    assert "declaration of roll. Ask its author for the Python file that defines <code>scene</code>." in needed
    space = {"scene": rolling()}
    exec("\n".join(lines.splitlines()[:-1]), space)
    np.testing.assert_array_equal(space["bounds"].upper, bounds.upper)
    assert lines.splitlines()[-1] == "bounds.report(\"report.html\", {'x': (None, 1.05), 'y': (-1.0, 1.0)})"


def test_a_black_box_has_neither_drawing_nor_equations(tmp_path):
    text, found, page = reported(decayed(), tmp_path)
    assert "<iframe" not in page and "<details" not in page
    assert not {"The mechanism", "Limits"} & {*found} and "What each parameter contributes" in found
    assert "Bounds of FunctionSimulator(<lambda>)" in text
    simulator = mb.FunctionSimulator(lambda E, n: T / E + n, {"E": 2e9, "n": 1234567.0}, T, ["x"])
    text, *_ = reported(mb.propagate(simulator, mb.Vertex(), mb.Box(E=(2e9, 2.25e9))), tmp_path)
    assert "E 2e9 2.25e9 2e9" in text and "n 1234567" in text  # large numbers are powers of ten


SMOOTH = lambda k, m: m * np.exp(-k * T)  # noqa: E731


@pytest.mark.parametrize(
    ("function", "is_shown"),
    [(SMOOTH, True), (lambda k, m: SMOOTH(k, m) / (k <= 1.05), False), (lambda k, m: np.full_like(T, 3.7), True)],
    ids=["smooth", "fails", "constant"],
)
def test_a_report_makes_no_runs_of_a_black_box(tmp_path, function, is_shown):
    """Contributions are left out where they would take some; a constant output takes none."""
    calls = []
    with np.errstate(divide="ignore"):
        own = lambda k, m: calls.append(k) or function(k, m)  # noqa: E731
        bounds = black_box_bounds(own, None, T, "x", k=(0.9, 1.1), m=(0.9, 1.1))
        made = len(calls)
        text, *_ = reported(bounds, tmp_path, {"x": (None, 4)})
    assert len(calls) == made
    assert ("no further runs" in text) == is_shown
    assert ("`bounds.contributions()` makes the further runs" in text) != is_shown


def test_contributions_are_at_the_least_margin(tmp_path):
    """The widest time is another one, 2 s; 0 of these comes from k at 1 s, where the limit is close."""
    f = lambda k, m: np.stack([[k, 5 + m, 3 * k + m], [k, m, 2 * m]], 1)  # noqa: E731
    bounds = black_box_bounds(f, None, [0.0, 1.0, 2.0], "x y", k=(0.9, 1.1), m=(0.9, 1.1))
    text, *_ = reported(bounds, tmp_path, {"x": (None, 7)})
    assert "x at 1 s alone" in text and "x at 2 s alone" not in text and "y at 2 s alone" in text
    assert "at the time of the smallest margin" in text
    text, *_ = reported(bounds, tmp_path)
    assert "x at 2 s alone" in text and "smallest margin" not in text


def test_many_outputs_have_six_tables(tmp_path, monkeypatch):
    """Those with limits come first, in the pictures too, and the rest is named."""
    drawn = []
    rows = lambda k: np.outer(k * T, np.arange(1.0, 10.0))  # noqa: E731
    bounds = black_box_bounds(rows, None, T, " ".join(f"y{k}" for k in range(9)), k=(0.9, 1.1))
    for kind in (mb.Bounds, mb.Contributions):
        own = kind.plot
        monkeypatch.setattr(kind, "plot", lambda self, *a, _own=own, **k: drawn.append(k) or _own(self, *a, **k))
    text, *_ = reported(bounds, tmp_path, {"y8": (None, 9)})
    assert re.findall(r"(y\d) at 1 s alone", text) == ["y8", "y0", "y1", "y2", "y3", "y4"]
    assert "3 of 9 outputs are left out: `print(bounds.contributions())` shows them." in text
    assert "Curves 6 of 9 outputs." in text
    others = ["y0", "y1", "y2", "y3", "y4"]  # the check draws y8 beside its limit
    assert [k["outputs"] for k in drawn if "outputs" in k] == [*others, "y8", *others]


@pytest.mark.parametrize("suffix", [".npz", ".json", ".csv"])
def test_bounds_from_a_file_show_what_they_hold(tmp_path, suffix):
    bounds = mb.propagate(rolling(), mb.PolynomialChaos())
    text, found, page = reported(reloaded(bounds, tmp_path / f"b{suffix}"), tmp_path, {"x": (None, 2)})
    assert "<iframe" not in page and "The mechanism" not in found
    assert {"Limits", "Bounds", "Curves", "Settings"} <= {*found}
    assert ("Assumptions" in found) == (suffix != ".csv")
    assert ("Worst cases" in found) == ("What each parameter contributes" in found) == (suffix != ".csv")
    assert (f"Worst case: {words(bounds.check({'x': (None, 2)}).worst)}" in text) == (suffix != ".csv")
    if suffix != ".csv":
        assert f"highest x 1.1 {bounds.estimate[-1, 0]:.1g} 1 1.1 1.1" in text and "0.9 1.1 1" in text
        assert f"Bounds of {rolling().name}" in text and f"solver {bounds.study.solver!r}" in text


@pytest.mark.parametrize("method", [mb.Taylor(2), mb.MonteCarlo(20), mb.Swarm(5, 3, seed=4)])
def test_methods_without_contributions_or_runs(tmp_path, method):
    """No study is added, and the mechanism moves all the same. The seed stands there."""
    bounds = mb.propagate(rolling(), method)
    text, found, page = reported(bounds, tmp_path)
    assert "What each parameter contributes" not in found and "<iframe" in page
    assert ("stores no runs that attain its bounds" in text) == (bounds.attaining is None)
    seed = {"MonteCarlo": "0", "Swarm": "4"}.get(type(method).__name__)
    assert (f"seed {seed} solver" in text) if seed else "seed" not in text


def test_the_annex_has_the_warnings(tmp_path):
    bounds = decayed(mb.MonteCarlo(2))
    assert bounds.doubts and bounds.remarks
    text, _, page = reported(bounds, tmp_path, {"x": (0, None)})
    assert page.count('<p class="doubt">') == len(bounds.doubts)
    assert page.index('id="annex"') < page.index('<p class="doubt">') < page.index('<p class="remark">')
    assert page.index('<p class="remark">') < page.index("Limits</h2>")
    assert all(f"Warning: {words(doubt)}" in text for doubt in bounds.doubts)
    told = "A warning says what" if len(bounds.doubts) == 1 else f"{len(bounds.doubts)} warnings say what"
    assert told in text.partition("Annex")[0]


@pytest.mark.parametrize("subject", ["scene", "black box", "loaded", "comparison"])
def test_names_are_no_markup(tmp_path, subject):
    path = tmp_path / "r.html"
    if subject == "comparison":
        simulator, box = decay(EVIL, EVIL)
        mb.compare(simulator, [mb.Vertex()], box, reference=mb.Scanning(5)).report(path)
    elif subject == "scene":
        mb.propagate(rolling(EVIL, EVIL), mb.PolynomialChaos()).report(path, {EVIL: (None, 2)})
    else:
        bounds = decayed(name=EVIL, parameter=EVIL)
        again = reloaded(bounds, tmp_path / "b.npz")
        (again if subject == "loaded" else bounds).report(path, {EVIL: (None, 2)})
    text = path.read_text()
    assert "<script" not in text and EVIL in html.unescape(text)
    if subject == "scene":
        (source,) = re.findall(r'srcdoc="([^"]*)"', text)
        assert "<script>alert" not in html.unescape(source)


def test_comparisons(tmp_path):
    simulator, box = decay()
    comparison = mb.compare(simulator, [mb.MonteCarlo(2), mb.Vertex()], box, reference=mb.Scanning(5))
    text, found, _ = reported(comparison, tmp_path)
    table = str(comparison).split("---\n")[-1].splitlines()[:2]
    assert all(words(row) in text for row in table) and "seeds 0 of MonteCarlo(2)" in text
    assert found == ["Methods", "Assumptions", "Settings", "Cost", "How to repeat it"]
    assert "The methods made 4 runs" in text and f"The reference: {comparison._reference()}" in text
    assert reported(reloaded(comparison, tmp_path / "c.json"), tmp_path)[0] == text


@pytest.mark.parametrize(
    ("path", "limits", "why"),
    [
        *((name, None, r"must end in \.html") for name in ("r.pdf", "r")),
        (3, None, "must be a text or a Path"),
        ("none/r.html", None, "cannot be written"),
        ("r.html", {"q": (0, 1)}, "no output 'q'"),
        ("r.html", {"x": (1, 0)}, "is above"),
        ("r.html", {}, "limits must be a dictionary of pairs"),
    ],
)
def test_wrong_arguments_are_told_in_one_sentence(tmp_path, monkeypatch, path, limits, why):
    monkeypatch.chdir(tmp_path)
    message = refused(why, decayed(mb.Vertex()).report, path, limits, error=mb.SymmbError)
    assert "\n" not in message and not [*tmp_path.iterdir()]


def test_a_part_that_fails_tells_why(tmp_path, monkeypatch):
    fails = MagicMock(side_effect=mb.PropagationError("3 of 4 runs failed."))
    bounds = decayed()
    monkeypatch.setattr(mb.Bounds, "_known_contributions", fails)
    assert "What each parameter contributes 3 of 4 runs failed. Settings" in reported(bounds, tmp_path)[0]


SCENE = """
import numpy as np
import symmb as mb

p = mb.Parameters(speed=1.0)
ball = mb.Body("ball", 1.0, pose=mb.Particle())
scene = mb.Scene(
    mb.System(ball, parameters=p), {"ball.vx": p.speed}, np.linspace(0, 2, 5), {"x": ball.x}, mb.Box(speed=(0.9, 1.1))
)
"""


FAILING = """
import symmb as mb

def simulator():
    def own(k, m):
        with open("calls", "a") as file:
            file.write("1\\n")
        return [m / (k <= 1.05), k + (k > 0.95)]

    box = mb.Box(k=(0.9, 1.1), m=(0.9, 1.1))
    return mb.FunctionSimulator(own, {"k": 1.0, "m": 1.0}, [0.0, 1.0], ["x"]), box
"""


def test_the_command_makes_runs_for_contributions_only_if_asked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fails.py").write_text(FAILING)

    def calls(*words):
        (tmp_path / "calls").unlink(missing_ok=True)
        assert main(["bound", "fails.py", *words]) == 3
        return (tmp_path / "calls").read_text().count("1"), capsys.readouterr().out

    bounds = mb.propagate(*load_subject("fails.py")[:1], mb.PolynomialChaos(), mb.Box(k=(0.9, 1.1), m=(0.9, 1.1)))
    made = (tmp_path / "calls").read_text().count("1")
    assert bounds._known_contributions() is None
    count, text = calls("--report", "r.html")
    assert count == made and text.endswith("Add --contributions to make these runs.\n")
    assert "`symmb bound --contributions` makes the further runs for contributions." in text_of(tmp_path / "r.html")
    count, text = calls("--contributions", "--report", "r.html")
    assert count > made and f"{count - made} further runs" in text
    assert f"{count - made} further runs" in text_of(tmp_path / "r.html")


def test_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "roll.py").write_text(SCENE)
    asked, own = [], mb.Bounds._known_contributions
    monkeypatch.setattr(mb.Bounds, "_known_contributions", lambda bounds: asked.append(1) or own(bounds))
    assert main(["bound", "roll.py", "--limit", "x=:2.3", "--report", "my report.html"]) == 0
    text = text_of(tmp_path / "my report.html")
    assert asked == [1] and "Contributions to the bounds by PolynomialChaos()" in text
    assert "Limits by PolynomialChaos(): satisfied" in text and "Bounds of roll" in text
    assert "symmb bound roll.py --limit x=:2.3 --report 'my report.html'" in text and "outputs are left out" not in text
    assert main(["bound", "roll.py", "--report", "r.pdf"]) == 2 and "must end in .html" in capsys.readouterr().err
    block = ["--title-block", "author=A. Miller", "drawing=D=17"]
    assert main(["bound", "roll.py", "--report", "r.html", *block]) == 0
    assert "author A. Miller drawing D=17 Bounds of roll" in text_of(tmp_path / "r.html")
    assert main(["bound", "roll.py", "--title-block", "autor=A"]) == 2 and "no part 'autor'" in capsys.readouterr().err
    assert main(["compare", "roll.py", "--methods", "vertex", "--report", "c.html"]) == 0
    assert "symmb compare roll.py --methods vertex --report c.html" in text_of(tmp_path / "c.html")


@pytest.mark.parametrize("author", [["A. Miller"], {}, map(str, "AM"), b"A"])
def test_parts_of_the_title_block_are_texts_numbers_or_dates(tmp_path, author):
    bounds = mb.Bounds(np.zeros(1), ("x",), np.zeros((1, 1)), np.ones((1, 1)), "sampled", "Vertex()", 4)
    bounds.report(tmp_path / "r.html", author="A. Miller", date=datetime.date(2026, 1, 2), revision=3, drawing=None)
    assert "author A. Miller date 2026-01-02 revision 3" in text_of(tmp_path / "r.html")
    with pytest.raises(mb.DeclarationError, match="author must be a text, a number or a date"):
        bounds.report(tmp_path / "r.html", author=author)


def test_a_scene_with_scalar_outputs_is_drawn_at_its_start(tmp_path):
    scene = double_pendulum.scene().with_times(np.linspace(0, 0.5, 11))
    tip = scene.outputs["x2"]
    for outputs in ({"lowest": mb.minimum(tip)}, {"x2": tip, "lowest": mb.minimum(tip)}):
        mb.propagate(scene.with_outputs(outputs)).report(tmp_path / "a.html")
        _, found, after = (tmp_path / "a.html").read_text(encoding="utf-8").partition("at its start, at the nominal")
        assert found and "<img" in after[:200]
