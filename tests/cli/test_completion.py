"""The script of `symmb completion`, in the shell itself."""

import shutil
import subprocess
import sys

import pytest

from symmb.show.cli.main import main

ASK = """
source {script}
COMP_WORDS=({line}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
$(complete -p symmb | sed 's/.*-F \\([^ ]*\\).*/\\1/')
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture
def completed(tmp_path, capsys):
    """What bash offers for the last word of a line."""
    pytest.importorskip("shtab")
    if shutil.which("bash") is None:
        pytest.skip("needs bash")
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "completion.bash"
    script.write_text(capsys.readouterr().out)
    (tmp_path / "door.py").touch()

    def ask(line):
        asked = ["bash", "--norc", "-c", ASK.format(script=script, line=line)]
        run = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert not run.stderr
        return set(run.stdout.split())

    return ask


@pytest.mark.parametrize(
    "line, offered",
    [
        ("symmb comp", {"compare", "completion"}), ("symmb compare door.py --me", {"--methods"}),
        ("symmb simulate do", {"door.py", "double_pendulum", "double_wishbone"}), ("symmb completion z", {"zsh"}),
    ],
)  # fmt: skip
def test_bash_completes(completed, line, offered):
    assert completed(line) == offered


def test_zsh_has_a_script(capsys):
    pytest.importorskip("shtab")
    assert main(["completion", "zsh"]) == 0
    assert "#compdef symmb" in capsys.readouterr().out


def test_without_shtab_a_sentence_tells_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "bash"]) == 2
    assert capsys.readouterr().err.startswith("symmb completion: this command needs shtab, which is not installed.")
