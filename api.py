"""Provide ``mbsbench.solve`` and ``mbsbench.load``: runs in a notebook or script, measured as all runs are.

``solve`` runs in this process: an exception of the solver is raised here, and no limit on memory or time ends it.
"""

import dataclasses
import math
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from .harness.base import machine
from .harness.base.confined_paths import ConfinedPath
from .harness.base.hints import suggest_name
from .harness.base.naming import format_name
from .harness.catalogue import registry
from .harness.catalogue.codes import digest_run_code, read_column_digests
from .harness.catalogue.suites.spec import RunSpec, check_step, make_step_control
from .harness.judge.metrics.measure import measure
from .harness.mechanics.consistency import check_start
from .harness.mechanics.moving_rows import check_lengths
from .harness.mechanics.types import Problem, Solver, Status, Trajectory
from .harness.results import environment, store
from .harness.results.frame import make_frame
from .harness.results.records import RunRecord
from .harness.results.series import Series, write_series
from .harness.results.words import describe_errors, describe_status
from .harness.run.job import Job
from .harness.run.kept_series import build_series
from .harness.run.measuring import Outcome, judge_handover
from .harness.run.progress_line import ProgressLine
from .harness.run.run_file import read_run, write_run
from .harness.run.warmup import list_runs_to_warm, warm_up
from .harness.run.worker import solve as solve_here
from .notebook import show_results, show_run

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PLOTTED = ("energy", "phi", "phi-dot", "step", "position")  # those of the reports' plots that Run.plot draws


@dataclass(frozen=True, repr=False, eq=False)
class Run:
    """A run: its record, its time histories and, unless it was read from a results folder, its trajectory."""

    record: RunRecord
    trajectory: Trajectory | None = None
    kept: Series | Path | None = None  # its series, or the results folder that holds it
    given: Problem | None = None  # the problem that was solved; None for that of the catalogue

    @property
    def status(self) -> Status:
        """The status that the harness gave the run when it judged the motion, not the one that the solver claimed."""
        return Status(self.record.status)

    @cached_property
    def problem(self) -> Problem:
        """The problem that was solved; made from the catalogue by the record's parameters if it was not given."""
        return self.given or registry.make_problem(self.record.problem, self.record.parameters)

    @cached_property
    def series(self) -> Series | None:
        """Scalars over time by name: ``run.series["energy_error"]`` at ``run.series["t"]``; None without any step."""
        if isinstance(self.kept, Path):
            return store.read_run_series(self.kept, self.record)
        if self.kept is None and self.trajectory is not None:
            return build_series(self.problem, self.trajectory, measure(self.problem, self.trajectory))
        return self.kept

    def save(self, path: str | Path) -> None:
        """Write the run to an NPZ file, as ``mbsbench solve`` does; ``load`` reads it.

        Raise ValueError if the run has no trajectory (refused, or read from a results folder), or for another suffix.
        """
        if self.trajectory is None:
            raise ValueError(f"{self.record.case} has no trajectory to save: {_explain_missing(self.record)}")
        if Path(path).suffix != ".npz":
            raise ValueError(f"the name of the file must end in .npz (got {str(path)!r})")
        measured = measure(self.problem, self.trajectory)
        write_run(Path(path), Outcome(self.record, self.problem, self.trajectory, measured))

    def plot(self, *others: "Run") -> "Figure":
        """Plot energy error, constraint norms, position error and step over time, with ``others`` of the same problem.

        Each line is named by its solver and setting. The position error needs a reference. Raise ValueError for a run
        without time histories, or with other parameters of the problem than this one; end times may differ.
        """
        drawn = []
        for run in (self, *others):
            if not isinstance(run, Run):
                raise ValueError(f"plot takes runs (got {_describe_kind(run)})")
            if run.series is None:
                raise ValueError(f"{run.record.case} has no series to plot: {_explain_missing(run.record)}")
            if _describe_motion(run) != _describe_motion(self):
                raise ValueError(
                    f"plot takes runs of one problem (got {_describe_motion(self)} and {_describe_motion(run)})"
                )
            drawn.append((run.record, run.series))
        return _draw_figure(drawn)

    def __repr__(self) -> str:
        """Return case and status in one line, with steps, drift and error, or for a run without steps its message."""
        r = self.record
        drift = "" if math.isnan(r.energy_drift_max_J) else f"energy drift {r.energy_drift_max_J:.2e} J"
        error = f"error {text}" if (text := describe_errors(r)) else ""
        words = [f"{r.steps} steps to {r.t_reached_s:g} s", *(n for n in (drift, error) if n)]
        return f"<Run {r.case}: {', '.join([describe_status(r), *(words if r.steps else [r.message])])}>"

    def _repr_html_(self) -> str:
        return show_run(self.record)


