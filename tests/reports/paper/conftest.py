"""A results folder with every run that the paper's figures ask for: real problems, made-up motions and numbers."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series
from mbsbench.reports.paper.catalogue import FIGURES, PRINTED
from mbsbench.reports.paper.lines import select_runs
from mbsbench.tests.factories import make_record, make_series

from ..conftest import put

ROWS = 60


@cache
def suite() -> tuple[RunSpec, ...]:
    """The runs of the suite ``paper``."""
    return load_suite("paper").specs


def asked(*figures: str) -> list[RunSpec]:
    """The runs that these figures (all, without names) ask for."""
    wanted = [p for f in FIGURES if f.name in figures or not figures for p in f.picks]
    return list({s.settings_id: s for p in wanted for s in select_runs(p, suite())}.values())


def make_still_series(problem, t_end: float, size: float) -> Series:
    """The start, swinging by ``size`` in every observable; poses, joints and units are the problem's."""
    t = np.linspace(0.0, t_end, ROWS)
    wave = size * np.sin(7.0 * t / t_end)
    s = problem.initial
    still = States(*(np.repeat(a[None], ROWS, axis=0) for a in (s.r, s.R, s.v, s.Omega)))
    seen = problem.observe(still)
    q = Rotation.from_matrix(still.R.reshape(-1, 3, 3)).as_quat().reshape(ROWS, -1, 4)
    system = problem.system
    arrays = {
        "energy": 1.0 + wave,
        "energy_error": wave,
        "phi_norm": np.abs(wave),
        "phi_dot_norm": np.abs(wave),
        "frame_t": t,
        "frame_r": still.r,
        "frame_q": q,
        **{f"obs_{k}": a + wave for k, a in seen.items()},
        **{f"ref_{k}": a for k, a in seen.items()},
        **{n: getattr(system, n) for n in ("joint_i", "joint_j", "joint_s_i", "joint_s_j", "gravity")},
    }
    return make_series(
        t,
        **arrays,
        bodies=system.body_names,
        joints=system.joint_names,
        units={f"{p}_{o.name}": o.unit for o in problem.observables for p in ("obs", "ref")},
        symbols={f"obs_{o.name}": o.symbol for o in problem.observables},
    )


def make_numbered_record(spec: RunSpec, n: int = 1, **changes) -> RunRecord:
    """A success with the settings of ``spec`` and numbers that no other ``n`` has."""
    problem = registry.make_problem(spec.problem, dict(spec.parameters))
    nan, c = float("nan"), spec.control
    settings = {
        "paper_label": registry.read_declaration(registry.make_solver(spec.solver, spec.options))[0],
        "run_id": f"{n:016x}",
        "suite": "made up",
        "label": spec.label,
        "section": problem.section,
        "problem_parameters": json.dumps(dict(spec.parameters)),
        "solver_options": json.dumps(dict(spec.options)),
        "control": "rtol" if c.dt is None else "dt",
        "dt_s": nan if c.dt is None else c.dt,
        "rtol": nan if c.rtol is None else c.rtol,
        "max_step_s": nan if c.max_step is None else c.max_step,
        "t_end_s": problem.t_end,
        "energy_allowed_J": nan if problem.energy_allowed is None else problem.energy_allowed,
    }
    outcome = {
        "claimed": "success",
        "energy_start_J": 1.0,
        "energy_scale_J": 10.0,
        "length_scale_m": 1.0,
        "energy_drift_max_J": 1.234e-3 * n,
        "energy_drift_end_J": -5.67e-4 * n,
        "phi_max": 1e-4 * n,
        "phi_dot_max": 1e-3 * n,
        "position_error_max_m": 2.345e-3 * n,
        "orientation_error_max_rad": 3.456e-3 * n,
        "steps": ROWS - 1,
        "step_min_s": 1e-5 * n,
        "step_max_s": 1e-2 * n,
        "finished": "2026-01-01",
        "series": "",
    }
    return make_record(spec, **(settings | outcome | changes))


def fill(folder: Path, *figures: str, without=(), **changes) -> dict[str, RunRecord]:
    """Store a run for all that ``figures`` ask for; ``without`` are solvers whose printed runs are left out.

    ``changes`` are of records, by the solver whose printed runs they concern.
    """
    out = {}
    for n, spec in enumerate(asked(*figures), 1):
        printed = spec.label == PRINTED
        if printed and spec.solver in without:
            continue
        made = make_numbered_record(spec, n, **(changes.get(spec.solver, {}) if printed else {}))
        problem = registry.make_problem(spec.problem, dict(spec.parameters))
        out[made.run_id] = put(folder, made, make_still_series(problem, made.t_reached_s, 1e-3 * n))
    return out


@pytest.fixture(scope="session")
def whole(tmp_path_factory) -> tuple[Path, dict[str, RunRecord]]:
    """Every run is there."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, fill(folder)
