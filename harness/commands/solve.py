"""``solve``: one run from the shell, as an NPZ file."""

import argparse
import json
from pathlib import Path
from typing import Any

from ..catalogue import registry
from ..sandbox.trial import made
from ..suites.spec import make_spec
from ..suites.suite import MOST
from ..types import Status
from .screen import errors, lines
from .terms import UsageError, assignments, check_writable, load_plugins

CONTROL = ("dt", "rtol", "max_step", "max_steps", "wall_limit")


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("solve", help="run one solver on one problem and write an NPZ file")
    p.add_argument("problem")
    p.add_argument("solver")
    p.add_argument(
        "--set", action="append", default=[], metavar="K=V", help=f"{', '.join(CONTROL)}, or a solver option"
    )
    p.add_argument("--problem-set", action="append", default=[], metavar="K=V", help="a problem parameter")
    p.add_argument("--t-end", metavar="T", help="simulated time [s]")
    p.add_argument("--out", required=True, metavar="RUN.npz", help="file to write")
    p.add_argument(
        "--plugin", action="append", default=[], metavar="FILE.py", help="file with more problems or solvers"
    )
    p.add_argument("--json", action="store_true", help="one JSON object instead of lines, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Check everything, run, write; 0 only for a success that nothing contradicts."""
    load_plugins(arguments.plugin)
    parameters = assignments(arguments.problem_set, "--problem-set")
    if arguments.t_end is not None:
        if "t_end" in parameters:
            raise UsageError("t_end is given twice, by --t-end and --problem-set")
        parameters["t_end"] = _above_zero(arguments.t_end)
    given = assignments(arguments.set, "--set")
    control = {k: given.pop(k) for k in CONTROL if k in given}
    if arguments.solver not in registry.solvers():  # before the problem is made: that can take a while
        registry.make_solver(arguments.solver)
    problem = made(arguments.problem, parameters)
    limit = control.pop("wall_limit", None)
    spec = make_spec(problem, arguments.solver, given, control)
    if spec.control.max_steps > MOST["max_steps"]:
        raise UsageError(f"max_steps must be at most {MOST['max_steps']} (got {control['max_steps'][:40]})")
    wall = None if limit is None else float(_above_zero(limit, "wall_limit"))
    if wall is not None and wall > MOST["wall_limit"]:
        raise UsageError(f"wall_limit must be at most {MOST['wall_limit']:g} s (got {limit})")
    out = Path(arguments.out)
    if out.suffix != ".npz":
        raise UsageError(f"--out must end in .npz, the one format that is written (got {arguments.out!r})")
    check_writable(out)
    from ..execution.single import solve_to_file

    console = lines()
    said = (lambda words: None) if arguments.json else console.print
    try:
        outcome = solve_to_file(spec, out, wall, said)
    except (KeyboardInterrupt, SystemExit):
        errors().print(f"interrupted; nothing was written to {out}")
        raise
    if arguments.json:
        plain = {"case": spec.case, "status": str(outcome.status), "message": outcome.message, "out": str(out)}
        console.print(json.dumps({**plain, "lines": outcome.lines}, ensure_ascii=False))
        return 0 if outcome.status is Status.SUCCESS else 1
    console.print(f"{spec.case}")
    console.print(f"{'status':<18} {outcome.status}" + (f": {outcome.message}" if outcome.message else ""))
    for line in outcome.lines:
        console.print(line)
    if outcome.native and outcome.status is not Status.SUCCESS:
        console.print(f"standard error     {outcome.native.splitlines()[-1]}")
    console.print(f"written to         {out}")
    return 0 if outcome.status is Status.SUCCESS else 1


def _above_zero(text: str, name: str = "t_end") -> str:
    try:
        good = 0.0 < float(text) < float("inf")
    except ValueError:
        good = False
    if not good:
        raise UsageError(f"{name} must be a finite number > 0 [s] (got {text!r})")
    return text
