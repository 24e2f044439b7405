"""Built libraries and the cache: shared, killed, damaged, planted, unwritable and full; NaN and infinity in lanes."""

import ctypes
import errno
import hashlib
import importlib
import math
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from faults import refused, warned
from mechanisms import double_pendulum
from processes import in_time, program

import symmb as mb
from symmb.run.codegen import Engine, Lanes, StepTolerances, build, cache, model_function
from symmb.run.codegen.c_source import c_source

ANSWER, PLANTED = "int answer(void) { return 42; }\n", "int answer(void) { return 666; }\n"
ROOT = Path(mb.__file__).parents[1]
LOADS = f"from symmb.run.codegen.build import load; print(load({ANSWER!r}).answer())"


def libraries(folder):
    """All files of a cache but the notes on compilers, which are empty and never loaded."""
    return [path for path in folder.iterdir() if path.suffix != ".note"]


def answer(source=ANSWER):
    """What a library says, from the cache folder as it is now: loaded anew, unlike by `load`."""
    return build._loaded.__wrapped__(source, build._compiler()).answer()


def process(folder, **environment):
    options = {"stdout": subprocess.PIPE, "text": True, "start_new_session": True}
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder), **environment}
    return subprocess.Popen([sys.executable, "-c", LOADS], cwd=ROOT, env=environment, **options)


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """Name and bytes of the library of ANSWER, and the bytes of another with the same function."""
    build._compiler()  # its note goes into the cache of before
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        assert answer() == 42
        (good,) = cache.contents()
        assert answer(PLANTED) == 666
        (planted,) = set(cache.contents()) - {good}
        return good.name, good.read_bytes(), planted.read_bytes()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty cache folder, where no library has been loaded from."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return cache.folder()


@pytest.fixture
def compilers(monkeypatch):
    """No compiler is known not to work. Afterwards it is as before."""
    monkeypatch.setattr(build, "_UNUSABLE", {})
    build._compiler.cache_clear()
    yield
    monkeypatch.undo()
    build._compiler.cache_clear()


def forget_compilers():
    build._UNUSABLE.clear()
    build._compiler.cache_clear()
    build._loaded.cache_clear()


def full(*arguments, **options):
    raise OSError(errno.ENOSPC, "No space left on device")


def short_pendulum():
    return double_pendulum(np.linspace(0.0, 0.1, 3), box=mb.Box(l1=(0.95, 1.05)))


def planted_in(folder, made):
    """A whole library under the key of ANSWER that is not the one of ANSWER: loaded where trust is misplaced."""
    name, _, content = made
    path = folder / f"{name.partition('-')[0]}-{hashlib.sha256(content).hexdigest()}.so"
    path.write_bytes(content)
    return path


def test_the_folder_is_made_for_its_owner_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "deep" / "cache"))
    before = os.umask(0o022)
    try:
        made = cache.folder()
    finally:
        os.umask(before)
    assert made == (tmp_path / "deep" / "cache" / "symmb").resolve()
    assert made.stat().st_mode & 0o777 == 0o700


