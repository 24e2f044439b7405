"""Small faults, planted one by one: whether the tests catch each of them, and which test does.

    python tests/benchmarks/planted_faults.py [NAMES ...] [--all] [--room]

Each fault is planted in a copy of the checkout in a temporary folder. The fast tests of its room run first, then the
other fast ones, up to the first that fails. That test then runs without the fault, so that one which fails anyway
counts for nothing. With `--all` the slow and then the long tests of faults that escaped run as well, with `--room` only
tests of the room. The exit status is 1 if a fault escapes, or if the code it changes has moved.

The last 35 of the 60 faults follow a rule: each room of CONTRIBUTING.md, in the order of its table, has two faults, and
large rooms have three or four. A fault is in the first suitable place of the k-th file of its room by the alphabet, or
of a later file, and k goes round. The kinds of faults take turns, so that there are ten of each.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from _faults import FAULTS, Fault

ROOT = Path(__file__).parents[2]
TIERS = {"README's tests": "not slow and not long", ".ci/run": "slow and not long", "long tests": "long"}
"""The tests that catch a fault -> their marks. Each tier has the tests of those before it as well."""
HANGS = 3600.0
"""Time after which tests with a fault count as hanging [s]: the fast ones take a few minutes without one."""
NO_TESTS = 5
"""Exit status of pytest if nothing is selected."""
PLACES = "tests/test_contract.py::test_a_planted_fault_has_its_place_and_its_tests"
"""The test that the text of a fault is there, which fails for each planted fault."""
NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv", "build", "dist", "__pycache__", ".*_cache", "*.egg-info", "api", "gallery"
)


def failed_test(root: Path, *arguments: str) -> str:
    """The first test that fails in a checkout, "" if none does."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *arguments]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(root), str(root / "tests")])}
    done = subprocess.Popen(
        command, cwd=root, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        text, _ = done.communicate(timeout=HANGS)
    except subprocess.TimeoutExpired:
        return f"tests that do not end within {HANGS:g} s"
    finally:
        if done.poll() is None:
            os.killpg(done.pid, signal.SIGKILL)
            done.wait()
    if done.returncode in (0, NO_TESTS):
        return ""
    found = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", text, re.MULTILINE)
    return found[1] if found else f"pytest, which ended with status {done.returncode}: {text[-300:]}"


def catching_test(fault: Fault, root: Path, sound: Path, marks: str, whole: bool) -> str:
    """The test that catches a fault in the checkout at `root`, "" if it escapes."""
    found = [path for room in fault.rooms.split() for top in ("tests", "symmb") for path in (root / top).rglob(room)]
    rooms = [path.relative_to(root).as_posix() for path in found]
    passing = [f"--deselect={PLACES}"]
    for places in (rooms, ["tests", "symmb", *(f"--ignore={room}" for room in rooms)])[: 1 + whole]:
        while test := failed_test(root, "-n", "2", "-m", marks, *places, *passing):
            if "::" not in test or not failed_test(sound, test, "-m", ""):
                return test
            passing.append(f"--deselect={test}")
            print(f"  {test} fails without the fault as well", flush=True)
    return ""


def report(fault: Fault, folder: Path, options: argparse.Namespace) -> str:
    """Plant a fault, and print what catches it; the tier that does, "" if none."""
    root = folder / fault.name
    shutil.copytree(ROOT, root, ignore=NOT_COPIED)
    begin = time.perf_counter()
    caught = ""
    if not fault.is_planted_in(root):
        word = f"cannot be planted: its text is not in {fault.file} exactly once"
    else:
        word = "ESCAPED"
        for tier, marks in list(TIERS.items())[: len(TIERS) if options.all else 1]:
            if test := catching_test(fault, root, folder / "sound", marks, not options.room):
                caught, word = tier, f"caught by {test} ({tier})"
                break
    print(f"{fault.name}: {fault.breaks}\n  {word}, {time.perf_counter() - begin:.0f} s", flush=True)
    shutil.rmtree(root, ignore_errors=True)
    return caught


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAMES", help=f"of faults: {', '.join(f.name for f in FAULTS)}")
    parser.add_argument("--all", action="store_true", help="run slow and long tests as well")
    parser.add_argument("--room", action="store_true", help="run the tests of the room alone")
    options = parser.parse_args()
    if unknown := {*options.names} - {fault.name for fault in FAULTS}:
        parser.error(f"no such fault: {', '.join(sorted(unknown))}")
    chosen = [fault for fault in FAULTS if fault.name in (options.names or {fault.name})]
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT, Path(folder) / "sound", ignore=NOT_COPIED)
        caught = [report(fault, Path(folder), options) for fault in chosen]
    for number, tier in enumerate(TIERS):
        n = sum(caught.count(earlier) for earlier in list(TIERS)[: number + 1])
        print(f"{n} of {len(chosen)} are caught by {tier}{' and those before' * (number > 0)}.")
    sys.exit(not all(caught))
