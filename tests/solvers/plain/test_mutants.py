"""The contract sees planted faults, and its messages name method, mechanism, quantity and both numbers.

``make mutants`` plants every one that the syntax tree of compiled steps has.
"""

import re
import subprocess
import sys

import pytest

from mbsbench.harness.results.environment import ROOT

from .mutants import FILES, SOLVERS, find_reason, read_reasons
from .mutating import list_mutants

STATE = "(?:position r|pose R|velocity v|velocity Omega)"
NUMBER = r"-?[\d.]+(?:e-?\d+)?"
PLACE = r"(?:after step|at node) \d"
PLANTED = {  # a change, and what its message has to name; the first one is at two lines, of a step that two solvers run
    "_kick: 0.5 -> 0.75": rf"(?:rattle|lie_variational) \{{\}}, [\w ]+: {STATE} of body \d {PLACE}",
    "_project: 1.0 -> 1.5": rf"al_index3 \{{\}}, [\w ]+: (?:force|torque) of the multipliers on body \d {PLACE}",
    "project_rates: -1.0 -> 1.0": r"kernel, [\w ]+: projected velocity of body\[\d, \d\]",
}


def plant(*words):
    """Exit code and print of the tool."""
    command = [sys.executable, "-m", "mbsbench.tests.solvers.plain.mutants", "--all", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return done.returncode, done.stdout


@pytest.mark.sampled(0)
def test_three_planted_mutants_are_named():
    """By method, mechanism, quantity, body, step, and the numbers of both methods."""
    print_out = plant("--only", "/rattle", "/alpha", "/evaluation", "--having", *PLANTED)[1]
    for change, named in PLANTED.items():
        said = re.findall(rf"{re.escape(change)}\n    killed: (.*)", print_out)
        assert said, print_out
        for one in said:
            assert re.match(rf"{named} is {NUMBER}, by the plain method {NUMBER}(; .*)?$", one), one


@pytest.mark.slow
def test_a_sample_of_all_mutants_is_killed_or_explained():
    """One of twenty, by a digest of its words."""
    code, print_out = plant("--every", "20")
    assert code == 0, print_out


@pytest.mark.sampled(0)
def test_each_explanation_is_of_a_mutant_that_there_is():
    """A reason whose line has changed is out of date."""
    mutants = {file: list_mutants(SOLVERS / file, file) for file in FILES}
    assert sum(map(len, mutants.values())) > 2000
    for one in read_reasons():
        own = [m for m in mutants[one["file"]] if find_reason(m, [one])]
        assert own and len(one["reason"].split()) > 3, one
