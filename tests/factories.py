"""Make what tests are about: specs, records and series of known numbers, runs, and motions that must succeed."""

import hashlib
import json
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbsbench import Problem, Status, StepControl, Trajectory
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.catalogue.suites.spec import RunSpec, make_spec
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.mechanics.types import EndCause
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series
from mbsbench.harness.results.store import LoadedResults
from mbsbench.harness.run.job import Job, make_cut_short_record
from mbsbench.harness.run.measuring import measure_run
from mbsbench.harness.run.presenting import present_solver
from mbsbench.harness.run.run import store_outcome
from mbsbench.harness.run.runner import Request, SuiteObserver, run_suite
from mbsbench.harness.run.worker import solve_job

PLUGIN = Path(__file__).parent / "harness" / "misbehaving.py"
MEASURED: dict[str, Any] = {  # columns of a run of a pendulum, a number in each that pages show
    "suite": "hand made", "label": "recommended", "problem": "pendulum", "section": "Sect. 9", "paper_label": "ODE",
    "control": "dt", "dt_s": 0.01, "t_end_s": 2.0, "t_reached_s": 2.0, "claimed": "success", "energy_start_J": 1.0,
    "energy_scale_J": 1.0, "energy_drift_max_J": 1e-3, "energy_drift_end_J": 1e-4, "energy_trend_W": 1e-5,
    "energy_mean_first_quarter_J": 5e-4, "energy_mean_last_quarter_J": 5e-4, "length_scale_m": 1.0, "phi_max": 1e-3,
    "phi_dot_max": 1e-3, "eq81_max_sqrtJ": 1e-3, "orthogonality_max": 1e-15, "reference": "by hand",
    "reference_horizon_s": 10.0, "reference_own_error_m": 1e-12, "position_error_max_m": 1e-3,
    "orientation_error_max_rad": 1e-3, "steps": 299, "step_min_s": 0.005, "step_median_s": 0.006, "step_max_s": 0.007,
    "evaluations": 900.0, "repeats": 1, "cpu_min_s": 0.1, "cpu_median_s": 0.1, "cpu_max_s": 0.1, "setup_s": 0.5,
    "observable_errors": json.dumps({"theta": {"max": 1e-3, "end": 1e-4, "unit": "rad"}}), "commit": "abc",
}  # fmt: skip


def choose_control(solver: str, step: float, **limits: Any) -> StepControl:
    """Return the control of a step: ``step`` is dt [s] or rtol, whichever the solver takes."""
    return StepControl(**{make_solver(solver).control: step}, **limits)


def specify_run(
    problem: str,
    solver: str,
    parameters: Mapping[str, Any] | None = None,
    options: Mapping[str, Any] | None = None,
    **control: Any,
) -> RunSpec:
    """Return the spec of a run with this step or tolerance, as a suite has it."""
    return make_spec(make_problem(problem, parameters), solver, options, control)


def parse_specs(text: str, plugins: Sequence[Path] = ()) -> tuple[RunSpec, ...]:
    """Return the runs of a suite written in a test."""
    return parse_suite(text, "test", "test.toml", plugins=tuple(map(str, plugins))).specs


def make_record(spec: RunSpec | None = None, **columns: Any) -> RunRecord:
    """Return the record of a run, of ``spec`` if given, that got to its end, after 10 s, unless ``columns`` differ."""
    t_end = float(columns.get("t_end_s", 10.0))
    known: dict[str, Any] = {"t_end_s": t_end, "t_reached_s": t_end}
    if spec is not None:
        known |= {
            "run_id": hashlib.sha256(spec.settings_id.encode()).hexdigest()[:16],
            "settings_id": spec.settings_id,
            "case": spec.case,
            "problem": spec.problem,
            "solver": spec.solver,
            "status": "success",
            "series": "made up",
        }
    return RunRecord(**(known | columns))


def make_measured_record(run_id: str, solver: str = "alpha", status: str = "success", **columns: Any) -> RunRecord:
    """Return the record of a run of a pendulum with a number in every column that pages show."""
    settings = {"run_id": run_id, "settings_id": run_id, "case": f"pendulum {solver} {run_id}"}
    return make_record(**(MEASURED | settings | {"solver": solver, "status": status} | columns))


