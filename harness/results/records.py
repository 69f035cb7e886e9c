"""Define the record of one run: its settings, how it ended, its measurements and its cost, all that reports see.

A record is flat: every field is a column of ``runs.parquet``, with its unit at the end of its name and its meaning
here. Options, counters and invariants, which differ between problems and solvers, are JSON strings.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from ..base import files
from ..base.files import FileError
from ..base.shapes import Shape, convert_shape
from ..base.text import find_unaccepted
from ..mechanics.types import PREDICTABLE, Reason

T = TypeVar("T")

SCHEMA = 3  # raise it when a column changes its meaning or is removed; not for a new column with a default
NAN = float("nan")
ESSENTIAL = ("run_id", "case", "problem", "solver", "status")  # other columns may be newer than the file


def column(doc: str, default: Any = NAN) -> Any:
    """Return a field of the record with ``doc``, the meaning of its column, and the value of a record that lacks it."""
    return dataclasses.field(default=default, metadata={"doc": doc})


@dataclass(frozen=True, repr=False)
class RunRecord:
    """The record of a run; NaN or an empty string if a quantity does not exist, e.g. an error without a reference."""

    # settings
    run_id: str = column("content address: problem, parameters, solver, options, step or tolerance, code", "")
    settings_id: str = column("content address without the code: equal between runs of different commits", "")
    case: str = column("the settings in words, unique in a suite: 'heavy_top gc_weak_form dt=0.001'", "")
    suite: str = column("name of the suite", "")
    label: str = column("group of runs in the suite, e.g. 'recommended' or 'as printed'", "")
    problem: str = column("name in problems/", "")
    section: str = column("section of the paper", "")
    problem_parameters: str = column("JSON: those that differ from the defaults", "{}")
    problem_fingerprint: float = column("combination of all numbers of the system, its start and times")
    solver: str = column("name in solvers/", "")
    paper_label: str = column("the paper's name of such a solver", "")
    declared_order: float = column("order in dt that a solver of fixed step declares; NaN if none")
    solver_options: str = column("JSON: those that differ from the defaults", "{}")
    control: str = column("'dt' (fixed step) or 'rtol' (error control)", "")
    dt_s: float = column("fixed step asked for")
    rtol: float = column("relative tolerance asked for")
    max_step_s: float = column("largest step allowed under error control")
    max_steps: int = column("limit on accepted steps, 0 if older than this column", 0)
    t_end_s: float = column("simulated time asked for")
    cpu_limit_s: float = column("limit on the CPU time of the run")
    wall_limit_s: float = column("limit on its wall time, a safety net; in older records there was no other")
    memory_limit_MB: float = column("limit on the memory of the run's process, with all that it starts")

    # how it ended
    status: str = column("harness.mechanics.types.Status: success, inaccurate, wrong, refused, ...", "")
    claimed: str = column("the status the solver itself gave; empty if it never returned", "")
    ended_by: str = column("harness.mechanics.types.EndedBy: solver, exception, cpu_limit, signal, ...", "")
    ended_limit_s: float = column("the limit on time that ended it, with its grace period")
    message: str = column("the solver's message, or that of the exception it raised", "")
    missing_package: str = column("package that is not installed and without which the solver refused; else empty", "")
    wrong_because: str = column(
        "JSON list of harness.mechanics.types.Reason: why a claimed success is wrong or inaccurate", "[]"
    )
    notes: str = column("JSON list: notes of the solver, e.g. which redundant rows it dropped", "[]")
    events: int = column("number of events in the series file, e.g. singular passages", 0)
    t_reached_s: float = column("time of the last accepted step")
    exit_code: int = column("exit code of the run's process (of the supervisor, if that was lost)", 0)
    signal: int = column("signal that ended the process, 0 if none", 0)

    # energy: error is E(t) - E(0) minus the work of dampers, loads, user forces and drives
    energy_start_J: float = column("T + V at the start")
    energy_scale_J: float = column(
        "what the motion exchanges: its largest T, or span of V; drifts are compared with it"
    )
    energy_drift_max_J: float = column("max |energy error| over all accepted steps, less what the work leaves open")
    energy_drift_end_J: float = column("energy error at the last step, signed")
    energy_trend_W: float = column("slope of the line of least squares through the energy error [J/s]")
    energy_mean_first_quarter_J: float = column("time mean of the energy error over the first quarter of the time")
    energy_mean_last_quarter_J: float = column(
        "time mean over the last quarter: the difference of the two is secular drift"
    )
    energy_allowed_J: float = column("the benchmark's own limit on the drift, where it has one")

    # constraints
    length_scale_m: float = column(
        "reach of the motion: how far a body moves from its start; |phi| and errors are compared with it"
    )
    speed_scale_m_per_s: float = column("largest speed of a body: what |phi_dot| is compared with")
    phi_max: float = column("max |phi|: point rows in m, axis rows without unit")
    phi_end: float = column("|phi| at the last step")
    phi_limit_m: float = column(
        "limit of |phi|; NaN where |phi| as recorded is not what is judged: axis rows, mechanisms, literal start"
    )
    phi_dot_max: float = column("max |phi_dot|: m/s, axis rows 1/s")
    phi_dot_limit_m_per_s: float = column("limit of |phi_dot|; NaN where that of |phi| is")
    phi_dot_end: float = column("|phi_dot| at the last step")
    gap_share_max: float = column("max |phi| as judged (axis rows in metres) over its limit, worst mechanism")
    gap_rate_share_max: float = column("max |phi_dot| as judged over its limit, worst mechanism")
    eq81_max_sqrtJ: float = column("max sqrt(phi_dot^T M_bar phi_dot), the norm of Eq. (81)")
    eq81_end_sqrtJ: float = column("that norm at the last step")
    orthogonality_max: float = column("max |R^T R - 1|")
    kinematic_defect: float = column("share of its path by which a body's poses and velocities disagree")
    out_of_plane_max_m: float = column("max distance of any C from its plane, where the exact motion is planar")

    # against the reference, within its horizon
    reference: str = column("how the reference is computed; empty without one", "")
    reference_horizon_s: float = column("errors are taken up to here, or to t_end")
    reference_own_error_m: float = column("stated error of the reference over that time")
    compared_to_s: float = column("last step compared with the reference")
    accurate_until_s: float = column(
        "motion_error first passes a tenth of length_scale_m; compared_to_s if it never does"
    )
    accurate_until_1pct_s: float = column("time at which motion_error first passes a hundredth of length_scale_m")
    accurate_until_0p1pct_s: float = column("time at which motion_error first passes a thousandth of length_scale_m")
    motion_error_max_m: float = column("max over time and bodies of the rms distance of a body's matter from the exact")
    position_error_max_m: float = column("max over time and bodies of |r - r_exact|")
    position_error_end_m: float = column("that error at the last compared step")
    orientation_error_max_rad: float = column("max over time and bodies of the angle between R and R_exact")
    orientation_error_end_rad: float = column("that angle at the last compared step")
    velocity_error_max_m_per_s: float = column("max over time and bodies of |v - v_exact| of the C's")
    angular_velocity_error_max_rad_per_s: float = column("max over time and bodies of |Omega - Omega_exact|")
    reaction_error_max_N: float = column("max over instants and bodies of the error of the joint forces' sum on a body")
    reaction_size_N: float = column("largest such sum of the exact motion")
    moment_error_max_Nm: float = column("max over instants and bodies of the error of the joints' moment about its C")
    moment_size_Nm: float = column("largest such moment of the exact motion, or force at the farthest joint")
    judged_to_s: float = column("errors are judged up to here: beyond, the motion is chaotic")
    reference_own_error_judged_m: float = column("stated error of the reference up to there")
    motion_error_judged_m: float = column("max of the motion error up to there")
    rate_error_judged_m_per_s: float = column("max error of velocities up to there, rms over a body's matter")
    motion_between_max_m: float = column("max motion error between the steps, at times of the reference's own")
    position_error_judged_m: float = column("max of the position error up to there")
    orientation_error_judged_rad: float = column("max of the orientation error up to there")
    observable_errors: str = column("JSON: {name: {max, end, unit}} of |observable - exact|", "{}")
    invariant_drifts: str = column("JSON: {name: {max, end, start, unit}} of |invariant - its start|", "{}")

    # integrated back to the start (retrace): difference from the start, worst body
    return_error_m: float = column("distance of C from its start after integrating back; NaN if that failed, see notes")
    return_error_rad: float = column("angle of R to its start")
    return_error_m_per_s: float = column("difference of v, turned again, to its start")
    return_error_rad_per_s: float = column("difference of Omega, turned again, to its start")

    # steps and work
    steps: int = column("accepted steps", 0)
    step_min_s: float = column("smallest accepted step, the last one left out (it may be cut to end at t_end)")
    step_median_s: float = column("median accepted step")
    step_max_s: float = column("largest accepted step")
    step_ratio: float = column("largest over smallest step")
    rejected: float = column("rejected steps, NaN where the solver does not count them")
    newton_iterations: float = column("corrections of the nonlinear solver")
    evaluations: float = column("evaluations of residual or right side")
    jacobians: float = column("evaluations of the Jacobian")
    factorisations: float = column("matrix factorisations")
    counters: str = column("JSON: all counters of the solver", "{}")

    # cost
    repeats: int = column("times the solve was run and its cost counts; the motion is that of the first", 0)
    cpu_min_s: float = column(
        "CPU time of the call without set-up, least of the repeats; in a loop, of groups of them that take 0.1 ms"
    )
    cpu_q1_s: float = column("lower quartile of the repeats, of three the least; NaN if older than this column")
    cpu_median_s: float = column("median of the repeats")
    cpu_q3_s: float = column("upper quartile of the repeats, of three the largest; NaN if older than this column")
    cpu_max_s: float = column("largest of the repeats")
    cpu_call_s: float = column(
        "CPU time of the first call as a whole, with all processes that took part: set-up included, code_s left out"
    )
    setup_s: float = column("CPU time of import, refuses, set-up and compilation of the first run, not in cpu_*")
    code_s: float = column(
        "CPU time of making and loading code in the run's process, repeats included: part of cpu_process_s and, in "
        "the first call, of setup_s; no other CPU time contains it"
    )
    cpu_import_s: float = column("CPU time of importing the plugin, part of setup_s")
    cpu_refuses_s: float = column("CPU time of asking the solver whether it refuses, part of setup_s")
    cpu_process_s: float = column(
        "CPU time of the run's process and of all that it started, as the system counted it from outside"
    )
    wall_s: float = column("wall time of the whole run: process, set-up, solve, measuring")
    measure_s: float = column("wall time of measuring alone")
    peak_memory_MB: float = column(
        "largest resident memory of the process; over its limit, of all that it started, too"
    )

    # files, relative to the results folder
    series: str = column("the run's series file, empty if there is none", "")
    series_sha256: str = column("sha256 of the series file", "")
    series_rows: int = column("rows in it; fewer than steps + 1 when thinned", 0)
    stderr: str = column("what the run wrote to standard error, empty if nothing", "")

    # origin
    code: str = column("digest of what shapes its numbers: solver, problem, measuring, plugins, locked packages", "")
    commit: str = column("commit of the checkout, '+dirty' if it had changes", "")
    environment: str = column("its machine and packages: environment.<this>.json of the results folder", "")
    finished: str = column("UTC time the run ended, ISO 8601", "")
    schema: int = column("version of these columns", SCHEMA)

    def __repr__(self) -> str:
        words = f"{self.status or 'no status'}{f', {self.steps} steps' if self.steps else ''}; vars() has all columns"
        return f"<RunRecord {self.case or 'without a case'}: {words}>"


COLUMNS: tuple[dataclasses.Field, ...] = dataclasses.fields(RunRecord)
# types in JSON columns: a count, and a number that may not be finite
Counted = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1, description="a whole number of 64 bits")]
Number = float | Literal["nan", "inf", "-inf"]


class Extent(Shape, frozen=True):
    """The largest and last value of a named error or drift with its unit; of an invariant also its start."""

    max: Number = "nan"
    end: Number = "nan"
    start: Number = "nan"
    unit: str = ""


JSON_COLUMNS: Mapping[str, Any] = {  # type of the content of each column that is JSON
    "problem_parameters": dict[str, Any],
    "solver_options": dict[str, Any],
    "counters": dict[str, Counted],
    "observable_errors": dict[str, Extent],
    "invariant_drifts": dict[str, Extent],
    "notes": list[str],
}


def is_literal(record: RunRecord) -> bool:
    """Return whether the run starts exactly as printed, although that opens joints (``Problem.literal_start``)."""
    return bool(files.parse_json(record.problem_parameters, "parameters").get("literal_start"))


def find_judged_reference_error(record: RunRecord) -> float:
    """Return the reference's stated error [m] over the time in which errors are judged.

    For older records, which have only the error over all time, that is an upper bound.
    """
    known, length = record.reference_own_error_judged_m, record.length_scale_m
    if not math.isnan(known):
        return known
    return min(record.reference_own_error_m, PREDICTABLE * (length if length > 0.0 else 1.0))


def find_cpu_range(record: RunRecord) -> tuple[float, float]:
    """Return the lower and upper quartile of the repeats' CPU times [s]; for older records the extremes."""
    if math.isnan(record.cpu_q1_s):
        return record.cpu_min_s, record.cpu_max_s
    return record.cpu_q1_s, record.cpu_q3_s