@dataclass(frozen=True, repr=False, eq=False)
class Results:
    """The runs read from a results folder."""

    folder: Path
    runs: tuple[Run, ...]
    unreadable: Mapping[Path, str]  # damaged files or files of another version, with the reason

    def table(self) -> "pd.DataFrame":
        """Return a table with one row per run and the columns of ``RunRecord``, as ``runs.parquet`` has it."""
        return store.table(run.record for run in self.runs)

    def frame(self) -> "pd.DataFrame":
        """Return that table with parameters, options and counts as columns of their own: ``frame["option.gauge"]``."""
        return make_frame(run.record for run in self.runs)

    def __repr__(self) -> str:
        """Return the folder with its number of runs, in all and by status."""
        count = {str(s): sum(run.status is s for run in self.runs) for s in Status}
        words = ", ".join(f"{n} {status}" for status, n in count.items() if n)
        return f"<Results {self.folder}: {len(self.runs)} runs{f' ({words})' if words else ''}>"

    def _repr_html_(self) -> str:
        unreadable = {path.name: why for path, why in self.unreadable.items()}
        return show_results(str(self.folder), [run.record for run in self.runs], unreadable)


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
    """Run ``solver`` on ``problem`` in this process, and measure and judge its motion.

    ``problem`` is a name or a Problem; ``solver`` a name, a class marked ``@solver``, or an instance of one, and
    ``options`` are its own. Without ``dt`` [s] or ``rtol`` the problem's step or 1e-8 is used; ``max_step`` [s] bounds
    the steps under error control, ``t_end`` [s] replaces the problem's end time. The solver stops itself after
    ``max_steps`` steps, or after ``cpu_limit`` [s] of CPU time.

    A run that fails is returned with its status and its steps; a wrong call raises ValueError, and an exception of the
    solver is passed on.
    """
    _warn_of_deviating_bits()
    variant = _resolve_problem(problem, t_end)
    controls = {"dt": dt, "rtol": rtol, "max_step": max_step, "max_steps": max_steps}
    entry, instance = _resolve_solver(solver, options, variant, list(controls))
    steps = make_step_control(entry.name, entry.control, variant, {k: v for k, v in controls.items() if v is not None})
    check_step(steps.dt if dt is not None else None, variant.t_end)
    limits: dict[str, Any] = {"cpu_limit": cpu_limit or math.inf, "memory": math.inf}
    spec = RunSpec(variant.name, entry.name, steps, dict(variant.parameters), entry.changed_options(instance), **limits)
    if cpu_limit is not None:  # compile before its clock starts
        warm_up(list_runs_to_warm([spec]))
    code, measured_by = digest_run_code(variant.name, entry.name), read_column_digests().digest
    job = Job(spec, Path(), "", code, environment.read_commit(), measured_by=measured_by)
    with threadpool_limits(1), ProgressLine() as line:
        control = dataclasses.replace(steps, cpu_limit=cpu_limit, spool=line.make_spool(variant))
        handover = solve_here(variant, instance, control)
    outcome = judge_handover(job, variant, handover)
    record, trajectory, m = dataclasses.replace(outcome.record, stderr=""), outcome.trajectory, outcome.measured
    series = None if trajectory is None or m is None else build_series(variant, trajectory, m)
    return Run(record, trajectory, series, variant)


def load(path: str | Path, problem: Problem | None = None) -> Run | Results:
    """Load the run in an NPZ file, or the runs of a results folder, given by its path or its name in ``results/local``.

    A ``problem`` that is not in the catalogue has to be passed again: the file only names it. Raise ValueError if
    ``path`` is neither.
    """
    if Path(path).suffix == ".npz":
        record, trajectory = read_run(Path(path))
        return Run(record, trajectory, given=problem)
    for folder in (Path(path), store.LOCAL / path):
        if (ConfinedPath(folder) / "runs").is_folder():
            loaded = store.load(folder, check_series=False)
            return Results(folder, tuple(Run(r, kept=folder) for r in loaded.records), loaded.unreadable)
    raise ValueError(f"{path} is neither an .npz file nor a results folder")


def scipy(method: str, **options: Any) -> Solver:
    """Return a solver of the strong form, Eq. (65), by a method of scipy: RK23, RK45, DOP853, Radau, BDF or LSODA."""
    return registry.make_solver("scipy_strong_form", {"method": method, **options})


