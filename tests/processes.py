"""Whether processes run, and programs that they start."""

import shutil
import subprocess
import time
from pathlib import Path


def in_time(holds, seconds):
    """Whether something comes true within some seconds."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and not holds():
        time.sleep(0.05)
    return holds()


def program(path, script):
    """The path of a program in the language of the shell, which is written there."""
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(0o700)
    return path


def printed_lines(folder):
    """Lines that the program of all C files of a folder prints; it is built there."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    sources = [path.name for path in folder.glob("*.c")]
    subprocess.run([compiler, *sources, "-lm", "-o", "program"], cwd=folder, check=True)
    run = subprocess.run([str(folder / "program")], cwd=folder, capture_output=True, text=True, check=True)
    return run.stdout.splitlines()


def runs(number):
    """Whether a process runs; one that has ended and that nobody has asked for its status does not."""
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
