"""The command line ends with status 3 where its result is doubtful, and the JSON says why."""

import json
import os
import subprocess
import sys

import pytest

from symmb.show.cli.main import main

PENDULUM = """
import symmb as mb

def scene():
    rod = mb.Body("rod", 1.0, 0.0)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(0, {side}))
    return mb.Scene(mb.System(rod, hinge, mb.Gravity(0, -9.81)), times=[0, 0.1], outputs={{"y": rod.y}})
"""


@pytest.mark.parametrize(("side", "status"), [(1.0, 0), (-1.0, 3)])
@pytest.mark.filterwarnings("default::symmb.SymmbWarning")
def test_an_unstable_equilibrium_is_a_doubt(tmp_path, capsys, side, status):
    """The rod hangs, or stands upright."""
    file, out = tmp_path / "pendulum.py", tmp_path / "out.json"
    file.write_text(PENDULUM.format(side=side))
    assert main(["simulate", str(file), "--json", str(out)]) == status
    assert ("unstable equilibrium" in capsys.readouterr().err) == bool(status)
    doubts = json.loads(out.read_text())["doubts"]
    assert len(doubts) == bool(status) and all("unstable equilibrium" in doubt for doubt in doubts)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full")
@pytest.mark.parametrize(("closing", "status"), [(">/dev/full", 2), (">&-", 0), (">&- 2>&-", 0)])
def test_an_output_that_cannot_be_written_is_told(closing, status, tmp_path):
    command = f"exec {sys.executable} -m symmb.show.cli cache {closing}"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    end = subprocess.run(["sh", "-c", command], capture_output=True, text=True, env=environment)
    assert end.returncode == status and "Traceback" not in end.stderr
    assert end.stderr.count("\n") == (status == 2)
