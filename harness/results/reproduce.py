"""Write the command that repeats a run, from its record."""

import math
import shlex
from collections.abc import Sequence
from typing import Any

from ..base.naming import format_exactly
from ..mechanics.types import StepControl
from .records import RunRecord

REFEREED = "refereed"  # suite of runs whose motion came from a file


def write_command(record: RunRecord, plugins: Sequence[str] = (), out: str = "") -> str:
    """Return the shell command ``mbsbench solve ...`` with everything that shapes the motion, and the limit on time.

    ``plugins`` are those in the run's ``environment.json``; ``out`` is the NPZ file, by default named after the run_id.
    For a motion that came from a file the command is ``mbsbench referee ...``.
    """
    if record.suite == REFEREED:
        t_end = ["--t-end", format_exactly(record.t_end_s)]
        return shlex.join(["mbsbench", "referee", record.problem, "FILE", *t_end, "--name", record.solver])
    words = ["mbsbench", "solve", record.problem, record.solver]
    for plugin in plugins:
        words += ["--plugin", plugin]
    for name, value in record.parameters.items():
        words += ["--problem-set", f"{name}={format_exactly(value)}"]
    for name, value in {**record.options, **list_control(record)}.items():
        words += ["--set", f"{name}={format_exactly(value)}"]
    words += ["--out", out or f"{record.run_id or record.problem}.npz"]
    return shlex.join(words)


def list_control(record: RunRecord) -> dict[str, Any]:
    """Return the step or tolerance and the limits of a run, by the names under which ``solve --set`` takes them.

    Those that the run does not have, and a default ``max_steps``, are left out. Older records have no limit on CPU
    time: their limit on wall time is taken for it.
    """
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
