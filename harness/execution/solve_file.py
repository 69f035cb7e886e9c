"""One run from the shell: run as any other, written as one NPZ file, whatever happens."""

import dataclasses
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from ..files import partial_of
from ..results.naming import format_name
from ..results.records import RunRecord
from ..sandbox.isolation import OUTPUT_LIMIT
from ..suites.spec import RunSpec
from ..types import Problem
from .costs import LAWS, Prepared, expect, reference_name
from .eta import COMPILING, PREPARING, describe_wait
from .job import Job
from .measuring import Outcome
from .run import MEASURE_LIMIT, MEASURING, NO_LIMIT, STORED, Run, Send, run_one, send_record
from .run_file import write_run, write_without_motion
from .supervisor import outcome_of
from .warmup import prepare, runs_to_warm, warm

RUNNING = "running"
PATIENCE = 3.0  # [s] of any of these until it is mentioned


Say = Callable[[str, str], None]  # words and the end of their line; after a carriage return they are written over


def solve_to_file(
    spec: RunSpec, out: Path, cpu_limit: float | None, say: Say | None = None, problem: Problem | None = None
) -> tuple[RunRecord, str]:
    """Run ``spec`` and write ``out``; a run that crashes or is killed leaves a file with the steps it had kept.

    Interrupted itself, it ends the run and leaves ``out`` as it was: whole, or not there. ``problem`` is that of
    ``spec``, if it is made already; its reference and its observables are used in other processes alone. Returned are
    the record, without address as its series is the file, and the last of what the process wrote to standard error.
    """
    patience = _Patience(say, lambda: expect([spec], 1).once)
    with tempfile.TemporaryDirectory() as place:
        limit = math.inf if cpu_limit is None else cpu_limit
        job = Job(dataclasses.replace(spec, cpu_limit=limit), Path(place))
        job.stderr.parent.make()
        if cpu_limit is not None:  # a limit is on the run: compute the reference and compile before its clock starts
            patience.now(PREPARING)
            prepare(runs_to_warm([spec]), [job], patience.over)
        measure_limit = NO_LIMIT if cpu_limit is None else MEASURE_LIMIT

        def work(send: Send) -> None:
            if cpu_limit is None:
                warm(runs_to_warm([spec], problem), problem)
            send(RUNNING)
            outcome = run_one(job, send, problem, soft=1.0, measure_limit=measure_limit)
            send_record(send, STORED, keep(outcome))

        def keep(outcome: Outcome) -> RunRecord:
            return write_run(out, dataclasses.replace(outcome, record=dataclasses.replace(outcome.record, stderr="")))

        def finish(process: Run) -> tuple[RunRecord, bool]:
            try:
                return outcome_of(process, process.watch(lambda: patience.now(_stage(process.hear()))))
            finally:
                partial_of(out, process.pid).unlink(missing_ok=True)

        patience.now(COMPILING)
        process = Run(job, work, measure_limit)
        record, stored = finish(process)
        if not stored and (salvage := process.salvage(record, keep, problem)) is not None:
            record, stored = finish(salvage)
        native = job.stderr.read(OUTPUT_LIMIT).decode(errors="replace") if job.stderr.is_there() else ""
        if stored:
            Prepared().add([LAWS, spec.solver, reference_name(format_name(spec.problem, spec.parameters))])
        else:
            record = write_without_motion(out, dataclasses.replace(record, stderr=""))
        return record, native[-2000:].strip()


def _stage(heard: str) -> str:
    return next((stage for stage in (MEASURING, RUNNING) if f"\n{stage}" in f"\n{heard}"), COMPILING)


class _Patience:
    """Says what takes its time and how long is left, once; then every second on one line."""

    def __init__(self, say: Say | None, usual: Callable[[], float]) -> None:
        self.say, self.usual, self.doing = say, usual, ""

    def now(self, doing: str) -> bool:
        """Note what is being done from now on."""
        if doing != self.doing:
            self.doing, self.began, self.due = doing, time.monotonic(), PATIENCE
        return self.over()

    def over(self) -> bool:
        """Say how long it takes; always False, so that the wait continues."""
        elapsed = time.monotonic() - self.began
        if elapsed > self.due:
            if self.say is not None:
                first = self.due == PATIENCE
                if first:  # a loop is timed for it, which short runs are spared
                    self.left = self.usual() if self.doing in (COMPILING, PREPARING) else 0.0
                self.say(describe_wait(self.doing, elapsed, self.left), "\n" if first else "\r")
            self.due = elapsed + 1.0
        return False
