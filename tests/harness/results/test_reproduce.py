"""The command to reproduce a run means the same run, to the last bit of each number."""

import json
import shlex
import subprocess
import sys

import pytest

from mbsbench.cli.arguments import parse_assignments
from mbsbench.cli.commands import CONTROL, add_commands
from mbsbench.cli.parser import make_parser
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.spec import make_spec
from mbsbench.harness.catalogue.suites.suite import load_suite, parse_suite
from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.reproduce import write_command
from mbsbench.harness.run.job import Job, make_job_record
from mbsbench.tests.factories import PLUGIN

ODD = """
[[runs]]
problem = "torque_free_body"
solver = "exact"
parameters = { omega = [1, 2.1, 0.30000000000000004], yaw = 0.7, perturb = 1e-6, seed = 3 }
dt = [0.1, 0.3333333333333333]
[[runs]]
problem = "spherical_pendulum"
solver = "ida_index1"
options = { coordinates = "euler313", lambda_in_error_test = true }
rtol = 1e-5
max_step = 0.01
max_steps = 77
cpu_limit = 7.5
"""


def run_of(line: str):
    """The run that ``solve`` would make of the line, without running it."""
    words = shlex.split(line)
    assert words[0] == "mbsbench"
    parser, commands = make_parser()
    add_commands(commands)
    given = parser.parse_args(words[1:])
    values = parse_assignments(given.set, "--set")
    control = {k: values.pop(k) for k in CONTROL if k in values}
    wall = float(control.pop("cpu_limit"))
    problem = registry.make_problem(given.problem, parse_assignments(given.problem_set, "--problem-set"))
    return make_spec(problem, given.solver, values, control, cpu_limit=wall), given


@pytest.mark.parametrize("suite", ["ci", "odd"])
def test_the_command_means_the_same_run(suite, tmp_path):
    """Run, record, line, run: the settings come back."""
    specs = parse_suite(ODD, "odd", "odd", plugins=(str(PLUGIN),)).specs if suite == "odd" else load_suite(suite).specs
    for spec in specs[:: 1 if suite == "odd" else 5]:
        record = make_job_record(Job(spec, tmp_path), Status.SUCCESS)
        again, given = run_of(write_command(record, ["my own.py"], "a b.npz"))
        assert again.settings_id == spec.settings_id and again.cpu_limit == spec.cpu_limit
        assert given.plugin == ["my own.py"] and given.out == "a b.npz"


def test_words_of_a_foreign_record_stay_words():
    """The contents of a result file are data for the shell too."""
    bad = RunRecord(
        run_id="x", problem="p; rm -rf ~", solver="$(id)", dt_s=0.1, solver_options=json.dumps({"a'b": "`id` \n&"})
    )
    words = shlex.split(write_command(bad))
    assert words[2:4] == ["p; rm -rf ~", "$(id)"] and "a'b=`id` \n&" in words and words[-1] == "x.npz"


def test_the_command_runs(tmp_path):
    record = RunRecord(run_id="abc", problem="free_fall", solver="exact", dt_s=0.5, solver_options='{"lift": 1e-14}')
    line = write_command(record, [str(PLUGIN)]).replace("mbsbench", f"{shlex.quote(sys.executable)} -m mbsbench.cli", 1)
    done = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "free_fall exact[lift=1e-14] dt=0.5" in done.stdout
