"""Run a submission on its hidden instances, and measure it in processes that never import its code."""

import contextlib
import json
import math
import os
import pickle
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from ...base.code_meter import CODE_LIMIT
from ...base.confined_paths import ConfinedPath, read_whole
from ...base.files import FileError
from ...base.forked_process import SLACK, ForkedProcess, ProcessEnd
from ...base.isolation import trim_output
from ...base.line_process import ModuleProcess
from ...catalogue import codes, registry
from ...catalogue.suites.spec import RunSpec
from ...mechanics.types import EndCause, Problem, StepControl
from ...reference import orbit
from ...results import environment, records, store
from ...results.records import RunRecord
from ...run import handover
from ...run.contract import make_cost_columns, select_repeat_times
from ...run.handover import LARGEST
from ...run.job import GRACE, Job, make_cut_short_record, record_unfinished
from ...run.measuring import Outcome, judge_handover
from ...run.presenting import restore_trajectory
from ...run.run import Send, store_outcome
from ...run.worker import SOFT
from .blind import FENCED, OUT, BlindTask, confine_process, hide_problem
from .instances import KINDS, STEPS, Instance, InstanceKind, digest_submission, draw_instances

CPU_LIMIT = 20.0  # [s] of a run, with its import and, except for solvers of the catalogue, code generation
MEMORY = 2000.0  # [MB]
MEASURE_LIMIT = 120.0  # [s]
REPEATS = 3  # runs of the whole process, each with its own import, for the spread of the cost


@dataclass(frozen=True)
class Submission:
    """A solver from a file or from the catalogue, with its digest."""

    name: str
    control: str  # dt or rtol
    plugin: str  # a file; empty for a solver of the catalogue
    digest: str
    fenced: bool = False  # whether this system confines it


class RefusedSubmission(ValueError):
    """A submission cannot be run; the message says why."""


def read_submission(given: str) -> Submission:
    """Return the submission ``given``: a file that marks one solver, or the name of a solver of the catalogue.

    The file is imported in another, confined process only. Raise RefusedSubmission if it cannot be run.
    """
    if given in registry.solvers():
        digest = digest_submission(codes.digest_run_code(KINDS[0].problem, given, ()).encode())
        return Submission(given, registry.solvers()[given].control, "", digest, _can_fence())
    file = Path(given).resolve()
    if not file.is_file():
        raise RefusedSubmission(f"{given} is no file and no solver of the catalogue")
    known = set(registry.solvers())

    def inspect_file(send: Send) -> None:
        """Import the file, confined, and send a list of (name, control, whether confined) of the solvers it marks."""
        fenced = confine_process(Path(place))
        registry.load_plugin(file)
        found = [name for name in registry.solvers() if name not in known]
        send(json.dumps([[name, registry.solvers()[name].control, fenced] for name in found]))

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        ended = ForkedProcess(
            inspect_file, limit=CPU_LIMIT, memory=MEMORY
        ).wait()  # code generation counts, as in each of its runs
    try:
        ((name, control, fenced),) = json.loads(ended.sent)
        if name in known or control not in STEPS or not str(name).isidentifier():
            raise ValueError
    except ValueError:
        raise RefusedSubmission(
            f"{given} must be a file that marks one solver and can be imported ({ended.words})"
        ) from None
    return Submission(name, control, str(file), digest_submission(read_whole(file)), bool(fenced))


def _can_fence() -> bool:
    """Return whether this system can confine a process, by trying it in a process of its own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        ended = ForkedProcess(
            lambda send: send(str(confine_process(Path(place)))), limit=CPU_LIMIT, memory=MEMORY
        ).wait()
    return ended.sent.strip() == "True"


class BlindWorker(ModuleProcess):
    """The process that runs tasks blind, ended by a ``with`` statement."""

    def __init__(self) -> None:
        super().__init__("harness.lab.ladder.blind")

    def __enter__(self) -> "BlindWorker":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def run(self, task: BlindTask) -> ProcessEnd:
        """Run a task in a process forked from this one, and return how it ended."""
        with tempfile.NamedTemporaryFile(delete=False) as file:
            file.write(pickle.dumps(task))
        self.send_lines(os.fsencode(f"{file.name}\n"))
        return msgspec.json.decode(self.answers.readline(), type=ProcessEnd)


@dataclass(frozen=True)
class _SolvedRun:
    """A job, and how its processes ended, one per repeat."""

    job: Job
    ended: Sequence[ProcessEnd]


def run_submission(
    submission: Submission,
    seed: str,
    folder: Path,
    *,
    kinds: tuple[InstanceKind, ...] = KINDS,
    steps: Sequence[float] | None = None,
    repeats: int = REPEATS,
    blind: BlindWorker | None = None,
) -> list[RunRecord]:
    """Run a submission on its instances, measure the motions, and return the records, stored in ``folder``.

    Instances follow from its digest and ``seed``. ``steps`` replace the ladder's steps or tolerances, ``repeats`` is
    the number of solves of each run for its cost, and ``blind`` a process that is already started. All is solved before
    anything is measured: no reference of these instances is on any disk while a submission runs.
    """
    if blind is None:
        with BlindWorker() as own:
            return run_submission(submission, seed, folder, kinds=kinds, steps=steps, repeats=repeats, blind=own)
    store.create_folder(folder)
    values = STEPS[submission.control] if steps is None else steps
    jobs = [
        _make_job(submission, instance, value, folder.resolve())
        for instance in draw_instances(submission.digest, seed, kinds)
        for value in values
    ]
    for job in jobs:
        job.stderr.parent.make_folder()
    runs = [_SolvedRun(job, [_solve_blind(blind, submission, job) for _ in range(repeats)]) for job in jobs]
    fenced = submission.fenced and all(ended.sent == FENCED for run in runs for ended in run.ended)
    (ConfinedPath(folder) / "suite.toml").write(_format_suite(submission, seed, fenced=fenced))
    return [_measure_in_process(run) for run in runs]


def _format_suite(submission: Submission, seed: str, *, fenced: bool) -> str:
    """Return the text of ``suite.toml``: the submission's name and digest, the seed, and whether it was confined."""
    about = {
        "name": "ladder",
        "submission": submission.name,
        "digest": submission.digest,
        "seed": seed,
        "fenced": fenced,
    }
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in about.items())


