"""Compiled functions of bundles: what they raise, what they are given, what a kept mechanism is named by."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from mbsbench.harness.base.generated import code
from mbsbench.solvers.formulations.compiled import algebra, entries
from mbsbench.solvers.formulations.compiled.entries import BoundFunction


class Pair(NamedTuple):
    """One number in, one out."""

    x: Any
    y: Any


def take_root(p: Any) -> None:
    """y = sqrt(x), not of a negative number."""
    if p.x[0] < 0.0:
        raise ValueError("negative")
    p.y[0] = np.sqrt(p.x[0])


def test_what_compiled_code_raises_reaches_its_caller():
    """Else it would go on with what was there before."""
    pair = Pair(np.array([4.0]), np.zeros(1))
    bound = BoundFunction(take_root, pair)
    bound()
    assert pair.y[0] == 2.0
    pair.x[0] = -1.0
    with pytest.raises(ArithmeticError, match="take_root"):
        bound()
    pair.x[0] = 9.0
    bound()
    assert pair.y[0] == 3.0


def print_number(p: Any) -> None:
    """Print x, which compiled code cannot."""
    print(p.x[0])  # noqa: T201  it is what is tried


def print_text(p: Any) -> None:
    """Print a text of the code itself."""
    print("here")  # noqa: T201  it is what is tried
    p.y[0] = p.x[0]


def test_compiled_code_prints_no_number(monkeypatch, tmp_path, capsys):
    """As docs/debugging.md says; a text appears in the process that compiles it, whose code is kept apart here."""
    monkeypatch.setattr(code, "FOLDER", tmp_path)
    pair = Pair(np.array([4.0]), np.zeros(1))
    with pytest.raises(ArithmeticError, match="print_number"):
        BoundFunction(print_number, pair)()
    BoundFunction(print_text, pair)()
    assert capsys.readouterr().out == "here\n" and pair.y[0] == 4.0


SOLVE = """
import sys, mbsbench
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench import StepControl
found = make_solver(sys.argv[1]).solve(make_problem("spherical_pendulum", {"t_end": 0.5}), StepControl(dt=0.02))
print(found.states.r.tobytes().hex(), found.states.R.tobytes().hex())
"""


def solve_with(cache: Path, solver: str) -> bytes:
    """The bits of a motion, by a process of its own that keeps code in ``cache``."""
    given = {**os.environ, "MBSBENCH_CACHE": str(cache)}
    command = [sys.executable, "-c", SOLVE, solver]
    return subprocess.run(command, env=given, capture_output=True, check=True).stdout


@pytest.mark.slow
def test_rounding_does_not_depend_on_what_is_compiled_first(tmp_path):
    """numba compiles what is called once, and would hand it the flags of its first caller: here, or not, the factor."""
    alone = solve_with(tmp_path / "alone", "gc_weak_form")
    solve_with(tmp_path / "after", "rattle")  # which leaves the factor
    assert solve_with(tmp_path / "after", "gc_weak_form") == alone


def test_every_function_says_how_it_rounds():
    """What says nothing takes over what its first caller has."""
    of_kernels = [f for f in entries.OPTIONS_OF if f.__module__ == algebra.__name__]
    assert len(of_kernels) > 5 and all("'fastmath'" in options for options in entries.OPTIONS_OF.values())


LARGEST = """
import numba, numpy as np
from mbsbench.solvers.formulations.compiled.algebra import find_largest, take_larger
nan = float("nan")
sizes = ([1.0, -4.0, 2.0], [nan, -4.0, 2.0], [1.0, nan, 2.0], [1.0, -4.0, nan])
print([float(find_largest(np.array(a))) for a in sizes])
compiled = numba.njit(take_larger.function)
for larger in (take_larger, compiled):
    print([larger(x, y) for x, y in ((1.0, 2.0), (2.0, 1.0), (nan, 1.0), (1.0, nan))])
"""


def test_the_larger_of_sizes_is_nan_if_one_is():
    """Wherever it stands, in machine code too: a step whose size it is must not be taken for a small one.

    In a process of its own, in which nothing has been compiled: what compiled code calls is then not for Python.
    """
    done = subprocess.run([sys.executable, "-c", LARGEST], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[4.0, nan, nan, nan]", *2 * ["[2.0, 2.0, nan, nan]"]]
