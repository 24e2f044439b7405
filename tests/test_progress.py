"""Progress of long work: shown in terminals, with rate and time left, and nowhere else."""

import io
import sys
import time

import numpy as np
import pytest

import symmb as mb
from symmb._progress import Progress

TIMES = np.array([0.0, 1.0])


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr("symmb._progress._PATIENCE", 0.0)
    monkeypatch.setattr("symmb._progress._PERIOD", 0.01)


def standard_error(monkeypatch):
    """A terminal in its place. A fixture cannot put it there: pytest replaces it before the test is called."""
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def told(stream, text):
    deadline = time.monotonic() + 10.0
    while text not in stream.getvalue() and time.monotonic() < deadline:
        time.sleep(0.01)
    return text in stream.getvalue()


def test_a_terminal_shows_runs_rate_and_time_left_and_other_work_anew(monkeypatch, impatient):
    terminal = standard_error(monkeypatch)
    with Progress("working") as progress:
        assert told(terminal, "working")
        progress("MonteCarlo(100)", 0, 100)
        assert told(terminal, "0 of 100 runs")
        progress("MonteCarlo(100)", 25, 100)
        assert told(terminal, "25 of 100 runs")
        assert told(terminal, "left")
        assert told(terminal, "runs/s")
        progress("Vertex()", 1, 4)
        assert told(terminal, "Vertex()")
        assert told(terminal, "1 of 4 runs")
    assert terminal.getvalue().endswith("\r")  # nothing is left on the line
    assert not terminal.getvalue().splitlines()[-1].strip()


def test_what_is_no_terminal_shows_none(monkeypatch, impatient):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with Progress("working") as progress:
        progress("MonteCarlo(100)", 25, 100)
        time.sleep(0.05)
    assert stream.getvalue() == ""


def test_what_is_done_at_once_shows_none(monkeypatch):
    terminal = standard_error(monkeypatch)
    with Progress("working"):
        pass
    assert terminal.getvalue() == ""


def test_work_inside_of_work_has_no_bar_of_its_own(monkeypatch, impatient):
    terminal = standard_error(monkeypatch)
    with Progress("outer"):
        with Progress("inner"):
            assert told(terminal, "outer")
        assert "inner" not in terminal.getvalue()
    with Progress("next"):
        assert told(terminal, "next")


@pytest.mark.parametrize("start", [mb.simulate, mb.prepare])
def test_a_start_tells_what_it_does(monkeypatch, impatient, start):
    """Equations first, then runs. Each is shown in tests for 20 ms at least."""
    terminal, stage = standard_error(monkeypatch), "symmb._progress.Progress.__call__"
    own = Progress.__call__
    monkeypatch.setattr(stage, lambda *arguments: (time.sleep(0.02), own(*arguments), time.sleep(0.02)))
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    start(mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), {"ball.vx": 2.0}, TIMES, name="fall"))
    assert "fall: equations" in terminal.getvalue()
    assert "fall: running" in terminal.getvalue() or "fall: nominal run in two ways" in terminal.getvalue()


def slow(k):
    time.sleep(0.02)
    return np.exp(-k * TIMES)


@pytest.mark.parametrize("own", [False, True])
def test_bounds_tell_terminals_unless_the_caller_watches(monkeypatch, impatient, own):
    terminal, seen = standard_error(monkeypatch), []
    decay = mb.FunctionSimulator(slow, {"k": 1.0}, TIMES, ["x"])
    watch = (lambda done, total: seen.append((done, total))) if own else None
    mb.propagate(decay, mb.Scanning(20), mb.Box(k=(0.5, 2.0)), progress=watch)
    assert ("Scanning(20)" in terminal.getvalue()) is not own
    assert bool(seen) is own


IN_NOTEBOOK = """
import time
import numpy as np
import symmb as mb
import symmb._progress as progress

progress._PATIENCE, progress._PERIOD = 0.0, 0.05

def slow(k):
    time.sleep(0.02)
    return np.exp(-k * np.array([0.0, 1.0]))

decay = mb.FunctionSimulator(slow, {"k": 1.0}, [0.0, 1.0], ["x"])
for n in (19, 23):
    mb.propagate(decay, mb.Scanning(n), mb.Box(k=(0.5, 2.0)))
"""


def test_a_cell_of_a_notebook_shows_one_line_which_is_empty_at_the_end():
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    lines = []

    class Watching(nbclient.NotebookClient):
        def process_message(self, msg, *cell):
            lines.append(msg["content"].get("data", {}).get("text/plain", ""))
            return super().process_message(msg, *cell)

    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(IN_NOTEBOOK)])
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("TQDM_DISABLE", raising=False)
        Watching(book, timeout=300).execute()
    assert all(any(f"Scanning({n}) " in line and f"of {n} runs" in line for line in lines) for n in (19, 23))
    (output,) = book.cells[0].outputs
    assert output["output_type"] == "display_data" and output["data"] == {"text/plain": ""}
