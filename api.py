"""``mbsbench.solve`` and ``mbsbench.load``: runs in a notebook or script, measured by the code that measures all runs.

``solve`` runs in this process: what the solver raises is raised here, and no limit on memory or time ends it.
"""

import dataclasses
import json
import math
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from .harness import machine
from .harness.catalogue import registry
from .harness.catalogue.options import nearest
from .harness.execution.job import Job
from .harness.execution.kept_series import series_of
from .harness.execution.measuring import Outcome, judge_handover
from .harness.execution.run_file import read_run, write_run
from .harness.execution.warmup import runs_to_warm, warm
from .harness.execution.worker import solve as solve_here
from .harness.mechanics.consistency import check_start
from .harness.mechanics.moving_rows import check_lengths
from .harness.mechanics.state import States
from .harness.metrics.measure import measure
from .harness.places import Place
from .harness.results import environment, store
from .harness.results.codes import code_of
from .harness.results.records import RunRecord
from .harness.results.series import Series, write_series
from .harness.results.words import error_words, why
from .harness.suites.spec import RunSpec, check_step, step_control
from .harness.types import Problem, Solver, Status, Trajectory

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from matplotlib.figure import Figure

EVERY = 3.0  # [s] between two lines on how far a solve has come
PLOTTED = ("energy", "phi", "phi-dot", "step", "position")  # plots of the reports, by name


@dataclass(frozen=True, repr=False, eq=False)
class Run:
    """A run: its record, its series over time and, unless it is read from a results folder, its trajectory."""

    record: RunRecord
    trajectory: Trajectory | None = None
    kept: Series | Path | None = None  # its series, or the results folder that has them
    given: Problem | None = None  # the problem that was solved; None takes that of the catalogue

    @property
    def status(self) -> Status:
        """The status, after the motion was judged."""
        return Status(self.record.status)

    @cached_property
    def problem(self) -> Problem:
        """The problem that was solved."""
        return self.given or registry.make_problem(self.record.problem, json.loads(self.record.problem_parameters))

    @cached_property
    def series(self) -> Series | None:
        """Scalars over time by name: ``run.series["energy_error"]`` at ``run.series["t"]``; None if refused."""
        if isinstance(self.kept, Path):
            return store.series_of(self.kept, self.record)
        if self.kept is None and self.trajectory is not None:
            return series_of(self.problem, self.trajectory, measure(self.problem, self.trajectory))
        return self.kept

    def save(self, path: str | Path) -> None:
        """Write the file that ``mbsbench solve`` writes; ``load`` reads it."""
        if self.trajectory is None:
            raise ValueError(f"{self.record.case} has no trajectory to save: {_explain_missing(self.record)}")
        if Path(path).suffix != ".npz":
            raise ValueError(f"the name of the file must end in .npz (got {str(path)!r})")
        measured = measure(self.problem, self.trajectory)
        write_run(Path(path), Outcome(self.record, self.problem, self.trajectory, measured))

    def plot(self) -> "Figure":
        """Energy error, constraint norms, position error (where the exact motion is known) and step over time."""
        if self.series is None:
            raise ValueError(f"{self.record.case} has no series to plot: {_explain_missing(self.record)}")
        return _draw_figure(self.record, self.series)

    def __repr__(self) -> str:
        r = self.record
        drift = "" if math.isnan(r.energy_drift_max_J) else f"energy drift {r.energy_drift_max_J:.2e} J"
        error = f"error {said}" if (said := error_words(r)) else ""
        words = [f"{r.steps} steps to {r.t_reached_s:g} s", *(n for n in (drift, error) if n)]
        return f"<Run {r.case}: {', '.join([r.status, *(words if r.steps else [r.message])])}>"

    def _repr_html_(self) -> str:
        """A table for a notebook, with the reasons why the run is no success."""
        r = self.record
        drift = "" if math.isnan(r.energy_drift_max_J) else f"{r.energy_drift_max_J:.3g} J"
        cpu = "" if math.isnan(r.cpu_median_s) else f"{r.cpu_median_s:.3g} s"
        reasons = "" if self.status is Status.SUCCESS else "; ".join(why(r))
        reached = f"{r.t_reached_s:g} of {r.t_end_s:g} s in {r.steps} steps"
        rows = {"status": r.status, "because": reasons, "reached": reached, "energy drift": drift,
                "error": error_words(r), "CPU time": cpu}  # fmt: skip
        cells = "".join(f"<tr><th>{name}</th><td>{escape(said)}</td></tr>" for name, said in rows.items() if said)
        return f"<table><caption>{escape(r.case)}</caption>{cells}</table>"