def _make_job(submission: Submission, instance: Instance, value: float, folder: Path) -> Job:
    """Return the job of a submission on one instance, with the step or tolerance ``value``."""
    given: dict[str, Any] = {submission.control: value}
    control = StepControl(**given)
    spec = RunSpec(instance.problem, submission.name, control, instance.parameters, cpu_limit=CPU_LIMIT, memory=MEMORY)
    return Job(spec, folder, "ladder", submission.digest, environment.read_commit(), lossless=True)


def _make_problem(job: Job) -> Problem:
    """Return the problem of a job with its true numbers, from the registry."""
    return registry.make_problem(job.spec.problem, job.spec.parameters)


def _solve_blind(blind: BlindWorker, submission: Submission, job: Job) -> ProcessEnd:
    """Solve a job's problem blind, copy the outcome to the job's handover file, and return how the process ended.

    The file is not written if there is no outcome.
    """
    control = replace(job.spec.control, cpu_limit=SOFT * CPU_LIMIT)
    hidden = hide_problem(_make_problem(job), control)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        task = BlindTask(
            *hidden, submission.name, submission.plugin, Path(place), job.stderr, CPU_LIMIT + GRACE, MEMORY
        )
        ended = blind.run(task)
        with contextlib.suppress(OSError):  # a link, for instance, in its place: there is no outcome
            job.handover.write((ConfinedPath(Path(place)) / OUT).read(LARGEST))
    return ended


def _measure_in_process(run: _SolvedRun) -> RunRecord:
    """Measure and store a run in a process with limits, and return its record.

    References are computed for this run alone and not cached. A run that is not measured in time is unfinished.
    """

    def measure(send: Send) -> None:
        """Measure the run, with references in a temporary folder of this process, and send the record as one line."""
        with tempfile.TemporaryDirectory() as place:
            orbit.FOLDER = Path(place)
            send(records.format_record(_measure_run(run)).replace("\n", " "))

    native = run.job.spool.sibling("measuring.txt")
    ended = ForkedProcess(measure, limit=MEASURE_LIMIT, memory=MEMORY, stderr=native, code=CODE_LIMIT).wait()
    if ended.code == 0:
        return records.parse_record_json(ended.sent)
    record = record_unfinished(run.job, ended, math.nan, EndCause.MEASURE_LIMIT, MEASURE_LIMIT)
    store.write_record(run.job.folder, record)
    return record


def _measure_run(run: _SolvedRun) -> RunRecord:
    """Measure the outcome of a run against its instance, store the record and return it.

    Without a handover the record says how the process ended; with one that is unreadable or has no claimed status, that
    the solver failed; else the motion is judged. Its cost is the CPU time of the whole process. That includes code
    generation, because a submission could report any of its own time as such.
    """
    job, ended = run.job, run.ended[-1]
    problem = _make_problem(job)
    trim_output(job.stderr)
    cpu = select_repeat_times([e.cpu for e in run.ended])  # later runs may use what the first one prepared
    cost: dict[str, Any] = make_cost_columns(cpu, len(cpu))
    bare = replace(record_unfinished(job, ended, math.nan, EndCause.WALL_LIMIT, SLACK * CPU_LIMIT), **cost)
    outcome = Outcome(replace(bare, section=problem.section, t_end_s=problem.t_end), problem)
    try:
        handed = handover.read_handover(job.handover, hide_problem(problem, job.spec.control)[0].system, ended.cpu)
    except FileError as error:
        handed = handover.report_exception(str(error))
    if handed is not None and handed.report.claimed is None:
        outcome = Outcome(make_cut_short_record(job, handed.report.by, message=handed.report.message, **cost), problem)
    elif handed is not None:
        motion = None if handed.trajectory is None else restore_trajectory(handed.trajectory, problem)
        peak = max(e.peak for e in run.ended)
        about = {**cost, "cpu_process_s": ended.cpu, "peak_memory_MB": peak}
        outcome = judge_handover(job, problem, replace(handed, trajectory=motion), ended.cpu, **about)
    return store_outcome(job, outcome)
