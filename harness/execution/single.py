"""One run from the shell: solved in a process of its own, written as one NPZ file, whatever happens."""

import contextlib
import errno
import json
import os
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..catalogue import registry
from ..files import partial_of
from ..mechanics.state import States
from ..metrics.measure import measure
from ..metrics.reactions import largest_joint_force
from ..metrics.scales import scales
from ..metrics.summary import columns
from ..metrics.verdict import doubts
from ..results.series import write_npz
from ..results.words import words_of
from ..sandbox.isolation import CANNOT_WRITE, fork, kill_group
from ..sandbox.spool import FileSpool, kept
from ..suites.spec import RunSpec
from ..types import EndedBy, Problem, Status, StepControl, Trajectory
from .presented import presented
from .supervisor import GRACE
from .warmup import runs_to_warm, warm_apart_then_here
from .worker import solve_repeatedly

PATIENCE = 3.0  # [s] until it is said that compilation may go on
NO_LIMIT = 1e7  # [s] of CPU, four months: a run from the shell is ended by whoever started it


@dataclass(frozen=True)
class Outcome:
    """How a single run went, for the summary on the terminal."""

    status: Status
    message: str
    lines: tuple[str, ...]
    native: str  # the last of what the process wrote to standard error


def solve_to_file(
    spec: RunSpec, out: Path, wall_limit: float | None, say: Callable[[str], object] = lambda words: None
) -> Outcome:
    """Run ``run`` and write ``out``; a run that crashes or is killed leaves a file with the steps it had kept.

    Interrupted itself, it ends the run and leaves ``out`` as it was: whole, or not there.
    """
    problem = registry.make_problem(spec.problem, spec.parameters)
    patience = _Patience(say)
    if wall_limit is not None:  # a limit is on the run: compile before its clock starts
        warm_apart_then_here(runs_to_warm([spec]), patience.over)
    with tempfile.TemporaryDirectory() as place:
        note, stderr = Path(place) / "outcome.json", Path(place) / "stderr"
        cpu = NO_LIMIT if wall_limit is None else 2.0 * wall_limit + 60.0
        rows = Path(place) / "rows"
        child = fork(lambda tell: _solve(spec, problem, out, note, wall_limit, rows), stderr, spec.memory, cpu)
        try:
            by, words = _wait(child.pid, wall_limit, patience)
        except BaseException:
            kill_group(child.pid)
            with contextlib.suppress(ChildProcessError):  # it may have ended just now
                os.waitpid(child.pid, 0)
            partial_of(out, child.pid).unlink(missing_ok=True)
            raise
        os.close(child.phase)
        native = stderr.read_text(encoding="utf-8", errors="replace")[-2000:].strip() if stderr.exists() else ""
        if note.exists():
            plain = json.loads(note.read_text(encoding="utf-8"))
            return Outcome(Status(plain["status"]), plain["message"], tuple(plain["lines"]), native)
        if words == _exited(CANNOT_WRITE):  # nobody's result: the disk is full
            partial_of(out, child.pid).unlink(missing_ok=True)
            raise OSError(errno.ENOSPC, "nothing was written: no space left", str(out))
        status = Status.STALLED if by is EndedBy.WALL_LIMIT else Status.CRASHED
        left = kept(rows, problem, status, words) or _start_only(problem, status, words)
    _write(out, problem, left, status, left.message)
    return Outcome(status, left.message, (), native)