@cache
def _warn_of_deviating_bits() -> None:
    """Warn, in the first call only, if results depend on this processor, e.g. since NumPy was loaded too early."""
    if words := machine.explain_deviations():
        remedy = ": import mbsbench before numpy and numba" if machine.list_variables() else ""
        warnings.warn(words + remedy, stacklevel=3)


def _resolve_problem(given: str | Problem, t_end: float | None) -> Problem:
    """Return the problem named ``given``, or ``given`` itself once its start is checked, ending at ``t_end`` [s]."""
    if t_end is not None and not 0.0 < t_end < math.inf:
        raise ValueError(f"t_end must be a finite number > 0 [s] (got {t_end!r})")
    changes: dict[str, Any] = {} if t_end is None else {"t_end": float(t_end)}
    if isinstance(given, str):
        return registry.make_problem(given, changes)
    if not isinstance(given, Problem):
        raise ValueError(f"problem must be a name or a Problem (got {_describe_kind(given)})")
    given.check_begin()
    check_start(given.system, given.initial, literal=given.literal_start)
    check_lengths(given.system, t_end or given.t_end)
    return dataclasses.replace(given, parameters={**given.parameters, **changes}, **changes)


def _resolve_solver(
    given: "str | Solver | type[Solver]", options: Mapping[str, Any], variant: Problem, controls: list[str]
) -> tuple[registry.SolverEntry, Solver]:
    """Return the catalogue entry and an instance of a solver; ``given`` is its name, its class or an instance.

    A class or an instance need not be in the catalogue, and an instance takes no ``options``. Raise ValueError for an
    unknown option; ``controls`` are the arguments of ``solve``, to be suggested in its place.
    """
    if not isinstance(given, str | type):
        if options:
            raise ValueError(f"give the options to {type(given).__name__}(...) (got {', '.join(options)})")
        return registry.make_entry_of_class(type(given)), given
    if isinstance(given, str):
        entry = registry.find_entry("solver", given, registry.solvers())
    else:
        entry = registry.make_entry_of_class(given)
    known = registry.problems().get(variant.name)
    for key in options:
        if known and key in known.parameters and key not in entry.parameters:
            raise ValueError(f"{key} is a parameter of the problem: make_problem({variant.name!r}, {{{key!r}: ...}})")
        if key not in entry.parameters:
            raise ValueError(
                f"solver {entry.name} has no option {key!r}{suggest_name(key, [*entry.parameters, *controls])}"
            )
    return entry, entry.make_solver(options)


def _draw_figure(drawn: list[tuple[RunRecord, Series]]) -> "Figure":
    """Draw ``PLOTTED`` as the reports do: the runs are written to a temporary results folder and read from there."""
    from .reports.model.results import read_results
    from .reports.plots.laws import draw_runs, plot_errors, plot_laws
    from .reports.plots.paper import apply_style, draw_plots
    from .reports.plots.spec import choose_styles

    with tempfile.TemporaryDirectory() as place:
        folder = store.create_folder(Path(place))
        for k, (record, series) in enumerate(drawn):
            name = f"{k}"  # one run may be given twice, e.g. before and after its solver was changed
            file = f"series/{name}.npz"
            digest = write_series(ConfinedPath(folder) / file, series)
            kept = dataclasses.replace(
                record, run_id=name, settings_id=name, series=file, series_sha256=digest, stderr=""
            )
            store.write_record(folder, kept)
        results = read_results(folder)
        runs = sorted(results.runs, key=lambda run: int(run.record.run_id))
        drawing = draw_runs(results, runs, runs)
    chapters = [c for c in (plot_laws(drawing), plot_errors(drawing)) if c]
    with apply_style():
        return draw_plots(
            [p for c in chapters for p in c.plots if p.name in PLOTTED], choose_styles({r.solver for r, _ in drawn})
        )


def _describe_motion(run: Run) -> str:
    """Name the problem with its parameters except the end time: runs that agree in this may share a plot."""
    parameters = run.record.parameters
    return format_name(run.record.problem, {k: v for k, v in parameters.items() if k != "t_end"})


def _explain_missing(record: RunRecord) -> str:
    """Explain why the run of a record has no trajectory or time histories."""
    if record.status == Status.REFUSED:
        return f"refused, {record.message}"
    return "it is a run of a results folder" if record.series else f"{record.status}, {record.message}"


def _describe_kind(given: object) -> str:
    """Name the type of a wrong argument in an error message; a function or class is to be called first."""
    return "a function: call it" if callable(given) else type(given).__name__
