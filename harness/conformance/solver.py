"""Solver requirements: the runs, what their records must show, why, and what to do where they do not.

The runs run in processes of their own like any others, so a solver that hangs or crashes here costs its own claim.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..catalogue import registry
from ..results import store
from ..results.records import RunRecord
from ..results.series import Series
from ..results.words import why
from ..suites.spec import RunSpec, make_spec
from ..suites.suite import Suite
from ..types import Status
from .claims import Claim, Finding

BASE = "spherical_pendulum"
MOVING = {"omega_z": 3.0, "t_end": 1.0}  # spatial and loaded: every term of the equations counts
STEPS = (0.02, 0.01, 0.005, 0.0025)
TOLERANCES = (1e-4, 1e-6, 1e-8)
WALL = 20.0  # [s] a run
SHORT_WALL = 2.0  # [s] for the run that must stop itself
LEAST_ORDER = 0.8  # a first-order scheme may show a little less
LEAST_GAIN = 10.0  # in error, from the loosest to the tightest tolerance, ten thousand times apart
ROUNDED = 1e-11  # [m] no order can be seen below

FITS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "motion": ("torque_free_body", {"t_end": 2.0}),
    "pendulum": (BASE, {"omega_z": 0.1, "t_end": 1.0}),
    "top": ("heavy_top", {"t_end": 0.2}),
    "turned": (BASE, {"omega_z": 0.1, "t_end": 1.0, "rotation": (0.3, -0.5, 0.7)}),
    "revolute": ("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.2}),
}


@dataclass(frozen=True)
class Evidence:
    """The records of a solver's runs by role, and their series."""

    control: str
    records: Mapping[str, RunRecord]
    series: Mapping[str, Series | None]


def runs_of(solver: str) -> dict[str, RunSpec]:
    """The runs of the contract by role."""
    control = registry.solvers()[solver].control
    values = STEPS if control == "dt" else TOLERANCES
    out = {role: _run(solver, name, parameters) for role, (name, parameters) in FITS.items()}
    out |= {f"finer {k}": _run(solver, BASE, MOVING, {control: value}) for k, value in enumerate(values)}
    middle = {control: values[1]}
    out["again"] = _run(solver, BASE, {**MOVING, "seed": 1}, middle)  # another run, the same motion: perturb is 0
    out["few steps"] = _run(solver, BASE, MOVING, {**middle, "max_steps": 3})
    endless = {"dt": 1e-4} if control == "dt" else {"rtol": 1e-8, "max_step": 1e-4}
    out["endless"] = _run(solver, BASE, {"omega_z": 3.0, "t_end": 1000.0}, endless, wall_limit=SHORT_WALL)
    return out


def suite_of(solver: str, plugins: tuple[str, ...]) -> Suite:
    """The runs as a suite."""
    return Suite(f"contract-{solver}", "solver requirements", tuple(runs_of(solver).values()), "", plugins)


def judged(solver: str, folder: Path, records: tuple[RunRecord, ...]) -> list[Finding]:
    """Every claim, with what was found."""
    by_settings = {r.settings_id: r for r in records}
    mine = {role: by_settings[spec.settings_id] for role, spec in runs_of(solver).items()}
    series = {role: store.series_of(folder, r) for role, r in mine.items()}
    evidence = Evidence(registry.solvers()[solver].control, mine, series)
    return [claim.finding(solver, claim.holds(evidence)) for claim in CLAIMS]


def _run(
    solver: str, problem: str, parameters: Mapping[str, Any], control: Mapping[str, Any] | None = None, **limits: float
) -> RunSpec:
    made = registry.make_problem(problem, parameters)
    return make_spec(made, solver, None, control, **{"wall_limit": WALL, **limits})


def _ends_well(e: Evidence) -> str | None:
    return _first(e.records[role] for role in FITS if e.records[role].status not in (Status.SUCCESS, Status.REFUSED))


def _takes_one(e: Evidence) -> str | None:
    refused = [e.records[role] for role in FITS if e.records[role].status == Status.REFUSED]
    return _first(refused) if len(refused) == len(FITS) else None


def _reasons(e: Evidence) -> str | None:
    return _first(r for r in e.records.values() if r.status == Status.REFUSED and len(r.message.split()) < 2)