def test_a_relative_cache_home_counts_as_none(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert cache.folder() == (tmp_path / ".cache" / "symmb").resolve()


@pytest.mark.parametrize("changed", ["source", "path", "version", "flags", "processor"])
def test_another_source_compiler_or_processor_is_another_library(folder, monkeypatch, changed):
    assert answer() == 42
    compiler = build._compiler()
    path = f"{Path(compiler.path).parent}/./{Path(compiler.path).name}"
    other = {"path": path, "version": "another", "flags": (*compiler.flags, "-DOTHER")}
    if changed in other:
        monkeypatch.setattr(build, "_compiler", lambda: replace(compiler, **{changed: other[changed]}))
    if changed == "processor":
        monkeypatch.setattr(build, "_processor", lambda: "another")
    assert answer(ANSWER + "\n" * (changed == "source")) == 42
    assert len({path.name.partition("-")[0] for path in cache.contents() if path.suffix != ".note"}) == 2


def test_processes_that_build_the_same_at_once_all_get_it(folder):
    processes = [process(folder.parent) for _ in range(4)]
    assert [run.communicate(timeout=60)[0] for run in processes] == ["42\n"] * 4
    assert {path.suffix for path in libraries(folder)} == {".so"}


def test_a_killed_build_leaves_nothing_that_is_loaded(folder, tmp_path):
    started, real = tmp_path / "started", build._compiler().path
    slow = f'case "$*" in *model.c*) echo half > "$3"; touch {started}; sleep 60;; esac\nexec {real} "$@"'
    compiler = program(tmp_path / "slow-cc", slow)
    temporary = tmp_path / "tmp"
    temporary.mkdir(mode=0o700)
    run = process(folder.parent, CC=str(compiler), TMPDIR=str(temporary))
    in_time(started.exists, 60)
    os.killpg(run.pid, signal.SIGKILL)
    assert run.communicate() == ("", None) and run.returncode == -signal.SIGKILL and started.exists()
    assert list(libraries(folder)) == []
    assert answer() == 42


def test_what_a_process_killed_while_writing_leaves_is_not_loaded(folder, made):
    part = f"{made[0].partition('-')[0]}-half.part"
    (folder / part).write_bytes(made[2][:1000])
    assert answer() == 42
    assert {path.name for path in cache.contents()} == {part, made[0]}


@pytest.mark.parametrize(
    "damage",
    [
        lambda b: b"",
        lambda b: b"no library",
        lambda b: b[: len(b) // 2],  # loading this ends the process with SIGBUS
        lambda b: b[:-1],
        lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 1]) + b[len(b) // 2 + 1 :],
        lambda b: bytes(len(b)),
    ],
    ids=["empty", "text", "half", "one byte less", "one bit", "zeros"],
)
def test_a_damaged_library_is_built_again(folder, made, damage):
    name, content, _ = made
    (folder / name).write_bytes(damage(content))
    run = process(folder.parent)
    assert (run.communicate(timeout=60)[0], run.returncode) == ("42\n", 0)
    assert [hashlib.sha256(path.read_bytes()).hexdigest() in path.name for path in libraries(folder)] == [True]


def test_a_planted_library_would_be_found(folder, made, monkeypatch):
    """What the tests below refuse is loaded, and not built again, where nothing speaks against it."""
    monkeypatch.setattr(build, "_built", lambda *_: pytest.fail("built although it is in the cache"))
    planted_in(folder, made)
    assert answer() == 666


@pytest.mark.parametrize("mode", [0o777, 0o1777, 0o720, 0o702])
@pytest.mark.parametrize("place", ["folder", "parent", "grandparent"])
def test_nothing_is_taken_from_where_others_can_write(tmp_path, monkeypatch, made, place, mode):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / "cache"))
    folder = cache.folder()
    planted = planted_in(folder, made)
    opened = {"folder": folder, "parent": folder.parent, "grandparent": folder.parent.parent}[place]
    opened.chmod(mode)
    if mode == 0o1777 and place != "folder":  # like /tmp: others cannot rename what is in it
        assert cache.folder() == folder
        return
    refused(rf"others can write to {opened}\. Delete .* or set XDG_CACHE_HOME", cache.folder, error=mb.SymmbError)
    assert answer() == 42
    assert list(folder.iterdir()) == [planted]


def test_nothing_is_taken_from_a_folder_of_another_user(folder, made, monkeypatch):
    planted_in(folder, made)
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    refused("belongs to another user", cache.folder, error=mb.SymmbError)
    assert cache.find(made[0].partition("-")[0]) is None


