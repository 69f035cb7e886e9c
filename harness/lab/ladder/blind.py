"""Run submissions in a process that gets problems as numbers without names, and never learns which they are.

``python -m mbsbench.harness.lab.ladder.blind`` forks a process for each task. The paths of task files come one a line
on standard input; how each process ended is written as a line of JSON.
"""

import os
import pickle
import sys
import traceback
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from ...base.cache import ROOT, make_cache_folder
from ...base.code_meter import CODE_LIMIT
from ...base.confined_paths import ConfinedPath
from ...base.forked_process import ForkedProcess, ProcessEnd
from ...base.isolation import protect_process
from ...catalogue import registry
from ...catalogue.mechanism import load_readers
from ...mechanics.types import Problem, Solver, StepControl
from ...run import handover, worker
from ...run.contract import locate_error
from ...run.presenting import present_problem
from ...run.run import Send
from .fence import confine_to_folder

OUT = "outcome.npz"
FENCED = "fenced"  # what the process of a run sends once it is confined
ANSWERS = (
    "problems",
    "harness/reference",
    "harness/lab/ladder",
    "results",
    ".git",
)  # parts of the package that would reveal the motion
ELSEWHERE = (
    make_cache_folder("references", ROOT / "results" / "local"),
    Path("results"),
)  # cached references, and results of commands called from the working directory
HIDDEN = (*(ROOT.resolve() / name for name in ANSWERS), *(place.resolve() for place in ELSEWHERE))


@dataclass(frozen=True)
class BlindTask:
    """A problem, as presented and without its name, with the solver, its limits, and where the outcome is written."""

    problem: Problem
    control: StepControl
    solver: str
    plugin: str  # a file; empty for a solver of the catalogue
    folder: Path  # the only place that it may write to; the outcome goes there
    stderr: ConfinedPath
    limit: float  # [s] of CPU time, import included
    memory: float  # [MB]


def confine_process(folder: Path) -> bool:
    """Confine this process to ``folder`` and hide the answers from it, before code of a submission runs.

    Return whether the system enforces all of it. The process also changes to that folder, and gets it as folder for
    temporary files and numba's cache.
    """
    os.chdir(folder)
    os.environ.update({"TMPDIR": str(folder), "NUMBA_CACHE_DIR": str(folder)})
    if "numba" in sys.modules:  # it has read the environment already, and refuses @njit(cache=True) without a folder
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return confine_to_folder(folder, HIDDEN)


def hide_problem(problem: Problem, control: StepControl) -> tuple[Problem, StepControl]:
    """Return the problem as presented, without names, sources or parameters that identify it, and its step control."""
    seen, steps = present_problem(problem, control)
    system = replace(seen.system, body_names=(), joint_names=())
    hidden = replace(seen, system=system, name="hidden", section="", source="", parameters={}, frame=np.eye(3), dt=0.0)
    return hidden, steps


class WatchedProcess(ForkedProcess):
    """A process whose children are counted at each check: those that nobody waits for leave no other trace."""

    def check_end(self) -> ProcessEnd | None:
        """Return how the process ended, or None while it runs; count its children at every call."""
        self._next = 0.0
        return super().check_end()


def attempt_solve(task: BlindTask, send: Send) -> None:
    """Confine this process, import the plugin, solve, and write the outcome; an exception is an outcome too.

    The first line sent, by ``send``, is ``FENCED`` or empty: whether the confinement holds. It is sent before any code
    of the submission could send lines.
    """
    made = list[Solver]()
    send(FENCED if confine_process(task.folder) else "")
    try:
        if task.plugin:
            registry.load_plugin(task.plugin)
        made.append(solver := registry.make_solver(task.solver))
        handed = worker.solve(task.problem, solver, task.control)
    except Exception as error:  # an entry may raise anything: a result
        traceback.print_exc()
        message = f"{type(error).__name__}: {error}".split("\n")[0][:500]
        handed = handover.report_exception(message + "".join(locate_error(error, s) for s in made))
    handover.write_handover(task.folder / OUT, handed)


def _run_task(task: BlindTask) -> ProcessEnd:
    """Run a task in a process of its own, and return how that ended, with the first line that it sent.

    The CPU limit includes code generation for a submission, whose own report of it cannot be trusted.
    """
    code = 0.0 if task.plugin else CODE_LIMIT
    ended = WatchedProcess(
        lambda send: attempt_solve(task, send), limit=task.limit, memory=task.memory, stderr=task.stderr, code=code
    ).wait()
    return replace(ended, sent=ended.sent.partition("\n")[0])  # later lines come from the submission


def serve() -> None:
    """Run the tasks whose files are named on standard input, one after the other, and write how each process ended.

    The answers go to the standard output, as lines of JSON; what else is printed goes to the standard error. Each task
    file is removed afterwards.
    """
    protect_process()
    answers = os.dup(1)
    os.dup2(2, 1)
    for line in sys.stdin:
        ended = _run_task(pickle.loads(Path(line.strip()).read_bytes()))
        Path(line.strip()).unlink()
        os.write(answers, msgspec.json.encode(asdict(ended)) + b"\n")


if __name__ == "__main__":
    tuple(registry.solvers().values())
    load_readers()
    serve()
