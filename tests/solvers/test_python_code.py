"""With MBSBENCH_PYTHON=1 steps are the Python that they are written in: the same motion, and tracebacks into steps."""

import os
import re
import subprocess
import sys

import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.types import StepControl
from mbsbench.harness.results.environment import ROOT
from mbsbench.solvers.formulations.compiled.entries import PYTHON
from mbsbench.tests.comparing import assert_close

SOLVERS = {  # with options, and the function of each in which an exception is planted
    "gc_weak_form": "methods.gc_step.move_poses",
    "gc_weak_form newton=exact": "methods.gc_newton._sweep",
    "rattle": "methods.rattle._drift",
    "energy_momentum": "methods.energy_momentum._set_end",
    "gauss_joint": "compiled.algebra.copy",
}
STEP, STEPS = 1e-3, 4
SCRIPT = f"""
import sys
from importlib import import_module
import mbsbench
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.types import StepControl

def fail(*given):
    raise KeyError("planted")

def solve():
    problem, (name, *options) = make_problem("heavy_top", {{"t_end": {STEPS * STEP}}}), sys.argv[1].split()
    return make_solver(name, dict(x.split("=") for x in options)).solve(problem, StepControl(dt={STEP}))

print(*solve().states.r[-1, 0].tolist())
module, name = sys.argv[2].rsplit(".", 1)
getattr(import_module(f"mbsbench.solvers.formulations.{{module}}"), name).function = fail
solve()
"""


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("solver", "place"), SOLVERS.items())
def test_steps_in_python_are_those_of_machine_code_and_can_be_traced(solver, place):
    """Sums and products are not contracted: roundings of 0.1 m. A traceback goes through march and step."""
    call = [sys.executable, "-c", SCRIPT, solver, place]
    done = subprocess.run(call, cwd=ROOT, env=os.environ | {PYTHON: "1"}, capture_output=True, text=True, check=False)
    name, *options = solver.split()
    made = make_solver(name, dict(option.split("=") for option in options))
    compiled = made.solve(make_problem("heavy_top", {"t_end": STEPS * STEP}), StepControl(dt=STEP))
    assert_close([float(x) for x in done.stdout.split()], compiled.states.r[-1, 0], atol=1e-13)
    assert done.returncode == 1 and "KeyError: 'planted'" in done.stderr, done.stderr
    for frame in ("march", r"\w*step", "fail"):
        assert re.search(rf"in {frame}\n", done.stderr), done.stderr
