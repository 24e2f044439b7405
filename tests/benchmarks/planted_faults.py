"""Small faults, planted one by one: whether the tests catch each of them, and which test does.

    python tests/benchmarks/planted_faults.py [NAMES ...] [--all] [--room]

Each fault is planted in a copy of the checkout in a temporary folder. The fast tests of its room run first, then the
other fast ones, up to the first that fails. That test then runs without the fault, so that one which fails anyway
counts for nothing. With `--all` the slow tests of faults that escaped the fast ones run as well, with `--room` only
the fast tests of the room. The exit status is 1 if a fault escapes, or if the code it changes has moved.
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
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FAST, SLOW = "not slow and not long", "slow and not long"
HANGS = 3600.0
"""Time after which tests with a fault count as hanging [s]: the fast ones take a few minutes without one."""
NO_TESTS = 5
"""Exit status of pytest if nothing is selected."""
NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv", "build", "dist", "__pycache__", ".*_cache", "*.egg-info", "api", "gallery"
)


@dataclass(frozen=True)
class Fault:
    """A text of a file, by what it is replaced, and what that breaks. The tests of `rooms` run first."""

    name: str
    breaks: str
    file: str
    before: str
    after: str
    rooms: str

    def is_planted_in(self, root: Path) -> bool:
        """Plant the fault, if its text is in the file exactly once."""
        path = root / self.file
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        if text.count(self.before) != 1 or self.before == self.after:
            return False
        path.write_text(text.replace(self.before, self.after), encoding="utf-8")
        return True


FAULTS = (
    Fault(
        "gamma",
        "the sign of drives' accelerations in gamma",
        "symmb/equations/model/system.py",
        "-(ca.jtimes(self.Phi_dot, x, rates) + ca.jacobian(self.Phi_dot, t))",
        "-(ca.jtimes(self.Phi_dot, x, rates) - ca.jacobian(self.Phi_dot, t))",
        "model mechanics",
    ),
    Fault(
        "tableau",
        "an entry of a tableau in its seventh digit",
        "symmb/run/schemes/dop853.py",
        "4: 0.06021653898045596,",
        "4: 0.06021663898045596,",
        "codegen integrate",
    ),
    Fault(
        "jacobian",
        "the derivative by time in steps of Rosenbrock",
        "symmb/run/integrate/rosenbrock_step.py",
        "right = f(now, p, begin + c * h) + d * in_time",
        "right = f(now, p, begin + c * h)",
        "integrate",
    ),
    Fault(
        "newton",
        "the tolerance of Newton's method in implicit steps",
        "symmb/run/codegen/c/implicit_step.h",
        "(M)(change <= s->newton)",
        "(M)(change <= 1.0)",
        "integrate codegen",
    ),
    Fault(
        "switch",
        "switches that are passed to and fro within a step",
        "symmb/run/codegen/c/switches.h",
        "box[0] = v_smaller(x, x_end) + v_smaller(zero(), v_smaller(from, to)) - off;",
        "box[0] = v_smaller(x, x_end);",
        "integrate events codegen",
    ),
    Fault(
        "reset",
        "the restitution of impacts",
        "symmb/run/codegen/c/impacts.h",
        "to = -b->law[2 * N_I * N_V + N_I + k][0] * from",
        "to = -from",
        "events",
    ),
    Fault(
        "cache",
        "libraries of other flags are taken from the cache",
        "symmb/run/codegen/build.py",
        "key = _key(source, *compiler.command, compiler.version, *compiler.flags)",
        "key = _key(source, *compiler.command, compiler.version)",
        "codegen",
    ),
    Fault(
        "row",
        "a row of a joint",
        "symmb/declare/mechanics/joint.py",
        "return ca.vertcat(self._parallel(), ca.dot(A[:, 2], self.d))",
        "return self._parallel()",
        "mechanics",
    ),
    Fault(
        "friction",
        "the sign of friction",
        "symmb/declare/mechanics/friction.py",
        "return -normal_force * mu_over_u * w, ()",
        "return normal_force * mu_over_u * w, ()",
        "mechanics",
    ),
    Fault(
        "mass",
        "lumped masses of structures whose nodes turn",
        "symmb/declare/structures/matrices.py",
        "np.trace(moved[:, :3], axis1=1, axis2=2) / 3",
        "np.trace(moved[:, :3], axis1=1, axis2=2) / per_node",
        "structures",
    ),
    Fault(
        "taylor",
        "the factor of Taylor coefficients from the second on",
        "symmb/declare/symbolic/jets.py",
        "ca.jtimes(coefficients[-1], at, towards) / j)",
        "ca.jtimes(coefficients[-1], at, towards) / min(j, 2))",
        "simulation bounds",
    ),
    Fault(
        "weight",
        "weights of sparse grids",
        "symmb/bound/nodes/quadrature.py",
        "math.comb(d - 1, level - total)",
        "math.comb(d, level - total)",
        "nodes",
    ),
    Fault(
        "moments",
        "mean squares of Legendre polynomials of degree 2 and more",
        "symmb/bound/polynomials/legendre.py",
        "np.prod(2.0 * alpha + 1.0, axis=1)",
        "np.prod(np.minimum(2.0 * alpha + 1.0, 3.0), axis=1)",
        "polynomials nodes",
    ),
    Fault(
        "narrow",
        "lower bounds of Taylor expansions, whose even terms are left out",
        "symmb/bound/bounds/taylor.py",
        "lower = lower + (np.minimum(c[even], 0.0).sum(axis=0) - swing)",
        "lower = lower - swing",
        "bounds",
    ),
    Fault(
        "quantile",
        "quantiles, by up to one sample",
        "symmb/bound/bounds/probabilities.py",
        "place = q * (values.shape[-1] - 1)",
        "place = q * (values.shape[-1] - 2)",
        "bounds",
    ),
    Fault(
        "rounding",
        "bounds of rounding errors, which are rounded inward",
        "symmb/prove/rounding.py",
        "1.0 + 2.0**-30",
        "1.0 - 2.0**-30",
        "prove",
    ),
    Fault(
        "key",
        "a key of files",
        "symmb/results/files/formats.py",
        '_IN_JSON = {"t": "times", "names": "outputs"}',
        '_IN_JSON = {"t": "times"}',
        "files cli",
    ),
    Fault(
        "identity",
        "stored runs of a function whose constants have changed",
        "symmb/connect/identity.py",
        '*("co_name", "co_consts", "co_names",',
        '*("co_name", "co_names",',
        "connect",
    ),
    Fault(
        "doubt",
        "doubts about impacts that a run has missed",
        "symmb/run/simulation/run_doubts.py",
        "*_gap_doubts(runs, solver),",
        "",
        "simulation events verification",
    ),
    Fault(
        "energy",
        "the sign of the work in the balance of energy",
        "symmb/run/verification/examination.py",
        "balance = energy.kinetic + energy.potential - energy.work",
        "balance = energy.kinetic + energy.potential + energy.work",
        "verification",
    ),
    Fault(
        "equilibrium",
        "unstable equilibria, which are taken as starts",
        "symmb/equations/start/equilibrium.py",
        "if damped or is_stable(J[:n, :n], J[n:, :n]):",
        "if damped or J is not None:",
        "start",
    ),
    Fault(
        "damping",
        "the sign of the damping of modes",
        "symmb/run/linear/result.py",
        "else -self.eigenvalue.real / abs(self.eigenvalue)",
        "else self.eigenvalue.real / abs(self.eigenvalue)",
        "linear",
    ),
    Fault(
        "coverage",
        "the share of times at which bounds contain their reference, by its tolerance",
        "symmb/study/metrics.py",
        "(outer_upper >= self.upper - tolerance)",
        "(outer_upper >= self.upper + tolerance)",
        "study",
    ),
    Fault(
        "unit",
        "units of an FMU, whose seconds and radians are exchanged",
        "symmb/show/exchange/description.py",
        "zip(BASES, known.powers, strict=True)",
        'zip(("m", "kg", "rad", "s", "A", "K"), known.powers, strict=True)',
        "exchange",
    ),
    Fault(
        "status",
        "the exit status of doubtful results",
        "symmb/show/cli/main.py",
        "else 3 if result else 0",
        "else 0",
        "cli",
    ),
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
    rooms = [f"{top}/{room}" for room in fault.rooms.split() for top in ("tests", "symmb")]
    rooms = [room for room in rooms if (root / room).exists()]
    passing = list[str]()
    for places in (rooms, ["tests", "symmb", *(f"--ignore={room}" for room in rooms)])[: 1 + whole]:
        while test := failed_test(root, "-n", "2", "-m", marks, *places, *passing):
            if "::" not in test or not failed_test(sound, test, "-m", ""):
                return test
            passing.append(f"--deselect={test}")
            print(f"  {test} fails without the fault as well", flush=True)
    return ""


def report(fault: Fault, folder: Path, options: argparse.Namespace) -> bool:
    """Plant a fault, and print what catches it; whether something does."""
    root = folder / fault.name
    shutil.copytree(ROOT, root, ignore=NOT_COPIED)
    begin = time.perf_counter()
    caught = ""
    if not fault.is_planted_in(root):
        word = f"cannot be planted: its text is not in {fault.file} exactly once"
    else:
        for marks in (FAST, SLOW)[: 1 + options.all]:
            if caught := catching_test(fault, root, folder / "sound", marks, not options.room):
                break
        word = f"caught by {caught}" if caught else "ESCAPED"
    print(f"{fault.name}: {fault.breaks}\n  {word} ({time.perf_counter() - begin:.0f} s)", flush=True)
    shutil.rmtree(root, ignore_errors=True)
    return bool(caught)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAMES", help=f"of faults: {', '.join(f.name for f in FAULTS)}")
    parser.add_argument("--all", action="store_true", help="run slow tests as well")
    parser.add_argument("--room", action="store_true", help="run the tests of the room alone")
    options = parser.parse_args()
    if unknown := {*options.names} - {fault.name for fault in FAULTS}:
        parser.error(f"no such fault: {', '.join(sorted(unknown))}")
    chosen = [fault for fault in FAULTS if fault.name in (options.names or {fault.name})]
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT, Path(folder) / "sound", ignore=NOT_COPIED)
        caught = [report(fault, Path(folder), options) for fault in chosen]
    print(f"{sum(caught)} of {len(chosen)} are caught.")
    sys.exit(not all(caught))
