"""Solver requirements: the worked example meets them, each fault is named, entry points run only when named."""

import importlib
import json
import re
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import plugins, registry
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.judge.conformance import trials
from mbsbench.harness.mechanics.types import StepControl
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.run.warmup import list_runs_to_warm
from mbsbench.tests.factories import PLUGIN

PAGES = ("solver-contract.md", "your-own-solver.md")
CLASS, FUNCTION = (
    re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), flags=re.S)[0]
    for page in PAGES
)
each_example = pytest.mark.parametrize("example", [CLASS, FUNCTION], ids=PAGES, indirect=True)

BROKEN = '''
import dataclasses, random, time
from mbsbench import Status, solver

@solver("midpoint_broken")
@dataclasses.dataclass(frozen=True)
class Broken(Midpoint):
    """Less gravity; no limits; noise."""

    def refuses(self, problem, control):
        return "no" if problem.name == "four_bar_grid" else None

    def solve(self, problem, control):
        gravity = 0.97 * problem.system.gravity * (1 + 1e-9 * random.random())
        wrong = dataclasses.replace(problem.system, gravity=gravity)
        control = dataclasses.replace(control, max_steps=10**7, cpu_limit=1e6)
        return super().solve(dataclasses.replace(problem, system=wrong), control)
'''


@pytest.fixture
def example(tmp_path, request):
    """A page's solver as a file."""
    path = tmp_path / "midpoint.py"
    path.write_text(getattr(request, "param", CLASS), encoding="utf-8")
    return path


@pytest.mark.slow
@each_example
def test_the_worked_example_meets_the_requirements(example, command):
    """A page prints a whole solver. Of a function limits, recording, repetition and reactions are ours."""
    done = command("check", str(example), timeout=180.0)
    assert done.returncode == 0, done.stdout + done.stderr
    refuses = "refuses" in example.read_text(encoding="utf-8")  # one whose refusals there are
    assert ("17 of 17" if refuses else "16 of 17") + " requirements met" in done.stdout
    assert ("1 not tested" in done.stdout) is not refuses


@pytest.mark.sampled(1)
@each_example
def test_the_worked_example_runs(example, command, tmp_path):
    """The page's command, on its short side."""
    step = ("--set", "dt=0.001", "--t-end", "0.05", "--out", "top.npz")
    done = command("solve", "heavy_top", "midpoint", "--plugin", str(example), *step)
    assert done.returncode == 0, done.stdout + done.stderr


def test_where_nothing_was_refused_nothing_is_met():
    """Nothing measured is not met: it is not tested."""
    taken = RunRecord(status="success", claimed="success")
    silent = RunRecord(status="refused", claimed="refused", message="no")
    for records, holds, tested in (([taken], True, False), ([taken, silent], False, True)):
        found = trials.check_refusals(trials.Evidence("dt", 2.0, {str(k): r for k, r in enumerate(records)}, {}))
        assert (found.holds, found.is_tested) == (holds, tested)


@pytest.mark.slow
def test_each_requirement_not_met_is_explained(example, command, tmp_path):
    """Wrong gravity, a refusal in one word, no limits, noise: nine fail, each with a reason and a remedy.

    Gravity alone makes four of them fail: its motions and reactions keep their errors at any step, and a mechanism
    whose accelerations and moments of reactions are known is judged wrong.
    """
    path = tmp_path / "broken.py"
    path.write_text(CLASS.replace('@solver("midpoint")\n', "") + BROKEN, encoding="utf-8")
    done = command("check", str(path), "--json", timeout=180.0)
    findings = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 1 and all(f["remedy"] and f["why"] for f in findings)
    failed = {f["quantity"] for f in findings if f["verdict"] == "failed"}
    assert failed == {
        "it succeeds or refuses",
        "a refusal has a reason",
        "moments of its reactions are those of the exact motion",
        "errors fall with the declared order, or with rtol",
        "errors of reactions fall with the steps, or with rtol",
        "the same run gives the same numbers",
        "max_steps stops it",
        "it stops itself at the limit on CPU time",
        "steps are kept when it is stopped",
    }