class _Patience:
    """Says once that a run takes its time, and why it may."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self.say, self.until, self.told = say, time.monotonic() + PATIENCE, False

    def over(self) -> bool:
        """Never; but looks at the clock."""
        if not self.told and time.monotonic() > self.until:
            self.told = True
            self.say(
                "running; the first run after an installation or a change compiles kernels for half a minute or more"
            )
        return False


def _wait(pid: int, wall_limit: float | None, patience: _Patience) -> tuple[EndedBy, str]:
    """Wait for the child; words for its end."""
    hard = None if wall_limit is None else time.monotonic() + wall_limit + GRACE
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            if code < 0:
                return EndedBy.SIGNAL, f"its process ended by {signal.Signals(-code).name}"
            return EndedBy.EXIT, _exited(code)
        if hard and time.monotonic() > hard:
            kill_group(pid)
            os.waitpid(pid, 0)
            return EndedBy.WALL_LIMIT, f"killed at the wall limit of {wall_limit:g} s; it did not stop when asked"
        patience.over()
        time.sleep(0.02)


def _exited(code: int) -> str:
    return f"its process exited with {code}"


def _solve(spec: RunSpec, problem: Problem, out: Path, note: Path, wall_limit: float | None, rows: Path) -> None:
    solver = presented(registry.make_solver(spec.solver, spec.options), problem)
    c = spec.control
    control = StepControl(c.dt, c.rtol, c.max_step, c.max_steps, wall_limit, FileSpool(rows))
    reason = solver.refuses(problem, control)
    cost: dict[str, float] = {}
    if reason:
        trajectory = _start_only(problem, Status.REFUSED, reason)
    else:
        try:
            trajectory, cost = solve_repeatedly(solver, problem, control, 1)
        except MemoryError as error:
            trajectory = _left(rows, problem, Status.MEMORY, f"MemoryError: {error}")
        except Exception as error:  # a solver's own exception is its result
            trajectory = _left(rows, problem, Status.CRASHED, f"{type(error).__name__}: {error}")
    measured = measure(problem, trajectory)
    size = scales(problem.system, problem.initial)
    numbers = columns(problem, trajectory, measured, size)
    status, message = Status(trajectory.status), str(trajectory.message)
    if status is Status.SUCCESS:
        because = doubts(problem, trajectory, measured, numbers, size)
        if because:
            status, message = Status.WRONG, "; ".join([*([message] if message else []), *map(words_of, because)])
    _write(out, problem, trajectory, status, message)
    lines = (
        []
        if status is Status.REFUSED
        else [
            f"t reached          {numbers['t_reached_s']:.9g} s of {problem.t_end:g} s in {numbers['steps']} steps",
            f"energy drift       {numbers['energy_drift_max_J']:.3e} J (scale {size.energy:.3g} J)",
            f"|phi|, |phi_dot|   {numbers['phi_max']:.3e} m, {numbers['phi_dot_max']:.3e} m/s",
        ]
    )
    if lines and "position_error_max_m" in numbers:
        compared = min(numbers["reference_horizon_s"], numbers["t_reached_s"])
        worst = f"{numbers['position_error_max_m']:.3e} m, {numbers['orientation_error_max_rad']:.3e} rad"
        lines.append(f"error              {worst} (to {compared:g} s)")
    if cost:
        lines.append(f"CPU time           {cost['cpu_min_s']:.3g} s (set-up {cost['setup_s']:.3g} s)")
    lines += [f"note               {n}" for n in trajectory.notes]
    note.write_text(json.dumps({"status": str(status), "message": message, "lines": lines}), encoding="utf-8")


def _write(out: Path, problem: Problem, trajectory: Trajectory, status: Status, message: str) -> None:
    m, s = measure(problem, trajectory), trajectory.states
    arrays = {
        "t": m.t, "r": s.r, "R": s.R, "v": s.v, "Omega": s.Omega,
        "energy": m.energy, "phi_norm": m.phi_norm, "phi_dot_norm": m.phi_dot_norm, "dt": np.diff(m.t),
        "status": np.asarray(str(status)), "message": np.asarray(message),
        "counters": np.asarray(json.dumps({k: int(v) for k, v in trajectory.counters.items()})),
        **{f"obs_{name}": values for name, values in m.observables.items()},
    }  # fmt: skip
    if trajectory.reaction is not None:
        arrays["obs_joint_force"] = largest_joint_force(problem.system, np.asarray(trajectory.reaction, dtype=float))
        arrays["reaction"] = trajectory.reaction  # (nt, nrows), conjugate to phi: N for point rows, N m for axis rows
    write_npz(out, arrays)


def _left(rows: Path, problem: Problem, status: Status, message: str) -> Trajectory:
    return kept(rows, problem, status, message) or _start_only(problem, status, message)


def _start_only(problem: Problem, status: Status, message: str) -> Trajectory:
    return Trajectory(np.zeros(1), States.one(problem.initial), status, message, {})