@pytest.mark.skipif(os.name != "posix" or os.getuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("place", ["file", "folder", "parent"])
def test_nothing_given_away_is_loaded(folder, made, place):
    path = planted_in(folder, made)
    os.chown({"file": path, "folder": folder, "parent": folder.parent}[place], 65534, 65534)
    assert answer() == 42


@pytest.mark.parametrize("kind", ["writable by others", "writable by the group", "link", "pipe", "folder"])
def test_no_such_file_is_loaded(folder, made, tmp_path, kind):
    path, elsewhere = planted_in(folder, made), tmp_path / "elsewhere.so"
    change = {
        "writable by others": lambda: path.chmod(0o702),
        "writable by the group": lambda: path.chmod(0o720),
        "link": lambda: path.replace(elsewhere) and path.symlink_to(elsewhere),
        "pipe": lambda: path.replace(elsewhere) and os.mkfifo(path, 0o600),
        "folder": lambda: path.replace(elsewhere) and path.mkdir(),
    }
    change[kind]()
    assert answer() == 42


def test_links_are_followed_to_folders_that_are_the_user_s_own(tmp_path, monkeypatch, made):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    target = tmp_path / "elsewhere" / "target"
    target.mkdir(parents=True, mode=0o700)
    (tmp_path / "symmb").symlink_to(target)
    assert cache.folder() == target.resolve()
    planted_in(target, made)
    target.parent.chmod(0o777)
    refused(f"others can write to {target.parent}", cache.folder, error=mb.SymmbError)
    assert answer() == 42


def test_nothing_is_built_where_others_can_write(folder, tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setattr("tempfile.tempdir", str(shared))
    refused(f"others can write to {shared}.*set TMPDIR", answer, error=mb.SymmbError)


@pytest.mark.parametrize("blocked", ["cache", "cache/symmb"])
def test_without_a_folder_it_is_built_each_time(tmp_path, monkeypatch, blocked):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / blocked
    path.parent.mkdir(exist_ok=True)
    path.write_text("a file where the folder should be")
    assert answer() == 42


NO_ROOT = pytest.mark.skipif(os.name != "posix" or os.getuid() == 0, reason="root writes anywhere")


@pytest.mark.parametrize("kind", [pytest.param("unwritable", marks=NO_ROOT), "full"])
def test_a_folder_that_takes_nothing_is_no_hindrance(folder, monkeypatch, kind):
    if kind == "full":
        monkeypatch.setattr(os, "replace", full)
    else:
        folder.chmod(0o500)
    assert answer() == 42
    assert list(folder.iterdir()) == []


def test_a_source_that_no_compiler_builds_is_told(folder, compilers):
    with pytest.raises(build.NoCompilerError), pytest.warns(mb.SymmbWarning, match="cannot build a model: .*error"):
        build.load("this is no C\n")
    assert libraries(folder) == []


@pytest.mark.parametrize("unknown", ["-march=native", "-lmvec"])
def test_a_compiler_that_does_not_know_an_option_does_without(folder, tmp_path, monkeypatch, unknown):
    script = f'for a; do [ "$a" = {unknown} ] && exit 1; done\nexec {shutil.which("cc")} "$@"'
    compiler = program(tmp_path / "cc", script)
    monkeypatch.setenv("CC", str(compiler))
    found = build._compiler.__wrapped__()
    assert found.path == str(compiler) and unknown not in found.flags
    monkeypatch.setattr(build, "_compiler", lambda: found)
    assert answer() == 42


@pytest.mark.parametrize("flags", ["-foo", "-c", '-O1 "'])
def test_flags_with_which_no_compiler_works_are_named(folder, compilers, monkeypatch, flags):
    monkeypatch.setenv("SYMMB_CFLAGS", flags)
    refused(f"SYMMB_CFLAGS is '{flags}'", build._compiler)


def let_hang_briefly(monkeypatch, *words):
    """A limit of half a second for commands with these words, which hang, in the place of their own.

    Others may share a busy machine.
    """
    run = build.run_program

    def hurried(command, seconds, *folder):
        return run(command, 0.5 if all(word in " ".join(command) for word in words) else seconds, *folder)

    monkeypatch.setattr(build, "run_program", hurried)


@pytest.mark.parametrize("given", ["gcc-99", "gcc-99 -O1", "/no/such/cc"])
def test_a_cc_that_is_not_there_is_told(folder, compilers, monkeypatch, given):
    monkeypatch.setenv("CC", given)
    assert warned(f"CC is '{given}', but there is no such program", build.has_compiler)


def test_a_compiler_that_does_not_answer_in_time_is_named(folder, compilers, monkeypatch):
    let_hang_briefly(monkeypatch)
    monkeypatch.setattr(build, "_candidates", lambda: iter([(shutil.which("sh"), "-c", "sleep 5", "sh")]))
    with pytest.warns(mb.SymmbWarning, match="longer than 20 s to print its version"):
        told = "^A study needs a C compiler, .*sleep 5.*longer than 20 s"
        refused(told, build.require_compiler, "A study", error=build.NoCompilerError)


def test_the_oldest_files_leave_a_cache_that_is_too_large(folder, monkeypatch):
    monkeypatch.setattr(cache, "LARGEST", 1000)
    keys = [f"{k:032x}" for k in range(12)]
    for k, key in enumerate(keys):
        cache.keep(key, bytes([k]) * 90)
        for path in folder.glob(f"{key}-*"):
            os.utime(path, (k, k))
        assert cache.find(keys[0]), "it was used last"
        os.utime(cache.find(keys[0]), (1e9, 1e9))
    kept = [key for key in keys if cache.find(key)]
    assert kept == [keys[0], *keys[-len(kept) + 1 :]] and 8 <= len(kept) <= 11
    (folder / "notes.txt").write_text("of the user" * 100)
    cache.keep(f"{99:032x}", b"x" * 90)
    assert (folder / "notes.txt").exists()


@pytest.mark.parametrize("name, arguments", [("my cc", ""), ("mycc", " cc -DOTHER")], ids=["blank", "arguments"])
def test_cc_is_a_path_or_a_path_with_arguments(folder, compilers, tmp_path, monkeypatch, name, arguments):
    compiler = program(tmp_path / name, f'[ "$1" = cc ] && shift\nexec {shutil.which("cc")} "$@"')
    monkeypatch.setenv("CC", f"{compiler}{arguments}")
    assert build._compiler().command == (str(compiler), *arguments.split())
    assert build.load(ANSWER, "answer").answer() == 42


def test_without_another_compiler_that_of_ziglang_builds(folder, compilers, monkeypatch):
    """Its first library takes seconds: it builds parts of the C library for itself."""
    pytest.importorskip("ziglang")
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    path, *arguments = build._compiler().command
    assert Path(path).parent.name == "ziglang" and arguments == ["cc"]
    scene = double_pendulum(np.linspace(0.0, 1.0, 5), box=mb.Box(l1=(0.95, 1.05)))
    compiled = mb.propagate(scene, mb.Vertex(), solver=mb.DormandPrince(rtol=1e-9)).lower
    np.testing.assert_allclose(compiled, mb.propagate(scene, mb.Vertex(), solver=mb.CVODES(rtol=1e-9)).lower, atol=1e-6)


BAD = {
    "is no program": ("no program", "cannot be started"),
    "only reports success": ("#!/bin/sh\nexit 0", "reports success, but writes no library"),
    "writes rubbish": ('#!/bin/sh\nwhile [ "$1" != -o ]; do shift; done; echo rubbish > $2', ""),
    "fails": ("#!/bin/sh\necho 'error: no licence' >&2; exit 1", "error: no licence"),
    "hangs at once": ("#!/bin/sh\nsleep 60", "longer than 20 s to print its version"),
    "hangs": ('#!/bin/sh\n[ "$1" = --version ] || sleep 60', "longer than 120 s"),
    "is for C++": (f'#!/bin/sh\nexec {shutil.which("g++")} -xc++ "$@"', "error"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_compiler_that_does_not_work_gives_way_to_the_next(folder, compilers, tmp_path, monkeypatch, kind):
    script, told = BAD[kind]
    if kind == "is for C++" and shutil.which("g++") is None:
        pytest.skip("needs g++")
    compiler = tmp_path / "bad"
    compiler.write_text(script + "\n")
    compiler.chmod(0o700)
    monkeypatch.setenv("CC", str(compiler))
    if "hangs" in kind:
        let_hang_briefly(monkeypatch, str(compiler), "--version" if "once" in kind else "-o")
    assert warned(f"{compiler} is not used: .*{told}", build.load, ANSWER).answer() == 42
    assert build._compiler().path != str(compiler)


HIDDEN = f'exec {shutil.which("cc")} "$@" -fvisibility=hidden'
EMPTY = (
    f'for name; do [ "$last" = -o ] && break; last=$name; done; echo | {shutil.which("cc")} -shared -xc - -o "$name"'
)
"""Compilers whose libraries have no symbols."""


@pytest.mark.parametrize(
    "how", ["sleep 60", "exit 1", "exit 0", HIDDEN, EMPTY], ids=["slow", "fails", "does nothing", "hidden", "empty"]
)
def test_a_compiler_that_fails_at_a_model_gives_way_to_the_next_and_then_to_cvodes(
    folder, compilers, tmp_path, monkeypatch, how
):
    script = f'case "$*" in *model.c*|*shared[12].c*) {how};; *) exec {shutil.which("cc")} "$@";; esac'
    compiler = program(tmp_path / "bad", script)
    monkeypatch.setenv("CC", str(compiler))
    if "sleep" in how:
        let_hang_briefly(monkeypatch, str(compiler), "model.c")
    assert warned(f"{compiler} is not used", build.load, ANSWER, "answer").answer() == 42
    forget_compilers()
    monkeypatch.setattr(shutil, "which", lambda name: str(compiler) if name == str(compiler) else None)
    scene = short_pendulum()
    with pytest.warns(mb.SymmbWarning, match="is not used|Without a C compiler runs take") as told:
        bounds = mb.propagate(scene, mb.Vertex())
    assert ["Without a C compiler" in str(warning.message) for warning in told] == [False, True]
    assert all(f"{compiler} is not used" in str(warning.message) for warning in told)
    for solver in mb.DormandPrince(), mb.Rosenbrock():
        refused(None, mb.propagate, scene, mb.Vertex(), solver=solver, error=build.NoCompilerError)
    np.testing.assert_allclose(bounds.lower, mb.propagate(scene, mb.Vertex(), solver=mb.CVODES()).lower, atol=1e-5)


@pytest.mark.parametrize("place", ["missing", "full"])
def test_a_bad_folder_for_temporary_files_gives_way_to_cvodes(folder, compilers, tmp_path, monkeypatch, place):
    if place == "missing":
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    else:
        monkeypatch.setattr(Path, "write_text", full)
    scene = short_pendulum()
    bounds = warned("is not used: .*(No space left|No such file)|No C compiler found", mb.propagate, scene, mb.Vertex())
    monkeypatch.undo()
    forget_compilers()
    np.testing.assert_allclose(bounds.lower, mb.propagate(scene, mb.Vertex()).lower, atol=1e-5)


def test_nan_and_infinity_pass_through():
    """Each expression as IEEE 754 has it, from Python's floats; flags that assume finite numbers would differ."""
    nan, inf = math.nan, math.inf
    expected = {
        "v_sqrt(a)": [nan, inf, nan, nan],
        "v_exp(a)": [math.exp(-1.0), inf, 0.0, nan],
        "v_log(zero() + 0.0)": [-inf] * 4,
        "a / 0.0": [-inf, inf, -inf, nan],
        "a - a": [0.0, nan, nan, nan],
        "a * 0.0": [-0.0, nan, nan, nan],
        "truth(a != a)": [0.0, 0.0, 0.0, 1.0],
        "truth(a == a)": [1.0, 1.0, 1.0, 0.0],
        "truth(a < 0.0)": [1.0, 0.0, 1.0, 0.0],
        "choose(a > 0.0, 1.0, a)": [-1.0, 1.0, -inf, nan],
        "v_pow(a, zero() + 0.5)": [nan, inf, inf, nan],
        "v_tan(a)": [math.tan(-1.0), nan, nan, nan],
    }
    lines = [f"{{ V b = {e}; for (int l = 0; l < 4; ++l) out[{4 * i} + l] = b[l]; }}" for i, e in enumerate(expected)]
    begin = "void all(const double *in, double *out) {\nV a = zero();\nfor (int l = 0; l < W; ++l) a[l] = in[l % 4];"
    library = build.load("\n".join([c_source("lanes"), begin, *lines, "}\n"]))
    values, told = (ctypes.c_double * 4)(-1.0, inf, -inf, nan), (ctypes.c_double * (4 * len(expected)))()
    library.all(values, told)
    for i, (expression, wanted) in enumerate(expected.items()):
        assert list(told[4 * i : 4 * i + 4]) == pytest.approx(wanted, rel=1e-14, nan_ok=True), expression


def test_what_a_compiler_can_do_is_asked_once_and_for_each_anew(folder, tmp_path):
    asked = tmp_path / "asked"
    script = f'case "$*" in *probe.c*) echo x >> {asked};; esac\nexec {build._compiler().path} "$@"'
    wrapper = program(tmp_path / "wrapper", script)
    for _ in range(2):
        run = process(folder.parent, CC=str(wrapper))
        assert (run.communicate(timeout=60)[0], run.returncode) == ("42\n", 0)
    assert asked.read_text().count("x") == 1


def test_a_library_that_lacks_its_end_is_not_loaded(tmp_path, made):
    whole = made[1]
    for size in (0, 3, 40, 100, 5000, len(whole) // 2):
        assert not build._has_its_segments(whole[:size]) or not whole[:size].startswith(b"\x7fELF\x02")
        (tmp_path / "cut.so").write_bytes(whole[:size])
        assert build._opened(tmp_path / "cut.so") is None
    (tmp_path / "whole.so").write_bytes(whole)
    assert build._opened(tmp_path / "whole.so") is not None


@pytest.mark.parametrize("model", ["double_pendulum", "spherical_pendulum"])
def test_models_of_other_sizes_share_the_engine(model, folder, monkeypatch):
    """The object file of the engine is compiled once, and fits models of other sizes: runs are the same bits."""
    scene = importlib.import_module(f"models.{model}").scene()
    alone = mb.simulate(scene, mb.DormandPrince(stabilization=None))
    commands, run = [], build.run_program
    monkeypatch.setattr(
        build, "run_program", lambda command, *rest: commands.append(command[-1]) or run(command, *rest)
    )
    build._loaded.cache_clear()
    x, p, t = ca.SX.sym("x", 3), ca.SX.sym("p", 1), ca.SX.sym("t")
    for rates in (-p * x, ca.vertcat(x[1:], -p * x[0])):
        f = model_function(x, p, t, rates, x[:2], None)
        Engine(Lanes(f, StepTolerances(1e-8, 1e-8)), np.linspace(0, 1, 3)).values(np.ones((5, 3)), np.ones((5, 1)))
    assert len(commands) == 2 and not any("shared2.c" in command for command in commands)
    again = mb.simulate(importlib.import_module(f"models.{model}").scene(), mb.DormandPrince(stabilization=None))
    assert "shared2.c" not in commands[-1] and len([*folder.glob("*.o")]) == 4  # three models and the engine
    assert scene.outputs and all((again[name] == alone[name]).all() for name in scene.outputs)


def test_a_damaged_engine_is_compiled_again(folder):
    x = ca.SX.sym("x", 2)
    for k in range(2):
        build._loaded.cache_clear()
        f = model_function(x, ca.SX.sym("p", 1), ca.SX.sym("t"), -(k + 1.0) * x, x, None)
        engine = Engine(Lanes(f, StepTolerances(1e-9, 1e-9)), np.array([0.0, 1.0]))
        Y, _ = engine.values(np.ones((1, 2)), np.ones((1, 1)))
        np.testing.assert_allclose(Y[0, 1], np.exp(-(k + 1.0)), rtol=1e-8)
        for kept in folder.glob("*.o"):
            kept.write_bytes(kept.read_bytes()[:100])


@pytest.mark.parametrize("flag", ["-ffast-math", "-std=c99", "-DWIDTH=4"])
def test_flags_that_change_results_or_hide_functions_are_refused(flag, folder, compilers, monkeypatch):
    monkeypatch.setenv("SYMMB_CFLAGS", flag)
    refused("SYMMB_CFLAGS is", build.load, ANSWER)


def test_an_alarm_of_the_user_during_a_compilation_passes_through(folder, compilers, tmp_path, monkeypatch):
    def ring(*_):
        raise TimeoutError("the user's")

    monkeypatch.setenv("CC", str(program(tmp_path / "slow", "sleep 20")))
    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(TimeoutError, match="the user's"):
            build.load(ANSWER)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert not build._UNUSABLE