BAD = {
    "import nothing_of_that_name": "nothing_of_that_name",
    "x = 1": "marks no",
    "raise SystemExit(3)": "3",
    "def f(:": "invalid syntax",
    '@solver("m")\nclass M: ...': "frozen dataclass",
    '@solver("m")\n@dataclass(frozen=True)\nclass M: ...': "paper_label",
    '@solver("m")\n@dataclass(frozen=True)\nclass M:\n paper_label = "x"\n control = "steps"': "dt or rtol",
    '@solver("m")\n@dataclass(frozen=True)\nclass M:\n paper_label = "x"\n control = "dt"': "refuses is missing",
    '@solver("m")\n@dataclass(frozen=True)\nclass M:\n a: int = 3\n paper_label = "x"\n control = "dt"\n'
    " def refuses(self): ...\n def solve(self): ...": "option",
    '@solver("ida_index1")\n@dataclass(frozen=True)\nclass M:\n paper_label = "x"\n control = "dt"\n'
    " def refuses(self): ...\n def solve(self): ...": "taken",
}


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_a_file_that_is_no_solver_is_told_in_a_line(text, tmp_path):
    """Missing parts are named before anything runs."""
    path = tmp_path / "bad.py"
    path.write_text("from dataclasses import dataclass\nfrom mbsbench import solver\n" + text)
    with pytest.raises(ValueError, match=BAD[text]) as error:
        registry.load_plugin(path)
    assert "bad.py" in str(error.value)


def test_entry_points_run_only_when_named(tmp_path, monkeypatch):
    """An installed package is not imported by the catalogue, only by its name; a file's results depend on its text."""
    monkeypatch.setattr(registry, "_plugin_files", set())
    monkeypatch.setattr(registry, "_plugin_solvers", {})
    monkeypatch.setattr(registry, "_plugin_problems", {})
    (tmp_path / "outside_package.py").write_text(CLASS, encoding="utf-8")
    meta = tmp_path / "outside-1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: outside\nVersion: 1.0\n")
    (meta / "entry_points.txt").write_text("[mbsbench.solvers]\nouter = outside_package:Midpoint\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert "midpoint" not in registry.solvers()
    with pytest.raises(ValueError, match="did you mean 'outer'"):
        registry.load_plugin("oter")
    registry.load_plugin("outer")
    assert "midpoint" in registry.solvers()
    assert plugins.list_sources("outer") == (tmp_path / "outside_package.py",)


WRONG_CALLS = {
    "midpont.py": "midpont.py: there is no such file - did you mean 'midpoint.py'?",
    "nowhere/at_all.py": "at_all.py: there is no such file\n",
    "midpoint.txt/": "midpoint.txt: there is no such file - did you mean 'midpoint.py'?",
    "midpoint": "unknown solver, problem or plugin 'midpoint' - did you mean 'midpoint.py'?",
    "gc_weak_frm": "unknown solver, problem or plugin 'gc_weak_frm' - did you mean 'gc_weak_form'?",
    "./notes.txt": "notes.txt: it is not a Python file: its name must end in .py",
}


@pytest.mark.parametrize("given", WRONG_CALLS)
def test_check_of_nothing_is_a_wrong_call(example, tmp_path, given, capsys, monkeypatch):
    """One line with the nearest name, exit code 2."""
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("no code")
    assert main(["check", given]) == 2
    said = capsys.readouterr().err
    assert WRONG_CALLS[given] in said and said.count("\n") == 1, said


def test_the_misbehaving_plugin_is_loaded_by_file():
    """Files keep working by path."""
    assert plugins.resolve_plugin(str(PLUGIN)) == str(PLUGIN)


def test_kernels_are_compiled_for_problems_of_plugins_too():
    """The problem's code does not run where kernels are compiled: two of ours stand in, with springs and without."""
    asked = RunSpec("of_a_plugin", "rattle", StepControl(dt=1e-3), {"size": 3}, {})
    assert [s.problem for s in list_runs_to_warm([asked])] == ["heavy_top", "spring_pendulum"]


@pytest.mark.beyond_core
def test_without_mujoco_a_mechanism_s_file_is_one_line(tmp_path, monkeypatch, capsys):
    """MuJoCo is an optional extra; whether it is installed here does not matter."""
    real = importlib.import_module

    def absent(name, *rest):
        if name == "mujoco":
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", absent)
    (tmp_path / "arm.urdf").write_text('<robot name="arm"><link name="base"/></robot>')
    assert main(["solve", str(tmp_path / "arm.urdf"), "gc_weak_form"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "not installed: pip install 'mbsbench[mujoco]'" in line
