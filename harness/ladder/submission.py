"""A submission run on its hidden instances, measured by processes that never saw its code."""

import contextlib
import json
import math
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..execution import handover
from ..execution.contract import cost_columns, repeated_cost
from ..execution.handover import LARGEST, Handover, SolverReport
from ..execution.job import GRACE, Job, cut_short, record_unfinished
from ..execution.measuring import Outcome, judge_handover
from ..execution.presenting import bring_home
from ..execution.run import Send, store_outcome
from ..execution.worker import SOFT
from ..files import FileError
from ..machine import THREADS
from ..places import Place, read_whole
from ..reference import orbit
from ..results import codes, environment, records, store
from ..results.environment import ROOT
from ..results.records import RunRecord
from ..sandbox.apart import SLACK, Apart, Ended
from ..sandbox.isolation import trim
from ..suites.spec import RunSpec
from ..types import EndedBy, Problem, StepControl
from .blind import FENCED, OUT, Task, hide_problem, shut_in
from .instances import KINDS, STEPS, Instance, Kind, digest_of, draw_instances

CPU_LIMIT = 20.0  # [s] of a run: import included, and making code but for solvers of the catalogue
MEMORY = 2000.0  # [MB]
MEASURE_LIMIT = 120.0  # [s]
REPEATS = 3  # of the whole process, each with its own import: the spread of its cost


@dataclass(frozen=True)
class Submission:
    """A solver of a file or of the catalogue."""

    name: str
    control: str  # dt or rtol
    plugin: str  # a file; empty for a solver of the catalogue
    digest: str
    fenced: bool = False  # whether this system keeps it from files, answers, sockets and other processes


class Refused(ValueError):
    """What was submitted cannot be run; the message says why."""


def read_submission(given: str) -> Submission:
    """The one solver in a file, which is imported in another process alone, or the solver of that name."""
    if given in registry.solvers():
        digest = digest_of(codes.code_of(KINDS[0].problem, given, ()).encode())
        return Submission(given, registry.solvers()[given].control, "", digest, _can_fence())
    file = Path(given).resolve()
    if not file.is_file():
        raise Refused(f"{given} is no file and no solver of the catalogue")
    known = set(registry.solvers())

    def look(send: Send) -> None:
        fenced = shut_in(Path(place))
        registry.load_plugin(file)
        found = [name for name in registry.solvers() if name not in known]
        send(json.dumps([[name, registry.solvers()[name].control, fenced] for name in found]))

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        ended = Apart(look, limit=CPU_LIMIT, memory=MEMORY).wait()  # all counts, as in each of its runs
    try:
        ((name, control, fenced),) = json.loads(ended.sent)
        if name in known or control not in STEPS or not str(name).isidentifier():
            raise ValueError
    except ValueError:
        raise Refused(f"{given} must be a file that marks one solver and can be imported ({ended.words})") from None
    return Submission(name, control, str(file), digest_of(read_whole(file)), bool(fenced))