@dataclass(frozen=True, repr=False, eq=False)
class Results:
    """The runs of a results folder."""

    folder: Path
    runs: tuple[Run, ...]
    unreadable: tuple[store.Unreadable, ...]  # files that are damaged or of another version, with the reason

    def table(self) -> "pd.DataFrame":
        """One row a run, the columns of ``RunRecord``."""
        return store.table(run.record for run in self.runs)

    def __repr__(self) -> str:
        count = {str(s): sum(run.status is s for run in self.runs) for s in Status}
        words = ", ".join(f"{n} {status}" for status, n in count.items() if n)
        return f"<Results {self.folder}: {len(self.runs)} runs{f' ({words})' if words else ''}>"


def solve(
    problem: str | Problem,
    solver: "str | Solver | type[Solver]",
    *,
    dt: float | None = None,
    rtol: float | None = None,
    max_step: float | None = None,
    max_steps: int | None = None,
    cpu_limit: float | None = None,
    t_end: float | None = None,
    **options: Any,
) -> Run:
    """Run ``solver`` (a name, a class marked ``@solver``, or an instance of one) on ``problem`` and measure its motion.

    Without ``dt`` [s] or ``rtol`` the problem's step or 1e-8. The solver stops itself at ``cpu_limit`` [s].
    """
    _warn_of_own_bits()
    variant = _resolve_problem(problem, t_end)
    given = {"dt": dt, "rtol": rtol, "max_step": max_step, "max_steps": max_steps}
    entry, made = _resolve_solver(solver, options, variant, list(given))
    steps = step_control(entry.name, entry.control, variant, {k: v for k, v in given.items() if v is not None})
    check_step(steps.dt if dt is not None else None, variant.t_end)
    control = dataclasses.replace(steps, cpu_limit=cpu_limit, spool=_Progress(variant) if _is_watched() else None)
    limits: dict[str, Any] = {"cpu_limit": cpu_limit or math.inf, "memory": math.inf}
    spec = RunSpec(variant.name, entry.name, steps, dict(variant.parameters), entry.changed_options(made), **limits)
    if cpu_limit is not None:  # compile before its clock starts
        warm(runs_to_warm([spec]))
    job = Job(spec, Path(), "", code_of(variant.name, entry.name), environment.commit())
    with threadpool_limits(1):
        handover = solve_here(variant, made, control)
    outcome = judge_handover(job, variant, handover)
    record, trajectory, m = dataclasses.replace(outcome.record, stderr=""), outcome.trajectory, outcome.measured
    series = None if trajectory is None or m is None else series_of(variant, trajectory, m)
    return Run(record, trajectory, series, variant)


class _Progress:
    """Prints how far a solve has come, where somebody watches; it keeps no steps."""

    def __init__(self, problem: Problem) -> None:
        self.rows, self._problem, self._last = 0, problem, time.monotonic()

    def due(self) -> bool:
        """Whether it is time for another line."""
        return time.monotonic() - self._last > EVERY

    def take(self, t: "np.ndarray | list[float]", states: States) -> None:
        """Print where the motion is."""
        self.rows, self._last = self.rows + len(t), time.monotonic()
        if len(t):
            sys.stderr.write(f"{self._problem.name}: t = {t[-1]:.4g} of {self._problem.t_end:g} s\n")


def _is_watched() -> bool:
    """Whether this is a notebook or a terminal, not a script whose output goes to a file."""
    return "ipykernel" in sys.modules or bool(sys.stderr and sys.stderr.isatty())


