"""Solve one problem with one solver from the shell and write an NPZ file (``solve``)."""

import argparse
import itertools
import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..harness.base.text import escape_text
from ..harness.catalogue import registry
from ..harness.catalogue.suites.shape import LONGEST
from ..harness.catalogue.suites.spec import RunSpec, check_step, make_spec
from ..harness.catalogue.trial import make_problem
from ..harness.mechanics.types import Problem, Status
from ..harness.results.records import RunRecord
from ..harness.results.words import (
    describe_ending,
    describe_errors,
    describe_status,
    format_accurate_times,
    list_reasons,
)
from .arguments import UsageError, check_writable, load_problem, parse_assignments, parse_positive_float
from .commands import CONTROL
from .terminal import make_console, make_error_console


def run(arguments: argparse.Namespace) -> int:
    """Check the call, run the solver, write the motion to a file and print its measurements.

    Return 0 if the motion reaches its end and keeps all laws, else 1. If the folder cannot be written and --out is not
    given, UsageError is raised only after the run, whose measurements are printed.
    """
    name, parameters, _ = load_problem(arguments)
    given = parse_assignments(arguments.set, "--set")
    control = {k: given.pop(k) for k in CONTROL if k in given}
    if arguments.solver not in registry.solvers():  # before the problem is made, which can take a while
        registry.make_solver(arguments.solver)
    problem = make_problem(name, parameters)
    limit = control.pop("cpu_limit", None)
    spec = make_spec(problem, arguments.solver, given, control)
    check_step(spec.control.dt if "dt" in control else None, problem.t_end)
    wall = None if limit is None else parse_positive_float(limit, "cpu_limit")
    if wall is not None and wall > LONGEST:
        raise UsageError(f"cpu_limit must be at most {LONGEST:g} s (got {limit})")
    if arguments.out is not None and not arguments.out.endswith(".npz"):
        raise UsageError(f"--out must end in .npz, the one format that is written (got {arguments.out!r})")
    with tempfile.TemporaryDirectory() as aside:
        unwritable = ""
        try:
            out = check_writable(arguments.out or str(find_unused_path(f"{name}-{arguments.solver}")))
        except UsageError as error:
            if arguments.out is not None:
                raise
            out, unwritable = Path(aside) / "run.npz", f"{error}; give --out RUN.npz to keep the motion"
        code = _solve_problem(arguments, spec, wall, problem, out, is_kept=not unwritable)
    if unwritable:
        raise UsageError(unwritable)
    return code


def find_unused_path(stem: str) -> Path:
    """Return the first of STEM.npz, STEM-2.npz, ... that does not exist, since only --out overwrites a file."""
    names = itertools.chain([f"{stem}.npz"], (f"{stem}-{k}.npz" for k in itertools.count(2)))
    return next(Path(name) for name in names if not os.path.lexists(name))


def _solve_problem(
    arguments: argparse.Namespace, spec: RunSpec, wall: float | None, problem: Problem, out: Path, *, is_kept: bool
) -> int:
    """Run the solver, write the motion to ``out`` and print its measurements; return 0 if it keeps all laws, else 1.

    ``wall`` is the time limit [s], None for none; ``is_kept`` is False if ``out`` is a temporary file, which no message
    names. With --shadow the true motion nearest to it is found and printed, too.
    """
    from ..harness.run import solve_file
    from ..harness.run.progress_line import ProgressLine

    output, messages, replaced, progress = make_console(), make_error_console(), out.exists(), ProgressLine()

    def report(words: str, end: str) -> None:
        """Print a message of the run, unless with --json; one whose ``end`` is no newline is replaced by the next."""
        if arguments.json:
            return
        if end == "\n":
            progress.erase()
            messages.print(words)
        else:
            progress.show(words)

    try:
        with progress:
            record, native = solve_file.solve_to_file(spec, out, wall, report, problem)
    except (KeyboardInterrupt, SystemExit):
        messages.print(f"interrupted; nothing was written{f' to {out}' * is_kept}")
        raise
    good = Status(record.status).lawful
    find_nearest = getattr(arguments, "shadow", None)  # what the lab adds, if this copy has it
    nearest = _replace_nonfinite(find_nearest(problem, out)) if find_nearest else None
    if arguments.json:
        more: dict[str, Any] = {} if nearest is None else {"nearest": nearest}
        plain = {**make_json_numbers(record), **more, "out": str(out) if is_kept else None}
        output.print(json.dumps(plain, ensure_ascii=False, allow_nan=False))
        return 0 if good else 1
    for line in summarize_record(record):
        output.print(line)
    if native and not good:
        output.print(f"standard error     {find_last_message(native)}")
    if nearest:
        output.print(f"true motion        {nearest['words']}")
    elif record.status == Status.INACCURATE and is_kept and hasattr(arguments, "shadow"):
        output.print(f"true motion        mbsbench shadow {out} finds its distance")
    if is_kept:
        output.print(f"written to         {out}{' (the file of that name is replaced)' * replaced}")
    return 0 if good else 1