def _can_fence() -> bool:
    """Whether this system keeps a process in, tried in one."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        ended = Apart(lambda send: send(str(shut_in(Path(place)))), limit=CPU_LIMIT, memory=MEMORY).wait()
    return ended.sent.strip() == "True"


class Blind:
    """The process that runs tasks; use in a ``with`` statement."""

    def __enter__(self) -> "Blind":
        self.process = subprocess.Popen(
            (sys.executable, "-m", "mbsbench.harness.ladder.blind"), cwd=ROOT, env={**os.environ, **THREADS}, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        return self

    def __exit__(self, *exception: object) -> None:
        self.process.communicate()

    def run(self, task: Task) -> Ended:
        """How the process of the task ended."""
        assert self.process.stdin is not None and self.process.stdout is not None
        with tempfile.NamedTemporaryFile(delete=False) as file:
            file.write(pickle.dumps(task))
        self.process.stdin.write(f"{file.name}\n")
        self.process.stdin.flush()
        return msgspec.json.decode(self.process.stdout.readline(), type=Ended)


@dataclass(frozen=True)
class _Run:
    """A job, its presented problem, and how its processes ended."""

    job: Job
    ended: Sequence[Ended]


def run_submission(
    submission: Submission, seed: str, folder: Path, *, kinds: tuple[Kind, ...] = KINDS,
    steps: Sequence[float] | None = None, repeats: int = REPEATS, blind: Blind | None = None,
) -> list[RunRecord]:  # fmt: skip
    """The records of ``submission`` on its instances, in a results folder.

    All is solved before anything is measured: no reference of these instances is on any disk while a submission runs.
    """
    if blind is None:
        with Blind() as own:
            return run_submission(submission, seed, folder, kinds=kinds, steps=steps, repeats=repeats, blind=own)
    store.create(folder)
    values = STEPS[submission.control] if steps is None else steps
    jobs = [
        _job(submission, instance, value, folder.resolve())
        for instance in draw_instances(submission.digest, seed, kinds)
        for value in values
    ]
    for job in jobs:
        job.stderr.parent.make()
    runs = [_Run(job, [_solve(blind, submission, job) for _ in range(repeats)]) for job in jobs]
    fenced = submission.fenced and all(ended.sent == FENCED for run in runs for ended in run.ended)
    (Place(folder) / "suite.toml").write(_describe(submission, seed, fenced=fenced))
    return [_measure_apart(run) for run in runs]


def _describe(submission: Submission, seed: str, *, fenced: bool) -> str:
    about = {
        "name": "ladder", "submission": submission.name, "digest": submission.digest, "seed": seed,
        "fenced": fenced,
    }  # fmt: skip
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in about.items())


def _job(submission: Submission, instance: Instance, value: float, folder: Path) -> Job:
    given: dict[str, Any] = {submission.control: value}
    control = StepControl(**given)
    spec = RunSpec(instance.problem, submission.name, control, instance.parameters, cpu_limit=CPU_LIMIT, memory=MEMORY)
    return Job(spec, folder, "ladder", submission.digest, environment.commit(), lossless=True)


def _problem(job: Job) -> Problem:
    return registry.make_problem(job.spec.problem, job.spec.parameters)


def _solve(blind: Blind, submission: Submission, job: Job) -> Ended:
    control = replace(job.spec.control, cpu_limit=SOFT * CPU_LIMIT)
    hidden = hide_problem(_problem(job), control)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        task = Task(*hidden, submission.name, submission.plugin, Path(place), job.stderr, CPU_LIMIT + GRACE, MEMORY)
        ended = blind.run(task)
        with contextlib.suppress(OSError):  # a link or the like in its place: nothing was handed over
            job.handover.write((Place(Path(place)) / OUT).read(LARGEST))
    return ended


def _measure_apart(run: _Run) -> RunRecord:
    """Measure and store, where a limit holds; references are computed for this alone and kept nowhere."""

    def work(send: Send) -> None:
        with tempfile.TemporaryDirectory() as place:
            orbit.FOLDER = Path(place)
            send(records.to_json(_measure(run)).replace("\n", " "))

    native = run.job.spool.sibling("measuring.txt")
    ended = Apart(work, limit=MEASURE_LIMIT, memory=MEMORY, stderr=native, code=CODE_LIMIT).wait()
    if ended.code == 0:
        return records.from_json(ended.sent)
    record = record_unfinished(run.job, ended, math.nan, EndedBy.MEASURE_LIMIT, MEASURE_LIMIT)
    store.write_record(run.job.folder, record)
    return record


def _measure(run: _Run) -> RunRecord:
    """Judge what was handed over in the terms of the instance; its cost is all that its process took.

    That includes making code, since a submission's own process meters it and could call anything by that name.
    """
    job, ended = run.job, run.ended[-1]
    problem = _problem(job)
    trim(job.stderr)
    cpu = repeated_cost([e.cpu for e in run.ended])  # later ones may have been prepared by the first
    cost: dict[str, Any] = cost_columns(cpu, len(cpu))
    bare = replace(record_unfinished(job, ended, math.nan, EndedBy.WALL_LIMIT, SLACK * CPU_LIMIT), **cost)
    outcome = Outcome(replace(bare, section=problem.section, t_end_s=problem.t_end), problem)
    try:
        handed = handover.read(job.handover, hide_problem(problem, job.spec.control)[0].system, ended.cpu)
    except FileError as error:
        handed = Handover(SolverReport(by=EndedBy.EXCEPTION, message=str(error)), None)
    if handed is not None and handed.report.claimed is None:
        outcome = Outcome(cut_short(job, handed.report.by, message=handed.report.message, **cost), problem)
    elif handed is not None:
        motion = None if handed.trajectory is None else bring_home(handed.trajectory, problem)
        peak = max(e.peak for e in run.ended)
        about = {**cost, "cpu_process_s": ended.cpu, "peak_memory_MB": peak}
        outcome = judge_handover(job, problem, Handover(handed.report, motion), ended.cpu, **about)
    return store_outcome(job, outcome)