def load(path: str | Path, problem: Problem | None = None) -> Run | Results:
    """The run in an NPZ file, or the runs of a results folder, given by its path or its name in ``results/local``.

    A problem that is not in the catalogue has to be given again: its file names it only.
    """
    if Path(path).suffix == ".npz":
        record, trajectory = read_run(Path(path))
        return Run(record, trajectory, given=problem)
    for folder in (Path(path), store.LOCAL / path):
        if (Place(folder) / "runs").is_folder():
            loaded = store.load(folder, check_series=False)
            return Results(folder, tuple(Run(r, kept=folder) for r in loaded.records), loaded.unreadable)
    raise ValueError(f"{path} is neither an .npz file nor a results folder")


def scipy(method: str, **options: Any) -> Solver:
    """The strong form by a method of scipy: RK23, RK45, DOP853, Radau, BDF or LSODA."""
    return registry.make_solver("scipy_strong_form", {"method": method, **options})


@cache
def _warn_of_own_bits() -> None:
    """Say once where NumPy was loaded before this package, too early for the pin of its arithmetic."""
    if words := machine.explain_deviations():
        remedy = ": import mbsbench before numpy and numba" if machine.variables() else ""
        warnings.warn(words + remedy, stacklevel=3)


def _resolve_problem(given: str | Problem, t_end: float | None) -> Problem:
    if t_end is not None and not 0.0 < t_end < math.inf:
        raise ValueError(f"t_end must be a finite number > 0 [s] (got {t_end!r})")
    changes: dict[str, Any] = {} if t_end is None else {"t_end": float(t_end)}
    if isinstance(given, str):
        return registry.make_problem(given, changes)
    if not isinstance(given, Problem):
        raise ValueError(f"problem must be a name or a Problem (got {_describe_kind(given)})")
    check_start(given.system, given.initial, literal=given.literal_start)
    check_lengths(given.system, t_end or given.t_end)
    return dataclasses.replace(given, parameters={**given.parameters, **changes}, **changes)


def _resolve_solver(
    given: "str | Solver | type[Solver]", options: Mapping[str, Any], variant: Problem, controls: list[str]
) -> tuple[registry.SolverEntry, Solver]:
    """The solver, with its entry: a class or an instance need not be in the catalogue."""
    if not isinstance(given, str | type):
        if options:
            raise ValueError(f"give the options to {type(given).__name__}(...) (got {', '.join(options)})")
        return registry.solver_entry(type(given)), given
    if isinstance(given, str):
        entry = registry.entry_of("solver", given, registry.solvers())
    else:
        entry = registry.solver_entry(given)
    known = registry.problems().get(variant.name)
    for key in options:
        if known and key in known.parameters and key not in entry.parameters:
            raise ValueError(f"{key} is a parameter of the problem: make_problem({variant.name!r}, {{{key!r}: ...}})")
        if key not in entry.parameters:
            raise ValueError(f"solver {entry.name} has no option {key!r}{nearest(key, [*entry.parameters, *controls])}")
    return entry, entry.make_solver(options)


def _draw_figure(record: RunRecord, series: Series) -> "Figure":
    """Drawn by the reports, from a results folder with this run alone."""
    from .reports.model.motion import motion_of
    from .reports.model.results import read_results
    from .reports.plots.laws import Drawing, errors, laws
    from .reports.plots.lines import all_lines, shared_options
    from .reports.plots.paper import figure, style
    from .reports.plots.spec import looks

    with tempfile.TemporaryDirectory() as place:
        folder = store.create(Path(place))
        place = f"series/{record.run_id}.npz"
        digest = write_series(Place(folder) / place, series)
        store.write_record(folder, dataclasses.replace(record, series=place, series_sha256=digest, stderr=""))
        results = read_results(folder)
        (run,) = results.runs
        motions = {record.run_id: motion_of(run, results.series(run))}
        drawing = Drawing([run], all_lines([run], shared_options([run])), motions)
    chapters = [c for c in (laws(drawing), errors(drawing)) if c]
    with style():
        return figure([p for c in chapters for p in c.plots if p.name in PLOTTED], looks([record.solver]))


def _explain_missing(record: RunRecord) -> str:
    if record.status == Status.REFUSED:
        return f"refused, {record.message}"
    return "it is a run of a results folder" if record.series else f"{record.status}, {record.message}"


def _describe_kind(given: object) -> str:
    return "a function: call it" if callable(given) else type(given).__name__