def format_record(record: RunRecord) -> str:
    """Format the record as strict JSON; numbers that are not finite become ``"nan"``, ``"inf"``, ``"-inf"``."""
    return files.to_json({c.name: files.encode_nonfinite(getattr(record, c.name)) for c in COLUMNS}, indent=1)


def parse_record_json(text: str) -> RunRecord:
    """Return the record in ``text``; raise FileError if it is not JSON, foreign, of another schema, or ill-typed."""
    plain = files.parse_json(text, "record")
    if not isinstance(plain, dict) or "schema" not in plain or "run_id" not in plain:
        raise FileError("not a record of a run")
    if plain["schema"] != SCHEMA:
        raise FileError(f"schema {plain['schema']!r}, expected {SCHEMA}")
    for name in ESSENTIAL:
        if name not in plain:
            raise FileError(f"column {name} is missing")
    record = _convert(plain, RunRecord, "record")
    long = [c.name for c in COLUMNS if c.type is int and not -(2**63) <= getattr(record, c.name) < 2**63]
    if long:
        raise FileError(f"column {long[0]} holds an integer of more than 64 bits")
    for c in COLUMNS:
        if c.type is str and c.name != "message" and (found := find_unaccepted(getattr(record, c.name))):
            raise FileError(f"column {c.name} holds {found}")
    for name, kind in JSON_COLUMNS.items():
        where = f"column {name}"
        convert_shape(files.parse_json(getattr(record, name), where), kind, where)
    parse_reasons(record.wrong_because)
    return record


def format_reasons(reasons: Iterable[Reason]) -> str:
    """Format reasons as the text of the column ``wrong_because``, a JSON list."""
    return files.to_json([{k: files.encode_nonfinite(v) for k, v in vars(r).items()} for r in reasons])


def parse_reasons(wrong_because: str) -> tuple[Reason, ...]:
    """Return the reasons in the text of the column ``wrong_because``; raise FileError if it is invalid."""
    where = "column wrong_because"
    found = convert_shape(files.parse_json(wrong_because, where), list[dict[str, Any]], where)
    return tuple(_convert(plain, Reason, where) for plain in found)


def _convert(plain: Mapping[str, Any], kind: type[T], where: str) -> T:
    """Convert the values ``plain`` to the dataclass ``kind``; the texts "nan", "inf" and "-inf" become numbers.

    Raise FileError, which names ``where``, if they do not fit.
    """
    floats = {f.name for f in dataclasses.fields(kind) if f.type is float}  # type: ignore[arg-type]
    given = {k: float(v) if k in floats and v in ("nan", "inf", "-inf") else v for k, v in plain.items()}
    return convert_shape(given, kind, where)
