"""The walk through docs/judging.md: thresholds are written, the gate is open, a planted fault closes it."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.judge.gate.baseline import read_thresholds
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT

PAGE, _, FILES = (
    (ROOT / "docs" / "judging.md").read_text(encoding="utf-8").partition("## A gate of your own")[2]
).partition("## A gate of motions from files")
AWK = (ROOT / "docs" / "examples" / "top.awk").read_text(encoding="utf-8")
SOLVER = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "your-own-solver.md").read_text(encoding="utf-8"), re.S)[0]
(SUITE,) = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.S)
SETTING, GATING = (block.splitlines() for block in re.findall(r"```sh\n(.*?)```", FILES, flags=re.S))
OPENING, CLOSING = (block.splitlines() for block in re.findall(r"```sh\n(.*?)```", PAGE, flags=re.S))


@pytest.mark.slow
def test_the_page_s_gate_opens_and_a_planted_fault_closes_it(command, tmp_path):
    """Every command of the page, in a folder with the page's files."""
    Path(tmp_path / "midpoint.py").write_text(SOLVER, encoding="utf-8")
    Path(tmp_path / "gate.toml").write_text(SUITE, encoding="utf-8")
    for line in OPENING:
        done = command(*shlex.split(line)[1:], timeout=300.0)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "gate open" in done.stdout
    bounds = read_thresholds(tmp_path / "thresholds.toml").bounds
    assert {"energy_drift_max_J", "phi_max", "position_error_max_m", "steps"} <= {b.metric for b in bounds}
    (planted, again) = CLOSING
    old, new = shlex.split(planted)[2].split("|")[1:3]
    assert SOLVER.count(old) == 1  # else nothing is planted
    Path(tmp_path / "midpoint.py").write_text(SOLVER.replace(old, new), encoding="utf-8")
    done = command(*shlex.split(again)[1:], timeout=300.0)
    assert done.returncode == 1 and "gate CLOSED" in done.stdout and "FAIL" in done.stdout


def test_the_example_for_github_runs_the_page_s_command():
    """The file is copied as it is: its command must be the one that the page has tried."""
    example = (ROOT / "docs" / "gate-github.yml").read_text(encoding="utf-8")
    assert f"- run: {OPENING[-1]} --junit gate.xml --markdown" in example


@pytest.mark.beyond_core
@pytest.mark.skipif(shutil.which("awk") is None, reason="awk is not installed")
def test_motions_from_files_are_gated_as_the_page_says(tmp_path, monkeypatch, capsys):
    """Thresholds come from a judged file; the same file opens the gate, a wrong sign and a missing file close it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(store, "LOCAL", tmp_path / "local")
    monkeypatch.setenv("COLUMNS", "200")

    def run(line: str) -> int:
        if line.startswith("awk"):
            return subprocess.run(line, shell=True, check=True, timeout=60.0).returncode
        return main(shlex.split(line)[1:])

    Path("top.awk").write_text(AWK, encoding="utf-8")
    assert [run(line) for line in (*SETTING, *GATING)] == [0] * 6
    assert "gate open" in capsys.readouterr().out
    bounds = read_thresholds(Path("awk.toml")).bounds
    assert {"energy_drift_max_J", "phi_max", "position_error_max_m"} <= {b.metric for b in bounds}
    assert AWK.count("(It - Ia) * y[5]") == 1
    Path("top.awk").write_text(AWK.replace("(It - Ia) * y[5]", "(Ia - It) * y[5]"), encoding="utf-8")
    run(GATING[0])
    assert run(GATING[1]) != 0 and run(GATING[2]) == 1
    said = capsys.readouterr()
    assert "gate CLOSED" in said.out and "where a number should have moved, add --update" in said.err
    run(GATING[1].replace("awk_rk4", "another"))
    assert run(GATING[2]) == 1 and "no threshold for this run" in capsys.readouterr().out
    Path("empty/runs").mkdir(parents=True)
    assert run("mbsbench gate --results empty --thresholds new.toml --update --write") == 2
    assert not Path("new.toml").exists() and "nothing was written" in capsys.readouterr().err
