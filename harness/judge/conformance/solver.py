"""Test solver requirements: the runs, what their records must show, why, and remedies.

The runs are in processes of their own like all others, so that a solver that hangs or crashes fails its requirement.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...catalogue import registry
from ...catalogue.suites.spec import RunSpec, make_spec
from ...catalogue.suites.suite import Suite
from ...results import store
from ...results.findings import Finding
from ...results.records import RunRecord
from . import ladders, trials
from .requirements import Requirement, assign_findings

BASE = "spherical_pendulum"
MOVING = {"omega_x": 5.0, "omega_z": 3.0, "t_end": 1.0}  # spatial, loaded and spinning, so that every term matters
SPINNING = {"inertia_factors": (1.0, 2.0, 3.0), "omega": (0.3, 3.0, 0.2), "t_end": 2.0}  # tumbles by gyroscopic torque
STEPS = (0.04, 0.02, 0.01, 0.005)
TOLERANCES = (1e-4, 1e-6, 1e-8)
COARSER = {"dt": (4.0, 2.0), "rtol": (1e4,)}  # factors on the step or tolerance of the easy hinge
LARGEST_STEP = 0.01  # [s] step of the spinning body: integrals over its steps are accurate to (rate step)^2/12 = 1e-4
LIMIT = 20.0  # [s] CPU time per run
SHORT = 2.0  # [s] CPU time of the run that must stop itself
MAX_STEPS = 3  # limit of the run that must stop at it

EASY: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "easy motion": ("torque_free_body", {"t_end": 2.0}),
    "easy pendulum": (BASE, {"omega_z": 0.1, "t_end": 1.0}),
    "easy top": ("heavy_top", {"t_end": 0.2}),
    "easy turned": (BASE, {"omega_z": 0.1, "t_end": 1.0, "rotation": (0.3, -0.5, 0.7)}),
    "easy revolute": ("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.2}),
    # on a skew hinge, whose axis rows carry moments, unlike those of a planar mechanism
    "easy hinge": ("random_mechanism", {"bodies": 1, "loops": 0, "springs": 0, "loads": 0, "t_end": 0.5}),
}
DRIVEN = {"t_end": 1.0}  # [s] of ``pumped_pendulum``: a whole period of its drive


def group_runs(solver: str) -> dict[str, RunSpec]:
    """Return the runs that the requirements need, by role, such as ``easy top``.

    ``finer 0`` to ``finer 3`` are a ladder of steps or tolerances, the coarsest first. ``check_solver`` finds the
    record of each role by these runs.
    """
    control = registry.solvers()[solver].control
    fixed = control == "dt"
    values = STEPS if fixed else TOLERANCES
    out = {role: _run(solver, name, parameters) for role, (name, parameters) in EASY.items()}
    out["driven"] = _run(solver, "pumped_pendulum", DRIVEN)
    out |= {f"finer {k}": _run(solver, BASE, MOVING, {control: value}) for k, value in enumerate(values)}
    hinge, swept = EASY["easy hinge"]
    finest = getattr(out["easy hinge"].control, control)  # the ladder's last run, which there is
    out |= {f"hinge {k}": _run(solver, hinge, swept, {control: c * finest}) for k, c in enumerate(COARSER[control])}
    middle = {control: values[1]}
    # another run with the same motion, since perturb is 0
    out["again"] = _run(solver, BASE, {**MOVING, "seed": 1}, middle)
    out["few steps"] = _run(solver, BASE, MOVING, {**middle, "max_steps": MAX_STEPS})
    small = {"dt": LARGEST_STEP} if fixed else {"rtol": 1e-8, "max_step": LARGEST_STEP}
    out["spinning"] = _run(solver, "torque_free_body", SPINNING, small)
    endless = {"dt": 1e-4} if fixed else {"rtol": 1e-8, "max_step": 1e-4}
    out["endless"] = _run(solver, BASE, {"omega_z": 3.0, "t_end": 1000.0}, endless, cpu_limit=SHORT)
    return out


def make_suite(solver: str, plugins: tuple[str, ...]) -> Suite:
    """Return the runs of all roles as a suite."""
    return Suite(f"check-{solver}", "solver requirements", tuple(group_runs(solver).values()), "", plugins)


def check_solver(solver: str, folder: Path, records: tuple[RunRecord, ...]) -> list[Finding]:
    """Return a finding for every requirement on the solver, from the records and series of its runs.

    ``records`` has one for each run of ``group_runs``; their series are read from ``folder``.
    """
    by_settings = {r.settings_id: r for r in records}
    mine = {role: by_settings[spec.settings_id] for role, spec in group_runs(solver).items()}
    series = {role: store.read_run_series(folder, r) for role, r in mine.items()}
    entry = registry.solvers()[solver]
    evidence = trials.Evidence(entry.control, float(getattr(entry.make_solver(), "order", math.nan)), mine, series)
    return assign_findings(solver, REQUIREMENTS, (requirement.measure(evidence) for requirement in REQUIREMENTS))


def _run(
    solver: str, problem: str, parameters: Mapping[str, Any], control: Mapping[str, Any] | None = None, **limits: float
) -> RunSpec:
    """Return a run of the solver on a problem, with the step or tolerance in ``control``, else the default one.

    ``limits`` replace the default limit on CPU time, ``cpu_limit`` [s].
    """
    made = registry.make_problem(problem, parameters)
    return make_spec(made, solver, None, control, **{"cpu_limit": LIMIT, **limits})


REQUIREMENTS = (
    Requirement(
        "it succeeds or refuses",
        "easy problems with exact references: a success is checked against energy, constraints and the exact motion",
        "see the reason given; `mbsbench solve` on that case shows its numbers and standard error",
        trials.check_endings,
    ),
    Requirement(
        "it solves a problem",
        "a solver that refuses every problem cannot be tested",
        "see refuses()",
        trials.check_accepts,
    ),
    Requirement(
        "a refusal has a reason",
        "tables print it instead of numbers",
        "let refuses() return a sentence with the numbers, or None",
        trials.check_refusals,
    ),
    Requirement(
        "it follows drives in time",
        "drives and loads are functions of time: a state without its time follows those of t = 0",
        "pass the time on: State(r, R, v, Omega, t), at stages and iterates, too; or refuse moving constraints",
        trials.check_drives,
    ),
    Requirement(
        "errors fall with the declared order, or with rtol",
        "a scheme that does not converge solves another equation; reports compare runs with the declared order",
        "nearly 0: a missing term or wrong sign leaves an error that stays; lower: look for a stage or projection of "
        "lower order, or declare the order observed",
        ladders.check_order,
    ),
    Requirement(
        "open joints close with the steps, or with rtol",
        "joints that open at one rate whatever the step are hidden by larger errors of the motion, and remain when "
        "those are gone",
        "look for what moves r or R apart from v and Omega, or adds to these: a shift of the states that are returned, "
        "an arm or axis that is off, rotations that are not normalised",
        ladders.check_residuals,
    ),
    Requirement(
        "gyroscopic torque is Omega x J Omega",
        "three unequal inertias, spun about the middle one: this torque alone moves the body",
        "check Omega x J Omega in Euler's equations: J about C and Omega in the body frame, one factor, its sign",
        trials.check_gyroscopic_torque,
    ),
    Requirement(
        "reactions have one column per constraint row",
        "they are compared between solvers row by row",
        "return reaction of shape (nt, system.nrows), NaN for rows without one and at the start, or None",
        trials.check_reaction_shape,
    ),
    Requirement(
        "reactions are those of the exact motion",
        "joint forces follow from m (a_C - g), whatever the solver",
        "A^T reaction is the force of the joints on the bodies: mind the sign, and the dt of a multiplier's impulse",
        trials.check_reactions,
    ),
    Requirement(
        "errors of reactions fall with the steps, or with rtol",
        "a reaction of the step's beginning, or of another stage, is of first order: joint forces are late by a step",
        "return the reaction that belongs to the state at the end of the step",
        ladders.check_reaction_order,
    ),
    Requirement(
        "moments of its reactions are those of the exact motion",
        "moments about C follow from J Omega' + Omega x J Omega: axis rows carry them [N m], point rows by their arms",
        "A^T reaction again: mind sign and unit of the rows of directions",
        trials.check_moments,
    ),
    Requirement(
        "it records every step it counts",
        "drift, errors and step sizes are taken over all accepted steps",
        "append every accepted step to t and states, and count those in counters['steps']",
        trials.check_recording,
    ),
    Requirement(
        "steps are no larger than dt or max_step",
        "a larger gap means steps left out, or a limit not kept",
        "record every accepted step; cut the step at control.dt or control.max_step",
        trials.check_step_limit,
    ),
    Requirement(
        "the same run gives the same numbers",
        "results are compared bit for bit between runs",
        "seed what is random; keep no state between calls: options are frozen, buffers belong to one call",
        trials.check_repeatability,
    ),
    Requirement(
        "max_steps stops it",
        "a run that cannot be limited cannot be put in a suite",
        "count accepted steps; at control.max_steps return Status.STALLED with the steps so far",
        trials.make_stop_check("few steps", most=MAX_STEPS),
    ),
    Requirement(
        "it stops itself at the limit on CPU time",
        f"it is asked to stop at {0.9 * SHORT:g} s; what is killed loses its counters and its last steps",
        "check time.process_time() every step; past control.cpu_limit return Status.STALLED with the steps so far",
        trials.make_stop_check("endless"),
    ),
    Requirement(
        "steps are kept when it is stopped",
        "a failure is a result: the motion up to it is measured and drawn",
        "return the accepted steps with the failure's status, or hand them to control.spool as they come",
        trials.make_stop_check("endless", least=1, itself=False),
    ),
)
