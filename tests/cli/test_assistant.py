"""`symmb mcp`: results of its tools, refused files, and the program itself, through the client of the package mcp."""

import math
import os
import sys
import time

import pytest
from faults import refused, refused_command

import symmb as mb
from symmb.show.cli.assistant import Tools, make_server
from symmb.show.cli.scene_file import load_scene

SCENE = """'A mass on a spring.'
import symmb as mb

print("a text on stdout")
open(__file__ + ".loaded", "w").close()
p = mb.Parameters(k=(4.0, "N/m"), m=1.0)
a = mb.Body("a", p.m, pose=mb.Particle())
spring = mb.Force("spring", a.point(0, 0, 0), (-p.k * a.x, 0, 0))
rails = mb.Force("rails", a.point(0, 0, 0), (0, -a.y, -a.z))
scene = mb.Scene(
    mb.System(a, spring, rails, parameters=p), {"a.x": 0.1}, [0.0, 0.5, 1.0], {"x": (a.x, "mm")},
    box=mb.Box.plus_minus(p, k="10%"), name="oscillator",
)
"""
LIMITS, GIVEN = {"x": [-60.0, None]}, mb.Box(m=(0.9, 1.1), k=(3, 5, "N/m"))


@pytest.fixture
def folder(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    for path in (inside / "oscillator.py", tmp_path / "stranger.py"):
        path.write_text(SCENE)
    return inside


@pytest.fixture
def ask(folder):
    """The text of one call, and whether the call failed. `progress` receives the reports."""
    mcp, anyio = pytest.importorskip("mcp"), pytest.importorskip("anyio")

    async def call(subject, tool, arguments, progress):
        async def report(*told):
            progress.append(told)

        async with mcp.Client(subject) as client:
            result = await client.call_tool(tool, arguments, progress_callback=report if progress is not None else None)
        (content,) = result.content
        return content.text, result.is_error

    def ask(tool, progress=None, subject=None, **arguments):
        given = ({} if tool == "scenes" else {"scene": "oscillator.py"}) | arguments
        return anyio.run(call, subject or make_server([str(folder)]), tool, given, progress)

    return ask


def lasting(text):
    """Lines apart from measured times."""
    return [line for line in str(text).splitlines() if "seconds" not in line]


def loaded(folder):
    return load_scene(str(folder / "oscillator.py"))


@pytest.mark.parametrize(
    "tool, arguments, expected",
    [
        ("simulate", {"parameters": {"k": "5 N/m"}}, lambda scene: mb.simulate(scene, parameters={"k": 5.0})),
        ("bound", {}, mb.propagate),
        ("bound", {"box": {"k": [3, 5], "m": "10%"}}, lambda scene: mb.propagate(scene, box=GIVEN)),
        ("worst_case", {"output": "x", "time": "500 ms"}, lambda scene: mb.propagate(scene).worst("x", 0.5)),
        ("limits", {"limits": LIMITS}, lambda scene: mb.propagate(scene).check({"x": (-60.0, None)})),
        ("tolerances", {"limits": LIMITS}, lambda scene: mb.tolerances(scene, {"x": (-60.0, None)})),
        ("contributions", {}, lambda scene: mb.propagate(scene).contributions()),
    ],
)
def test_results_are_those_of_python(ask, folder, tool, arguments, expected):
    text, failed = ask(tool, **arguments)
    assert not failed, text
    assert lasting(text) == lasting(expected(loaded(folder)))


def test_parameters_that_a_given_box_lacks_are_told(ask):
    remark = "remark: The given box has no interval for k, unlike the box of the scene. This result is for k = 4 N/m."
    assert ask("bound", box={"m": "1%"})[0].splitlines()[-1] == remark
    for box in ({"m": "1%", "k": "1%"}, None):
        assert "no interval" not in ask("bound", box=box)[0]


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_warnings_follow_every_answer_from_bounds(ask, folder):
    text = SCENE.replace("m=1.0", "m=1.0, idle=1.0").replace('k="10%"', 'k="10%", idle="10%"')
    (folder / "oscillator.py").write_text(text)
    told = [f"warning: {doubt}" for doubt in mb.propagate(loaded(folder)).doubts]
    assert told and "idle" in told[0]
    others = [("report", {}), ("view", {"output": "x"}), ("contributions", {})]
    for tool, more in (("worst_case", {"output": "x"}), ("limits", {"limits": LIMITS}), *others):
        text, failed = ask(tool, **more)
        assert not failed and [line for line in text.splitlines() if line.startswith("warning")] == told


def test_outputs_at_given_times_are_those_of_a_cosine(ask):
    text, _ = ask("simulate", times=[0.25, 0.7])
    rows = [list(map(float, line.split())) for line in text.splitlines()[1:]]
    assert [row[0] for row in rows] == [0, 0.25, 0.7]
    assert [row[1] for row in rows] == pytest.approx([100 * math.cos(2 * t) for t in (0, 0.25, 0.7)], rel=1e-5)


def test_a_scene_is_described_with_units_and_box(ask):
    text, _ = ask("describe")
    assert text.startswith("A mass on a spring.")
    assert all(part in text for part in ("outputs: x [mm]", "k=(3.6, 4.4", "a.x = 0.1"))
    text, _ = ask("scenes")
    assert "double_pendulum" in text and "oscillator.py" in text


def test_pages_are_written_into_the_folder(ask, folder):
    bounds = mb.propagate(loaded(folder))
    calls = [
        ("report", {"limits": LIMITS}, "report", bounds.check({"x": (-60.0, None)})),
        ("view", {}, "view", ""),
        ("view", {"output": "x", "time": 0.5}, "view_2", bounds.worst("x", 0.5)),
        ("view", {"output": "x"}, "view_3", bounds.worst("x", 1.0)),
    ]
    for tool, more, name, told in calls:
        text, failed = ask(tool, **more)
        assert not failed, text
        page = folder / "symmb_output" / f"oscillator_{name}.html"
        assert text.splitlines() == [str(page), *str(told).splitlines()] and page.read_text().startswith("<!")


def test_progress_is_reported_in_numbers_that_increase(ask):
    reports = []
    ask("bound", reports)
    counts = [count for count, *_ in reports]
    assert counts and counts == sorted(set(counts)) and "runs" in reports[-1][2]


def test_a_cancelled_call_ends_at_its_next_runs(folder, monkeypatch):
    mcp, anyio = pytest.importorskip("mcp"), pytest.importorskip("anyio")
    ended = []

    def long_study(*_, progress):
        for done in range(200):
            progress("study", done, 200)
            time.sleep(0.01)
        ended.append(done)

    async def cancel():
        async with mcp.Client(make_server([str(folder)])) as client:
            with anyio.CancelScope() as scope:

                async def report(*_):
                    scope.cancel()

                await client.call_tool("bound", {"scene": "oscillator.py"}, progress_callback=report)
            return scope.cancelled_caught, await client.call_tool("describe", {"scene": "oscillator.py"})

    monkeypatch.setattr(mb, "propagate", long_study)
    cancelled, after = anyio.run(cancel)
    assert cancelled and not ended and not after.is_error


@pytest.mark.parametrize(
    "path", ["../stranger.py", "{}/stranger.py", "link.py", "link", "folder/stranger.py", "absent.py"]
)
def test_files_outside_are_refused_by_one_sentence_and_do_not_run(folder, path):
    (folder / "link.py").symlink_to(folder.parent / "stranger.py")
    (folder / "folder").symlink_to(folder.parent)
    path = path.format(folder.parent)
    told = refused("neither a shipped scene nor a file in the folders", Tools([str(folder)]).describe, path)
    assert told.startswith(path) and not (folder.parent / "stranger.py.loaded").exists()


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({"scene": "../stranger.py"}, "neither a shipped scene nor a file"), ({"scene": "a\0"}, "null byte"),
        ({"box": {"kk": "1%"}}, "unknown parameter 'kk'. Did you mean 'k'?"),
        ({"box": {"k": ["-5%", "5%"]}}, "'k': give one tolerance of the nominal value"),
        ({"box": {"k": [5]}}, "k"), ({"scene": 3}, "scene: Input should be a valid"),
        ({"box": {"k": 5}}, "bound: box is not valid. `box` replaces the box of the scene"),
        ({"scene": "interrupt.py"}, "raised KeyboardInterrupt"), ({"method": "pcee"}, "pcee"),
    ],
)  # fmt: skip
def test_errors_are_sentences(ask, folder, arguments, sentence):
    (folder / "interrupt.py").write_text("raise KeyboardInterrupt")
    text, failed = ask("bound", **arguments)
    assert failed and sentence in text and "Traceback" not in text and "\n" not in text


def test_the_program_speaks_only_the_protocol(ask, folder):
    mcp = pytest.importorskip("mcp")
    words = ["-m", "symmb", "mcp", str(folder)]
    program = mcp.StdioServerParameters(command=sys.executable, args=words, env={**os.environ})
    text, failed = ask("worst_case", subject=program, output="x")
    assert not failed and lasting(text) == lasting(mb.propagate(loaded(folder)).worst("x"))


def test_without_the_package_or_a_folder_a_sentence_tells_what_to_do(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mcp.server.mcpserver", None)  # as in old versions of mcp
    error = refused_command(capsys, "mcp")
    assert error.startswith("symmb mcp: this command needs mcp") and "install mcp, or pip install 'symmb[mcp]'" in error
    refused("is not a folder", Tools, [str(tmp_path / "absent")])
    refused("no folder for files", Tools([]).view, "double_pendulum")


def test_a_loop_of_links_is_no_scene(tmp_path):
    (tmp_path / "loop.py").symlink_to(tmp_path / "loop.py")
    refused("neither a shipped scene nor a file", Tools([str(tmp_path)]).describe, "loop.py")
