"""The process that runs submissions blind: it gets numbers without names and never learns what they are.

``python -m mbsbench.harness.ladder.blind`` forks a process a task. Tasks come as files, one path a line on standard
input; how each process ended goes out as a line.
"""

import os
import pickle
import sys
import traceback
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from ..cache import ROOT, cache_folder
from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..execution import handover, worker
from ..execution.contract import raised_at
from ..execution.handover import Handover, SolverReport
from ..execution.presenting import present_problem
from ..execution.run import Send
from ..places import Place
from ..sandbox.apart import Apart, Ended
from ..sandbox.isolation import shut_out
from ..types import EndedBy, Problem, Solver, StepControl
from .fence import keep_in_folder

OUT = "outcome.npz"
FENCED = "fenced"  # what a run's process sends once it is shut in
ANSWERS = (
    "problems",
    "harness/reference",
    "harness/ladder",
    "results",
    ".git",
)  # of the package: what knows the motion
ELSEWHERE = (
    cache_folder("references", ROOT / "results" / "local"),
    Path("results"),
)  # kept references, and results of commands that were called from here
HIDDEN = (*(ROOT.resolve() / name for name in ANSWERS), *(place.resolve() for place in ELSEWHERE))


@dataclass(frozen=True)
class Task:
    """A presented problem without its name, what solves it, its limits, and where the outcome goes."""

    problem: Problem
    control: StepControl
    solver: str
    plugin: str  # a file; empty for a solver of the catalogue
    folder: Path  # the only place that it may write to; the outcome goes there
    stderr: Place
    limit: float  # [s] of CPU time, import included
    memory: float  # [MB]


def shut_in(folder: Path) -> bool:
    """Before any code of a submission runs: let it work in ``folder`` and find no answers. False where it still can."""
    os.chdir(folder)
    os.environ.update({"TMPDIR": str(folder), "NUMBA_CACHE_DIR": str(folder)})
    if "numba" in sys.modules:  # it has read the environment; without a place it refuses @njit(cache=True)
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return keep_in_folder(folder, HIDDEN)


def hide_problem(problem: Problem, control: StepControl) -> tuple[Problem, StepControl]:
    """``problem`` as it is presented, without a name, a source or a parameter that tells which it is."""
    seen, steps = present_problem(problem, control)
    system = replace(seen.system, body_names=(), joint_names=())
    hidden = replace(seen, system=system, name="hidden", section="", source="", parameters={}, frame=np.eye(3), dt=0.0)
    return hidden, steps


class Watched(Apart):
    """A process whose tree is counted at each look: children that nobody waits for leave no other trace."""

    def look(self) -> Ended | None:
        """None while it runs."""
        self._next = 0.0
        return super().look()


def attempt(task: Task, send: Send) -> None:
    """Import the plugin, ask it, solve, and write the outcome; whatever is raised becomes one.

    The first line sent says whether the fence holds: it is written before anything of the submission is there to write.
    """
    made = list[Solver]()
    send(FENCED if shut_in(task.folder) else "")
    try:
        if task.plugin:
            registry.load_plugin(task.plugin)
        made.append(solver := registry.make_solver(task.solver))
        handed = worker.solve(task.problem, solver, task.control)
    except Exception as error:
        traceback.print_exc()
        message = f"{type(error).__name__}: {error}".split("\n")[0][:500]
        report = SolverReport(by=EndedBy.EXCEPTION, message=message + "".join(raised_at(error, s) for s in made))
        handed = Handover(report, None)
    handover.write(task.folder / OUT, handed)


def _run(task: Task) -> Ended:
    """Leave making code out of the limit for solvers of the catalogue alone: a submission's meter is its own word."""
    code = 0.0 if task.plugin else CODE_LIMIT
    ended = Watched(
        lambda send: attempt(task, send), limit=task.limit, memory=task.memory, stderr=task.stderr, code=code
    ).wait()
    return replace(ended, sent=ended.sent.partition("\n")[0])  # what follows is the submission's own


def serve() -> None:
    """Run the tasks whose files are named on standard input."""
    shut_out()
    answers = os.dup(1)
    os.dup2(2, 1)
    for line in sys.stdin:
        ended = _run(pickle.loads(Path(line.strip()).read_bytes()))
        Path(line.strip()).unlink()
        os.write(answers, msgspec.json.encode(asdict(ended)) + b"\n")


if __name__ == "__main__":
    tuple(registry.solvers().values())
    serve()
