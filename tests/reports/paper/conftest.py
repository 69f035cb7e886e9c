"""A run folder with every run that the paper's figures ask for: real problems, made-up motions, own numbers."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench.harness.catalogue import registry
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series
from mbsbench.reports.paper.catalogue import FIGURES
from mbsbench.reports.paper.spec import Pick

from ..conftest import put

ROWS = 60


def picks(figures=()) -> dict[str, Pick]:
    """Those of these figures (of all), by the name of a run for each."""
    out: dict[str, Pick] = {}
    for spec in FIGURES:
        for p in spec.picks:
            if p not in out.values() and (spec.name in figures or not figures):
                out[f"{len(out):016x}"] = p
    return out


def series_for(problem, t_end: float, size: float) -> Series:
    """The start, swinging by ``size`` in every observable; poses, joints and units are the problem's."""
    t = np.linspace(0.0, t_end, ROWS)
    wave = size * np.sin(7.0 * t / t_end)
    s = problem.initial
    still = States(*(np.repeat(a[None], ROWS, axis=0) for a in (s.r, s.R, s.v, s.Omega)))
    seen = problem.observe(still)
    q = Rotation.from_matrix(still.R.reshape(-1, 3, 3)).as_quat().reshape(ROWS, -1, 4)
    system = problem.system
    arrays = {
        "t": t, "dt": np.append(np.nan, np.diff(t)), "energy": 1.0 + wave, "energy_error": wave,
        "phi_norm": np.abs(wave), "phi_dot_norm": np.abs(wave), "frame_t": t, "frame_r": still.r, "frame_q": q,
        **{f"obs_{k}": a + wave for k, a in seen.items()}, **{f"ref_{k}": a for k, a in seen.items()},
        **{n: getattr(system, n) for n in ("joint_i", "joint_j", "joint_s_i", "joint_s_j", "gravity")},
    }  # fmt: skip
    units = {f"{p}_{o.name}": o.unit for o in problem.observables for p in ("obs", "ref")}
    names = tuple(system.body_names), tuple(system.joint_names)
    return Series(arrays, (), *names, units, {f"obs_{o.name}": o.symbol for o in problem.observables})


def record_for(run: str, pick: Pick, **changes) -> RunRecord:
    """A success with the pick's settings and numbers that no other run has."""
    n = int(run, 16) + 1
    problem = registry.make_problem(pick.problem, dict(pick.parameters))
    nan = float("nan")
    base = RunRecord(
        run_id=run, settings_id=f"s{run}", case=f"case {run}", suite="made up", label="recommended",
        problem=pick.problem,
        section=problem.section, problem_parameters=json.dumps(dict(pick.parameters)), solver=pick.solver,
        solver_options=json.dumps(dict(pick.options)), control="rtol" if pick.dt is None else "dt",
        dt_s=nan if pick.dt is None else pick.dt, rtol=nan if pick.rtol is None else pick.rtol,
        max_step_s=nan if pick.max_step is None else pick.max_step, t_end_s=problem.t_end, status="success",
        claimed="success", t_reached_s=problem.t_end, energy_start_J=1.0, energy_scale_J=10.0, length_scale_m=1.0,
        energy_drift_max_J=1.234e-3 * n, energy_drift_end_J=-5.67e-4 * n, phi_max=1e-4 * n, phi_dot_max=1e-3 * n,
        position_error_max_m=2.345e-3 * n, orientation_error_max_rad=3.456e-3 * n, steps=ROWS - 1,
        step_min_s=1e-5 * n, step_max_s=1e-2 * n, finished="2026-01-01",
        energy_allowed_J=nan if problem.energy_allowed is None else problem.energy_allowed,
        observable_errors=json.dumps({o.name: {"max": 0.1 * n, "unit": o.unit} for o in problem.observables}),
    )  # fmt: skip
    return dataclasses.replace(base, **changes)


def fill(folder: Path, *figures: str, without=(), **changes_by_key) -> dict[str, RunRecord]:
    """Store a run for each pick of ``figures`` but those whose key is in ``without``; changes of records by key."""
    out = {}
    for k, (run, pick) in enumerate(picks(figures).items()):
        if pick.key in without:
            continue
        changes = changes_by_key.get(pick.key, {})
        made = record_for(run, pick, **changes)
        problem = registry.make_problem(pick.problem, dict(pick.parameters))
        out[run] = put(folder, made, series_for(problem, made.t_reached_s, 1e-3 * (k + 1)))
    return out


@pytest.fixture(scope="session")
def whole(tmp_path_factory) -> tuple[Path, dict[str, RunRecord]]:
    """Every run is there."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, fill(folder)
