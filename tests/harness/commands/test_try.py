"""``try``: a solver of ten lines gets its page; a fault in it is a line that fails."""

import json
import re

import pytest

from mbsbench.harness.commands import assessment
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.records import RunRecord

PAGE = (ROOT / "docs" / "your-own-solver.md").read_text(encoding="utf-8")
SOLVER = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)[0]


def tried(command, tmp_path, text: str) -> dict[str, dict]:
    (tmp_path / "midpoint.py").write_text(text, encoding="utf-8")
    done = command("try", "midpoint.py", "--budget", "60", "--json", "--no-report", timeout=600.0)
    assert done.stdout, done.stderr
    return {"code": done.returncode, **{line["what"]: line for line in map(json.loads, done.stdout.splitlines())}}


@pytest.mark.slow
def test_a_solver_of_ten_lines_has_a_certificate_of_its_order(command, tmp_path):
    """Second order in position and orientation on both ladders, all symmetries, statuses on all problems."""
    found = tried(command, tmp_path, SOLVER)
    for name in assessment.LADDERS:
        for quantity in ("position", "orientation"):
            assert found[f"order, {name}, {quantity}"]["good"] is True
    assert found["symmetries"]["good"] is True and found["code"] == 0
    assert any(what.startswith("work, ") for what in found) and found["energy over many periods"]["measured"]


@pytest.mark.slow
def test_a_fault_falls_short_of_the_declared_order(command, tmp_path):
    """A stage at a third of the step is of first order."""
    assert SOLVER.count("dt / 2") == 1
    found = tried(command, tmp_path, SOLVER.replace("dt / 2", "dt / 3"))
    assert found["code"] == 1 and found["order, spherical_pendulum, position"]["good"] is False


@pytest.mark.parametrize("solver", ["rattle", "rk45_strong_form"])
def test_the_runs_are_what_the_certificates_need(solver):
    """Ladders of more than four settings, each symmetry beside a run as it stands, no run twice."""
    specs = assessment.first_runs(solver, wall=10.0)
    assert len({s.settings_id for s in specs}) == len(specs)
    for name in assessment.LADDERS:
        assert sum(s.problem == name and s.label == "ladder" and s.solver == solver for s in specs) > 4
    presented = [s for s in specs if s.label == "symmetries"]
    assert len(presented) == len(assessment.PRESENTED) + 3 and all(s.wall_limit == 10.0 for s in specs)


def test_a_long_run_is_made_only_if_it_is_long():
    """1 ms a step pays 300 swings at 0.01 s in 30 s of CPU; 100 ms a step do not pay fifty."""

    def ladder(seconds: float) -> list[RunRecord]:
        return [
            RunRecord(solver="rattle", label="ladder", problem="spherical_pendulum", steps=100, cpu_median_s=seconds)
        ]

    fast, slow = (assessment.long_run("rattle", ladder(100.0 * each), 60.0) for each in (1e-3, 1e-1))
    assert slow is None and fast is not None and fast.parameters["t_end"] == pytest.approx(assessment.LONGEST, rel=0.01)
    assert fast.label == "long"
