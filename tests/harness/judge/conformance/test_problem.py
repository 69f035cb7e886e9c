"""Problem requirements: the worked example meets them, each fault is named with its number."""

import json

import numpy as np
import pytest

from mbsbench import constraint_jacobian, make_problem
from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import registry
from mbsbench.harness.judge.conformance import problem as requirements
from mbsbench.harness.judge.conformance.laws import find_redundant_joints
from mbsbench.harness.reference import computation
from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.factories import PLUGIN

WHOLE = (ROOT / "docs" / "examples" / "gyroscope.py").read_text(encoding="utf-8")
EXAMPLE = WHOLE.replace("t_end=2.0", "t_end=0.2")  # a tenth of the time, in which the independent motion is found soon

FAULTS = {  # what is changed in the example (from, to), and the requirements that must fail
    "turned sign in the start": ("np.cross(omega, r)[None]", "-np.cross(omega, r)[None]", "its start is consistent"),
    "precession too fast": (
        "Precession(begin, rate, spin)",
        "Precession(begin, 1.01 * rate, spin)",
        "its reference begins at the start",
        "its reference obeys Newton and Euler",
    ),
    "spin without its equation": ("(AXIAL * rate)\n", "(AXIAL * rate) + 1.0\n", "its reference obeys Newton and Euler"),
    "velocities of something else": (
        "np.cross(self.rate * E_3, r)[:, None]",
        "0.0 * r[:, None]",
        "its reference begins at the start",
        "velocities of its reference are those of its poses",
        "its reference obeys Newton and Euler",
    ),
    "a joint that opens": (
        "r = turn @ self.start.r[0]",
        "r = turn @ self.start.r[0] * (1.0 + 1e-3 * t[:, None])",
        "its reference keeps the joints closed",
        "its reference keeps the energy",
    ),
    "an invariant that is none": (
        "s.Omega[:, 0, 2]",
        "s.Omega[:, 0, 0]",
        "its invariants are constant along the motion",
    ),
    "an observable without time": (
        "s.r[:, 0, 2]",
        "s.r[0, 0, 2]",
        "observables and invariants are numbers over time",
    ),
    "no words": (
        '"""Model a disc on a spherical joint in steady precession."""',
        "pass",
        "it can be made and is documented",
    ),
    "another start each time": (
        "math.radians(theta)",
        "math.radians(theta + np.random.rand())",
        "making it twice gives the same problem",
    ),
    "an error that is none": ("return 1e-15 * (1.0", "return -1e-15 * (1.0", "its reference states its error"),
    "a crash in the reference": (
        "turn = so3.exp(self.rate",
        "import os; os._exit(3)\n        turn = so3.exp(self.rate",
        "its reference begins at the start",
    ),
}


def checked(tmp_path, text):
    """The findings on the example, written as ``text``."""
    path = tmp_path / "gyroscope.py"
    path.write_text(text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("_plugin_files", "_plugin_problems", "_plugin_solvers"):
            patch.setattr(registry, name, type(getattr(registry, name))())
        patch.setattr(computation, "BUDGET", 3.0)  # of the independent reference, which one test below computes in full
        registry.load_plugin(path)
        return requirements.check_problem("gyroscope", (str(path),))


@pytest.mark.sampled(0)
@pytest.mark.parametrize("text", [EXAMPLE, pytest.param(WHOLE, marks=pytest.mark.slow)], ids=["shorter", "as printed"])
def test_the_worked_example_meets_the_requirements(text, tmp_path, command):
    """The example of docs/your-own-problem.md is a whole problem; the page's commands say so."""
    assert WHOLE != EXAMPLE
    (tmp_path / "gyroscope.py").write_text(text, encoding="utf-8")
    done = command("check", "gyroscope.py", timeout=300.0)  # computes a reference
    assert done.returncode == 0, done.stdout + done.stderr
    assert "15 of 15 requirements met" in done.stdout and "no reference" not in done.stdout
    step = ("--set", "dt=0.001", "--t-end", "0.1", "--out", "gyroscope.npz")
    done = command("solve", "gyroscope", "gc_weak_form", "--plugin", "gyroscope.py", *step, timeout=300.0)
    assert done.returncode == 0 and "error" in done.stdout, done.stdout + done.stderr


@pytest.mark.sampled(2)
@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(tmp_path, fault):
    """And nothing is called broken that is not."""
    old, new, *names = FAULTS[fault]
    expected = set(names)
    assert EXAMPLE.count(old) >= 1
    found = checked(tmp_path, EXAMPLE.replace(old, new))
    broken = [f for f in found if not f.holds]
    failed = {f.quantity for f in broken}
    assert expected <= failed and len(found) == len(requirements.REQUIREMENTS)
    assert all(f.words and "\n" not in f.words for f in broken)
    if "crash" in fault:
        assert any("exited with code 3" in f.words for f in found)
    if fault == "turned sign in the start":  # the joint and its gap once, in the problem's words
        assert [f.quantity for f in broken] == names and "most at joint 'O'" in broken[0].words
    if len(expected) == 1 and fault in ("an invariant that is none", "an observable without time", "no words"):
        assert failed == expected


def test_without_a_reference_its_requirements_are_not_tested(tmp_path):
    """They are neither met nor broken, and the reason is given."""
    found = checked(tmp_path, EXAMPLE.replace("reference_from=exact,", ""))
    silent = [f for f in found if not f.is_tested and f.words == "no reference"]
    assert all(f.holds for f in found) and len(silent) == sum(c.needs_reference for c in requirements.REQUIREMENTS)


def test_json_has_the_numbers(capsys):
    """One object a requirement; the problem of a plugin with solvers is checked before them."""
    assert main(["check", "torque_free_body", "--json"]) == 0
    findings = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(findings) == 15 and all(f["verdict"] != "failed" for f in findings) and PLUGIN.exists()
    assert all(isinstance(f["value"], int | float) and isinstance(f["unit"], str) for f in findings)


@pytest.mark.parametrize("name", ["bricard", "andrews"])
def test_joints_that_are_not_named_have_independent_rows(name):
    """Redundancy goes where the named joints lose rows; nothing else need change."""
    made = make_problem(name)
    named = find_redundant_joints(made.system, made.initial)
    start = made.system.row_start
    rows = [k for j in range(made.system.nj) if j not in named for k in range(start[j], start[j + 1])]
    A = constraint_jacobian(made.system, made.initial).toarray()
    assert named and np.linalg.matrix_rank(A[rows]) == len(rows) and np.linalg.matrix_rank(A) < len(A)