def make_series(
    t: Any,
    *,
    events: Sequence[Mapping[str, Any]] = (),
    bodies: Sequence[str] = (),
    joints: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
    symbols: Mapping[str, str] | None = None,
    **arrays: Any,
) -> Series:
    """Return a series over ``t`` [s] with these arrays by name; dt is that of the steps."""
    t = np.asarray(t, dtype=float)
    known = {"t": t, "dt": np.insert(np.diff(t), 0, np.nan)}
    known |= {name: a if isinstance(a, np.ndarray) else np.asarray(a, dtype=float) for name, a in arrays.items()}
    return Series(known, tuple(events), tuple(bodies), tuple(joints), units or {}, symbols or {})


def make_swing(n: int = 300, t_end: float = 2.0, size: float = 1e-3, bodies: int = 1) -> Series:
    """Return the series of a swing with an error of ``size``, and all that a series file may hold."""
    t = np.linspace(0.0, t_end, n)
    wave = np.abs(np.sin(5.0 * t)) * size
    exact = np.cos(3.0 * t)
    errors = ("energy_error", "phi_norm", "phi_dot_norm", "eq81_norm", "position_error", "orientation_error", "inv_L")
    return make_series(
        t,
        energy=1.0 + wave,
        **dict.fromkeys(errors, wave),
        orthogonality=1e-15 * np.ones(n),
        reference_own_error=1e-12 * np.ones(n),
        obs_theta=exact + wave,
        ref_theta=exact,
        end_r=np.zeros((bodies, 3)),
        bodies=[f"bar {k}" for k in range(bodies)],
        joints=["O"],
        units={"obs_theta": "rad", "ref_theta": "rad", "inv_L": "kg m2/s"},
        symbols={"obs_theta": r"\theta"},
    )


def change_series(series: Series, **arrays: Any) -> Series:
    """Return the series with other arrays."""
    return replace(series, arrays={**series.arrays, **arrays})


class Silent(SuiteObserver):
    """A watcher that remembers which runs were run."""

    def __init__(self) -> None:
        self.ran: list[str] = []
        self.set_aside: list[str] = []
        self.left: list[str] = []
        self.total = 0

    def begin(self, folder, total, waiting, unreadable):
        self.set_aside, self.total = [path.name for path in unreadable], total

    def on_end(self, job, record):
        self.ran.append(job.spec.case)

    def on_stop(self, left, limit):
        self.left = [job.spec.case for job in left]


def run_suite_text(
    folder: Path, text: str, jobs: int = 2, *, plugins=(PLUGIN,), **request
) -> tuple[LoadedResults, Silent]:
    """Run the text of a suite in a folder: what is there then, and what the watcher saw."""
    suite, watcher = parse_suite(text, "test", "test", plugins=tuple(map(str, plugins))), Silent()
    return run_suite(Request(suite, folder, jobs, **request), watcher), watcher


def run_here(job: Job) -> RunRecord:
    """Run a job in this process, without limits; store its record and return it."""
    solve_job(job)
    return store_outcome(job, measure_run(job, make_cut_short_record(job, EndCause.EXIT)))


def store_run(folder: Path, spec: RunSpec, *, lossless: bool = True) -> RunRecord:
    """Run one spec as a suite does, in a results folder; return its record."""
    return run_here(Job(spec, store.create_folder(folder), "some", "code", "commit", lossless=lossless))


def solve_run(
    problem: Problem,
    step: float,
    solver: str = "gc_weak_form",
    limits: Mapping[str, Any] | None = None,
    **options: Any,
) -> Trajectory:
    """Return a motion that must succeed and reach its end; ``step`` is dt [s] or rtol, whichever the solver takes."""
    presented = present_solver(make_solver(solver, options), problem)
    out = presented.solve(problem, choose_control(solver, step, **(limits or {})))
    assert out.status is Status.SUCCESS, out.message
    assert out.t[-1] == problem.t_end
    return out


def copy_checkout(place: Path, keeps: Callable[[str], bool]) -> Path:
    """Copy the files of the checkout whose names ``keeps``, with their byte code, to ``place``; return it."""
    listed = ("git", "ls-files", "--cached", "--others", "--exclude-standard")
    done = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("needs git and a checkout")
    for name in (n for n in done.stdout.splitlines() if keeps(n) and (ROOT / n).is_file()):
        path = ROOT / name
        to = (place / name).parent
        to.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, to)
        for code in path.parent.glob(f"__pycache__/{path.stem}.cpython-*.pyc") if path.suffix == ".py" else ():
            (to / "__pycache__").mkdir(exist_ok=True)
            shutil.copy2(code, to / "__pycache__")
    return place
