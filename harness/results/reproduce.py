"""The command that runs a run again: a record as a line for the shell."""

import json
import math
import shlex
from collections.abc import Sequence
from typing import Any

from ..types import StepControl
from .naming import text_of
from .records import RunRecord

REFEREED = "refereed"  # in place of a suite: the motion came from a file


def write_command(record: RunRecord, plugins: Sequence[str] = (), out: str = "") -> str:
    """``mbsbench solve ...`` with all that shapes the motion, the wall limit included, each word quoted.

    ``plugins`` are those of the run's ``environment.json``; the NPZ file is ``out``, or the run's address.
    """
    if record.suite == REFEREED:
        t_end = ["--t-end", text_of(record.t_end_s)]
        return shlex.join(["mbsbench", "referee", record.problem, "FILE", *t_end, "--name", record.solver])
    words = ["mbsbench", "solve", record.problem, record.solver]
    for plugin in plugins:
        words += ["--plugin", plugin]
    for name, value in json.loads(record.problem_parameters).items():
        words += ["--problem-set", f"{name}={text_of(value)}"]
    for name, value in {**json.loads(record.solver_options), **control_of(record)}.items():
        words += ["--set", f"{name}={text_of(value)}"]
    words += ["--out", out or f"{record.run_id or record.problem}.npz"]
    return shlex.join(words)


def control_of(record: RunRecord) -> dict[str, Any]:
    """Step, tolerance and limits that ``solve`` takes by ``--set``; those that do not exist are left out."""
    r = record
    max_steps = math.nan if r.max_steps in (0, StepControl.max_steps) else r.max_steps
    given = {
        "dt": r.dt_s,
        "rtol": r.rtol,
        "max_step": r.max_step_s,
        "max_steps": max_steps,
        "cpu_limit": r.cpu_limit_s if r.cpu_limit_s == r.cpu_limit_s else r.wall_limit_s,
    }
    return {k: v for k, v in given.items() if not math.isnan(v)}
