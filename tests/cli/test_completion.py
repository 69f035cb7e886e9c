"""Shells complete commands, options, and names of problems, solvers and suites."""

import shutil
import subprocess
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.cli.commands import SHELLS

ASK = """source {script}
line=({words}); COMP_WORDS=("${{line[@]}}"); COMP_CWORD=$((${{#line[@]}} - 1)); COMP_LINE="${{line[*]}}"
COMP_POINT=${{#COMP_LINE}}; function=$(complete -p mbsbench | sed 's/.*-F \\([^ ]*\\).*/\\1/')
$function mbsbench "${{line[-1]}}" "${{line[-2]}}"; echo "${{COMPREPLY[*]}}"
"""


def script_for(shell: str, folder: Path, capsys) -> Path:
    assert main(["completion", shell]) == 0
    out, err = capsys.readouterr()
    assert not err and f"mbsbench completion {shell} > " in "".join(out.splitlines(keepends=True)[:2])
    (folder / "script").write_text(out)
    return folder / "script"


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("mbsbench comple", "completion"),
        ("mbsbench solve spring_p", "spring_pendulum"),
        ("mbsbench solve chain gc_w", "gc_weak_form"),
        ("mbsbench run certif", "certificates"),
        ("mbsbench run paper --res", "--resume"),
        ("mbsbench completion f", "fish"),
        ("mbsbench advise chain --solver gc_ex", "gc_extrapolated"),
        ("mbsbench list probl", "problems"),
        ("mbsbench show res", "results_of_mine/"),
    ],
)
def test_bash_completes(tmp_path, capsys, monkeypatch, words, found):
    """The last word of a line becomes what it is the beginning of; a results folder is found where one is."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results_of_mine").mkdir()
    asked = ASK.format(script=script_for("bash", tmp_path, capsys), words=words)
    done = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, timeout=20, check=True)
    assert done.stdout.strip() == found and not done.stderr


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_reads_its_script(tmp_path, capsys, shell):
    """Its syntax is checked by the shell itself, where it is installed."""
    script = script_for(shell, tmp_path, capsys)
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    subprocess.run([shell, "-n", script], capture_output=True, timeout=20, check=True)