def _converges(e: Evidence) -> str | None:
    runs = [e.records[role] for role in e.records if role.startswith("finer")]
    if all(r.status == Status.REFUSED for r in runs):
        return None
    if bad := [r for r in runs[1:] if r.status != Status.SUCCESS]:
        return _first(bad)
    errors = np.array([r.position_error_max_m for r in runs])
    listed = ", ".join(f"{x:.3g}" for x in errors)
    if errors[-1] < ROUNDED:
        return None
    if e.control == "dt":
        order = math.log2(errors[-2] / errors[-1])
        return None if order > LEAST_ORDER else f"errors {listed} m at dt {STEPS} s: order {order:.2f} at the end"
    return None if errors[0] > LEAST_GAIN * errors[-1] else f"errors {listed} m at rtol {TOLERANCES}"


def _repeats(e: Evidence) -> str | None:
    a, b = e.series["finer 1"], e.series["again"]
    if a is None or b is None:
        return None if e.records["finer 1"].status == e.records["again"].status else _first([e.records["again"]])
    same = all(np.array_equal(a[k], b[k]) for k in ("t", "end_r", "end_R", "end_v", "end_Omega"))
    return None if same else f"{len(a['t'])} and {len(b['t'])} steps, or other numbers in them"


def _stops(role: str) -> Callable[[Evidence], str | None]:
    def holds(e: Evidence) -> str | None:
        r = e.records[role]
        if r.status == Status.REFUSED:
            return None
        good = r.claimed == Status.STALLED and (role != "few steps" or r.steps <= 3)
        return None if good else f"{r.steps} steps; " + (_first([r]) or "")

    return holds


def _keeps_steps(e: Evidence) -> str | None:
    r = e.records["endless"]
    return None if r.status == Status.REFUSED or r.steps > 0 else _first([r])


def _reaction_fits(e: Evidence) -> str | None:
    for role, series in e.series.items():
        if series is not None and "frame_reaction" in series:
            r = e.records[role]
            nrows = registry.make_problem(r.problem, json.loads(r.problem_parameters)).system.nrows
            shape = series["frame_reaction"].shape
            if shape != (len(series["frame_t"]), nrows):
                return f"{r.case}: (nt, nrows) is ({len(series['frame_t'])}, {nrows}), got {shape}"
    return None


def _first(records: Iterable[RunRecord]) -> str | None:
    found = [f"{r.case}: {r.status}: {'; '.join(why(r))}" for r in records]
    return found[0] + (f" (and {len(found) - 1} more)" if found[1:] else "") if found else None


CLAIMS = (
    Claim("it succeeds or refuses",
        "easy problems with exact references: a success is checked against energy, constraints and the exact motion",
        "see the reason given; `mbsbench solve` on that case shows its numbers and standard error", _ends_well),
    Claim("it solves a problem", "a solver that refuses every problem cannot be tested", "see refuses()", _takes_one),
    Claim("a refusal has a reason", "tables print it instead of numbers",
        "let refuses() return a sentence with the numbers, or None", _reasons),
    Claim("smaller steps or tolerances give smaller errors", "a scheme that does not converge solves another equation",
        "compare the equations term by term: a missing term or wrong sign leaves an error that stays", _converges),
    Claim("the same run gives the same numbers", "results are compared bit for bit between runs",
        "seed what is random; keep no state between calls: options are frozen, buffers belong to one call", _repeats),
    Claim("max_steps stops it", "a run that cannot be limited cannot be put in a suite",
        "count accepted steps; at control.max_steps return Status.STALLED with the steps so far", _stops("few steps")),
    Claim("it stops itself at the wall limit",
        f"it is asked to stop at {0.9 * SHORT_WALL:g} s; what is killed loses its counters and its last steps",
        "check time.monotonic() every step; past control.wall_limit return Status.STALLED with the steps so far",
        _stops("endless")),
    Claim("steps are kept when it is stopped", "a failure is a result: the motion up to it is measured and drawn",
        "return the accepted steps with the failure's status, or hand them to control.spool as they come",
        _keeps_steps),
    Claim("reactions have one column per constraint row", "they are compared between solvers row by row",
        "return reaction of shape (nt, system.nrows), NaN for rows without one, or None", _reaction_fits),
)  # fmt: skip