def find_last_message(native: str) -> str:
    """Return the last line of standard error that is not indented: a warning's message, not the code below it."""
    lines = native.splitlines()
    return next((line for line in reversed(lines) if line and not line[0].isspace()), lines[-1])


def make_json_numbers(r: RunRecord) -> dict[str, Any]:
    """Return the summary of a record as a dict for JSON, with all columns of the record under ``record``.

    A missing number is None, an infinite one the text ``inf`` or ``-inf``.
    """
    from ..harness.results.records import format_record
    from ..harness.run.run_file import SUMMARY

    numbers = {"case": r.case, **{name: getattr(r, name) for name in SUMMARY}, "cpu_s": r.cpu_min_s}
    unpacked = {"counters": dict(r.counts), "notes": list(r.note_lines)}
    return {
        **_replace_nonfinite({k: x for k, x in numbers.items() if k not in unpacked}),
        **unpacked,
        "reasons": [_replace_nonfinite(vars(reason)) for reason in r.reasons],
        "record": _replace_nonfinite(json.loads(format_record(r))),
    }


def _replace_nonfinite(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers as JSON can hold them: None for NaN, the texts ``inf`` and ``-inf`` for infinities."""
    return {k: None if str(v) == "nan" else str(v) if v in (math.inf, -math.inf) else v for k, v in numbers.items()}


def summarize_record(r: RunRecord) -> list[str]:
    """Return the lines that summarise a record on one screen: status and reasons, drift, errors, CPU time, notes."""
    said = "; ".join(w for w in dict.fromkeys([describe_ending(r), *list_reasons(r)]) if w)
    out = [r.case, f"{'status':<18} {describe_status(r)}" + (f": {said}" if said else "")]
    if not math.isnan(r.t_reached_s):
        out.append(f"t reached          {r.t_reached_s:.9g} s of {r.t_end_s:g} s in {r.steps} steps")
    if not math.isnan(r.energy_drift_max_J):  # a file may hold positions only
        out.append(f"energy drift       {r.energy_drift_max_J:.3e} J (scale {r.energy_scale_J:.3g} J)")
    if not math.isnan(r.phi_max):
        out.append(f"|phi|, |phi_dot|   {r.phi_max:.3e} m, {r.phi_dot_max:.3e} m/s")
    if error := describe_errors(r):
        out.append(f"error              {error}")
        out.append(f"accurate until     {', '.join(format_accurate_times(r))} of the reach of {r.length_scale_m:.3g} m")
    if r.cpu_min_s > 0.0 or (r.steps and not math.isnan(r.cpu_min_s)):
        set_up = "" if math.isnan(r.setup_s) else f" (set-up {r.setup_s:.3g} s)"
        out.append(f"CPU time           {r.cpu_min_s:.3g} s{set_up}")
    return out + [f"note               {escape_text(n)}" for n in r.note_lines]
