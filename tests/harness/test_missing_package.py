"""Without scikit-sundae, which has no wheel for Linux on arm64, its solvers refuse in a line and all others run."""

import json
import os
import subprocess
import sys

import pytest

from mbsbench.cli.__main__ import main

NEED_IT = {"ida_index1", "ida_index2", "ida_index3", "cvode"}
HIDE = 'import sys\nsys.modules["sksundae"] = None  # find_spec finds nothing, and an import fails\n'
RUN = """
import json
import sys
from mbsbench.harness.catalogue import registry
from mbsbench.harness.run import contract
from mbsbench.harness.run import origin
from mbsbench.harness.mechanics.types import NotInstalled, StepControl

problem, found = registry.make_problem("heavy_top", {"t_end": 0.004}), {}
for name, entry in registry.solvers().items():
    solver = entry.make_solver()
    control = StepControl(**({"dt": 0.002} if entry.control == "dt" else {"rtol": 1e-5}))
    reason = contract.find_refusal(solver, problem, control)
    package = reason.package if isinstance(reason, NotInstalled) else ""
    runs = not reason and name in (sys.argv[1:] or [name])
    status = "refused" if reason else str(solver.solve(problem, control).status) if runs else "not run"
    found[name] = {"status": status, "reason": reason, "package": package}
print(json.dumps([found, len(origin.describe_environment("f", "s", 1, ())["blas"])]))
"""
SUITE = """
name = "two"
[[runs]]
problem = "heavy_top"
parameters = { t_end = 0.02 }
solver = "ida_index1"
rtol = 1e-5
[[runs]]
problem = "heavy_top"
parameters = { t_end = 0.02 }
solver = "rattle"
dt = 0.01
"""


@pytest.fixture
def call(tmp_path):
    """Python with arguments in an empty folder, without the package."""
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / "sitecustomize.py").write_text(HIDE, encoding="utf-8")

    def run(*arguments):
        env = {**os.environ, "PYTHONPATH": str(tmp_path / "hidden")}
        env["COLUMNS"] = "160"  # a table leaves its reasons out where it is narrow
        line = (sys.executable, *arguments)
        return subprocess.run(line, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300.0, check=False)

    return run


SOME = ("scipy_strong_form", "ndf_index1", "radau_index1")  # of other libraries; then compiled here


@pytest.mark.beyond_core
@pytest.mark.parametrize(
    "names", [SOME, pytest.param((), marks=pytest.mark.slow)], ids=["of other libraries", "every solver"]
)
def test_every_solver_runs_or_refuses_in_one_line(call, names):
    """Nothing imports the package before it is used; what other packages lack here is refused as well."""
    done = call("-c", RUN, *names)
    assert done.returncode == 0, done.stderr
    found, libraries = json.loads(done.stdout)
    assert {name for name, x in found.items() if x["package"] == "scikit-sundae"} == NEED_IT
    for name, x in found.items():
        assert x["status"] in ("success", "refused", *(["not run"] if names else [])), (name, x)
        assert "\n" not in x["reason"], (name, x)
    assert "SUNDIALS" in found["cvode"]["reason"] and "pip install" in found["cvode"]["reason"]
    own = {name for name in found if not found[name]["package"]} - {"gc_extrapolated"}
    assert {"scipy_strong_form", "ndf_index1", "radau_index1", "rk45_strong_form", "rattle"} <= own
    assert all(found[name]["status"] == "success" for name in SOME)
    assert libraries >= 2  # of NumPy and SciPy


@pytest.mark.sampled(0)
def test_the_gate_is_open_for_the_others_only_where_the_package_was_named(call, tmp_path, monkeypatch, capsys):
    """Exit code 1 without the option, or with another name; 0 with it, and the words say for how many."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.toml").write_text(SUITE, encoding="utf-8")
    gate = ("gate", "--suite", "two.toml", "--thresholds", "bounds.toml")
    assert main([*gate, "--update", "--write"]) == 0
    python = ("-m", "mbsbench.cli")
    done = call(*python, *gate, "--out", "lacking")
    assert done.returncode == 1 and "CLOSED: 1 FAIL" in done.stdout and "--without" in done.stdout, done.stdout
    gate = (*gate, "--results", "lacking")
    assert main([*gate, "--without", "another"]) == 1
    done = call(*python, *gate, "--without", "scikit-sundae", "--junit", "gate.xml", "--markdown", "gate.md")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "gate open for 1 of 2; 1 not measured here: scikit-sundae" in done.stdout
    assert "open for 1 of 2" in (tmp_path / "gate.md").read_text()
    assert '<skipped message="not measured here: scikit-sundae is not installed' in (tmp_path / "gate.xml").read_text()
    capsys.readouterr()
    assert main([*gate, "--without", "scikit-sundae", "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["open"] and plain["cases"] == 2 and list(plain["not_measured"].values()) == ["scikit-sundae"]


@pytest.mark.sampled(0)
def test_commands_show_the_refusal(call):
    """``solve`` and ``advise`` say in a line how to get it; ``list`` shows every solver."""
    done = call("-m", "mbsbench.cli", "solve", "heavy_top", "ida_index3", "--problem-set", "t_end=0.01")
    assert done.returncode == 1 and "refused: scikit-sundae is not installed" in done.stdout, done.stdout + done.stderr
    line = ("advise", "heavy_top", "--t-end", "0.05", "--error", "1e-3", "--solver", "rattle", "--solver", "ida_index1")
    done = call("-m", "mbsbench.cli", *line)
    assert done.returncode == 0 and "scikit-sundae is not installed" in done.stdout, done.stdout + done.stderr
    assert "ida_index2" in call("-m", "mbsbench.cli", "list").stdout
