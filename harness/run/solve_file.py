"""Execute one run from the shell in separate processes, as a suite does, and write one NPZ file even if it crashes."""

import dataclasses
import math
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..base.files import name_partial
from ..base.isolation import OUTPUT_LIMIT
from ..base.naming import format_name
from ..catalogue.suites.spec import RunSpec
from ..mechanics.types import Problem
from ..results.records import RunRecord
from .costs import LAWS, WarmCaches, name_reference, predict_times
from .job import Job
from .measuring import Outcome
from .remaining_time import COMPILING, PREPARING, describe_motion, describe_wait
from .run import MEASURE_LIMIT, MEASURING, NO_LIMIT, RunProcess, Send, run_and_store
from .run_file import write_run, write_without_motion
from .spool import NUMBERS
from .supervisor import read_outcome
from .warmup import fill_caches, list_runs_to_warm, warm_up

RUNNING = "running"
PATIENCE = 3.0  # [s] that a stage lasts before it is reported: loading code from a cache takes up to 2 s
EVERY = 1.0  # [s] between two reports, and before the first of a run in progress, which only a terminal shows

Say = Callable[[str, str], None]  # text and the end of its line; text before a carriage return is overwritten


def solve_to_file(
    spec: RunSpec, out: Path, cpu_limit: float | None, say: Say | None = None, problem: Problem | None = None
) -> tuple[RunRecord, str]:
    """Run ``spec``, write the NPZ file ``out``, and return the record and the last 2000 characters of standard error.

    A run that crashes or is killed leaves a file with the steps it had kept; an interrupt ends the run and leaves
    ``out`` as it was, complete or absent. ``cpu_limit`` [s] is the limit of the run, None for no limit; with a limit,
    code is compiled and the reference computed before the run begins. ``say`` receives reports of stages that take
    long. ``problem`` is that of ``spec``, if it exists already; its reference and observables are evaluated in other
    processes only.
    """
    with tempfile.TemporaryDirectory() as place:
        limit = math.inf if cpu_limit is None else cpu_limit
        job = Job(dataclasses.replace(spec, cpu_limit=limit), Path(place))
        job.stderr.parent.make_folder()
        patience = _WaitReport(say, lambda: predict_times([spec], 1).once, lambda: _describe_progress(job, problem))
        if cpu_limit is not None:  # the limit applies to the run: compute the reference and compile before it starts
            patience.begin_task(PREPARING)
            fill_caches(list_runs_to_warm([spec]), [job], patience.report_wait)
        measure_limit = NO_LIMIT if cpu_limit is None else MEASURE_LIMIT

        def work(send: Send) -> None:
            """Solve and measure in the process of the run, write its file, and send the record."""
            if cpu_limit is None:
                warm_up(list_runs_to_warm([spec], problem), problem)
            send(RUNNING)
            run_and_store(job, send, keep, problem, soft=1.0, measure_limit=measure_limit)

        def keep(outcome: Outcome) -> RunRecord:
            """Write the file of the run, and return its record, which refers to no file of standard error."""
            return write_run(out, dataclasses.replace(outcome, record=dataclasses.replace(outcome.record, stderr="")))

        def finish(process: RunProcess) -> tuple[RunRecord, bool]:
            """Wait for the end of a process; return the record of the run, and whether the process wrote the file.

            The partial file of a process that was interrupted while writing is removed.
            """
            try:
                return read_outcome(
                    process, process.wait_for_end(lambda: patience.begin_task(_name_stage(process.read_lines())))
                )
            finally:
                name_partial(out, process.pid).unlink(missing_ok=True)

        patience.begin_task(COMPILING)
        process = RunProcess(job, work, measure_limit)
        record, stored = finish(process)
        if not stored and (salvage := process.measure_partial(record, keep, problem)) is not None:
            record, stored = finish(salvage)
        native = job.stderr.read(OUTPUT_LIMIT).decode(errors="replace") if job.stderr.is_there() else ""
        if stored:
            WarmCaches().add([LAWS, spec.solver, name_reference(format_name(spec.problem, spec.parameters))])
        else:
            record = write_without_motion(out, dataclasses.replace(record, stderr=""))
        return record, native[-2000:].strip()


def _name_stage(heard: str) -> str:
    """Return the stage of a run from the text ``heard`` from its process so far: compiling, running or measuring."""
    return next((stage for stage in (MEASURING, RUNNING) if f"\n{stage}" in f"\n{heard}"), COMPILING)


def _describe_progress(job: Job, problem: Problem | None) -> str:
    """Describe how far the run in progress has simulated, by the last step in its spool file; empty if unknown."""
    if problem is None:
        return ""
    row = 8 * (1 + NUMBERS * problem.system.nb)  # [bytes] of a step, which begins with its time
    try:
        with job.spool.open_file() as file:
            whole = os.fstat(file.fileno()).st_size // row
            file.seek(max(whole - 1, 0) * row)
            time_s = np.frombuffer(file.read(8))
    except OSError:  # no step yet, or the run has just ended
        return ""
    return describe_motion(problem.name, float(time_s[0]), problem.t_end) if len(time_s) else ""


class _WaitReport:
    """A reporter of stages that take long: once on a line with the time left, then every second on a line overwritten.

    ``usual()`` estimates the time [s] of compiling and computing references. A run in progress is only reported on the
    overwritten line, by ``reached()``, which describes its simulated time.
    """

    def __init__(self, say: Say | None, usual: Callable[[], float], reached: Callable[[], str]) -> None:
        self.say, self.usual, self.reached, self.doing = say, usual, reached, ""

    def begin_task(self, doing: str) -> bool:
        """Set the present stage, from which a new one begins, and report it if it takes long.

        Return False, so that the wait continues.
        """
        if doing != self.doing:
            self.doing, self.began = doing, time.monotonic()
            self.due = EVERY if doing == RUNNING else PATIENCE
        return self.report_wait()

    def report_wait(self) -> bool:
        """Report the present stage if the next report is due; return False, so that the wait continues."""
        elapsed = time.monotonic() - self.began
        if elapsed > self.due:
            if self.say is not None and self.doing == RUNNING:
                self.say(self.reached() or describe_wait(RUNNING, elapsed), "\r")
            elif self.say is not None:
                first = self.due == PATIENCE
                if first:  # this times a loop, which short runs avoid
                    self.left = self.usual() if self.doing in (COMPILING, PREPARING) else 0.0
                self.say(describe_wait(self.doing, elapsed, self.left), "\n" if first else "\r")
            self.due = elapsed + EVERY
        return False
