"""Measure requirements on the records and series of a solver's runs, one function per requirement."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...catalogue import registry
from ...catalogue.functions import describe_redundant_rows
from ...mechanics.types import RIGHT_REACTION, Problem, Status
from ...reference.computation import find_reference
from ...results.findings import Finding, judge_value, leave_open, make_failure
from ...results.records import RunRecord
from ...results.series import Series
from ...results.words import compute_reaction_error, describe_status, list_reasons, qualify_status
from ..law import STEP, TORQUE
from ..metrics.reactions import choose_instants, compute_exact_loads, compute_moments_on_bodies

SLOW = "too slow to be judged, not wrong: the run has {:g} s of CPU; look where the time goes, or for tiny steps"
CRASHED = "correct what raised the error, at the file and line given, and check again"


@dataclass(frozen=True)
class Evidence:
    """The records of a solver's runs by role, and their series."""

    control: str  # dt or rtol: what its accuracy is set by
    order: float  # order declared by the solver with default options; NaN if none
    records: Mapping[str, RunRecord]
    series: Mapping[str, Series | None]

    def select_runs(self, roles: str) -> list[RunRecord]:
        """Return the runs whose role begins with ``roles``."""
        return [r for role, r in self.records.items() if role.startswith(roles)]

    def find_setting(self, r: RunRecord) -> float:
        """Return the step dt [s] or the tolerance rtol of a run, whichever sets the accuracy."""
        return r.dt_s if self.control == "dt" else r.rtol

    @property
    def runs_with_steps(self) -> list[RunRecord]:
        """All runs for which the solver returned steps."""
        return [r for r in self.records.values() if r.claimed and r.steps]


def check_endings(e: Evidence) -> Finding:
    """Count easy runs that neither succeed nor are refused; those that a time limit ended are not counted."""
    easy = [r for r in e.select_runs("easy") if r.status != Status.UNFINISHED]
    bad = [r for r in easy if r.status not in (Status.SUCCESS, Status.REFUSED)]
    open_ = [r for r in e.select_runs("easy") if r.status == Status.UNFINISHED]
    cause = _describe_crash(bad[0]) if bad else ""
    words, remedy = _describe_first(bad or open_) or _describe_qualified(easy), CRASHED if cause else ""
    if bad and bad[0].status != Status.REFUSED and "ingular" in f"{cause} {words}":  # redundant rows are a usual cause
        remedy = "; ".join(filter(None, (describe_redundant_rows(_make_problem(bad[0])), remedy)))
    return judge_value(
        len(bad), f"of {len(easy)} runs failed", most=0, words=words, count=len(easy), remedy=remedy, cause=cause
    )


def check_accepts(e: Evidence) -> Finding:
    """Count easy runs that the solver neither refused nor crashed on; at least one is required.

    If it crashed on all that it did not refuse, the crash is the failure.
    """
    easy = e.select_runs("easy")
    refused, crashed = ([r for r in easy if r.status == s] for s in (Status.REFUSED, Status.CRASHED))
    if len(refused) + len(crashed) == len(easy) and (crash := _find_crash(crashed)):
        return crash
    taken = len(easy) - len(refused) - len(crashed)
    return judge_value(taken, f"of {len(easy)} runs taken", least=1, words=_describe_first(refused), count=len(easy))


def check_drives(e: Evidence) -> Finding:
    """Check that the motion under a drive is a success.

    Left open if the solver refuses drives, if a time limit ended the run, or if the solver fails without drives, too.
    """
    r = e.records["driven"]
    if r.status in (Status.REFUSED, Status.UNFINISHED):
        return leave_open(_describe_first([r]))
    if crash := _find_crash([r]):
        return crash
    good = r.status == Status.SUCCESS
    if not good and any(x.status not in (Status.SUCCESS, Status.REFUSED) for x in e.select_runs("easy")):
        return leave_open("it fails without drives, too: see above")
    error = r.motion_error_max_m
    words = _describe_qualified([r]) or r.case if good else _describe_first([r])
    return judge_value(error, "m off the exact motion", words=words, good=good)


def check_refusals(e: Evidence) -> Finding:
    """Count refusals whose reason has fewer than two words; left open if nothing was refused or everything crashed."""
    if all(r.status == Status.CRASHED for r in e.records.values()):
        return leave_open("all its runs crashed")
    refused = [r for r in e.records.values() if r.status == Status.REFUSED]
    if not refused:
        return leave_open("no run was refused")
    silent = [r for r in refused if len(r.message.split()) < 2]
    return judge_value(len(silent), "refusals without", most=0, words=_describe_first(silent))


def check_gyroscopic_torque(e: Evidence) -> Finding:
    """Measure c of J Omega_dot = -c Omega x J Omega [N m], by least squares on its integral over the steps.

    It is 1 if the solver has the gyroscopic torque right, and must be within ``TORQUE`` of that.
    """
    r, series = e.records["spinning"], e.series["spinning"]
    if series is None or find_missing(r):
        return find_missing(r) or make_failure("no series")
    inertia = _make_problem(r).system.inertia[0]
    Omega = np.stack([series[f"obs_Omega_{a}"] for a in "xyz"], axis=1)
    momentum = Omega @ inertia
    torque = np.cross(Omega, momentum)
    impulse = np.cumsum(0.5 * (torque[1:] + torque[:-1]) * np.diff(series["t"])[:, None], axis=0)
    share = -float(np.sum((momentum[1:] - momentum[0]) * impulse) / np.sum(impulse**2))
    return judge_value(share, "of Omega x J Omega", 1.0 - TORQUE, 1.0 + TORQUE, r.case)


def check_reaction_shape(e: Evidence) -> Finding:
    """Count the columns of reactions, which must be as many as constraint rows, and NaN at all steps or at none.

    The finding is on the first run where this fails, else on the last with reactions; left open if no run has any.
    """
    out = leave_open("no reactions")
    for role, series in e.series.items():
        if series is not None and "frame_reaction" in series and out.holds:
            r, rows = e.records[role], np.asarray(series["frame_reaction"])[1:]
            nrows, known = _make_problem(r).system.nrows, np.isfinite(rows.reshape(len(rows), -1))
            gaps = int(np.sum(np.any(known, axis=0) & ~np.all(known, axis=0)))
            words = f"{r.case}: {gaps} of them are NaN at some steps" if gaps else r.case
            out = judge_value(series["frame_reaction"][0].size, "columns", nrows, nrows, words, good=not gaps)
    return out


def check_reactions(e: Evidence) -> Finding:
    """Measure the error of joint loads on a body, relative to the largest exact ones, in the finest run."""
    r = e.select_runs("finer")[-1]
    if missing := find_missing(r):
        return missing
    error = compute_reaction_error(r)
    known = not math.isnan(error)
    words = f"off by {r.reaction_error_max_N:.3g} N of {r.reaction_size_N:.3g} N, {r.moment_error_max_Nm:.3g} N m of "
    words = f"{words}{r.moment_size_Nm:.3g} N m: {r.case}" if known else "no reactions"
    return judge_value(error, "of the largest", -math.inf, RIGHT_REACTION, words, count=int(known))


def check_moments(e: Evidence) -> Finding:
    """Measure the error of the joints' moment on a body about C, relative to the largest exact one, on a skew hinge.

    Left open without reactions, and where those of the exact motion are ill-conditioned.
    """
    r, series = e.records["easy hinge"], e.series["easy hinge"]
    if missing := find_missing(r):
        return missing
    if series is None or "frame_reaction" not in series:
        return leave_open("no reactions")
    problem = _make_problem(r)
    reference = find_reference(problem)
    assert reference is not None
    rows = choose_instants(series["frame_t"], reference.horizon)
    rows = rows[np.all(np.isfinite(series["frame_reaction"][rows]), axis=1)]  # there are none at the start
    if len(rows) == 0:
        return leave_open("no reactions of all rows")
    exact = compute_exact_loads(problem.system, reference.states(series["frame_t"][rows]))[..., 3:]
    rows, exact = (a[np.isfinite(exact).all(axis=(1, 2))] for a in (rows, exact))
    if len(rows) == 0:
        return leave_open("reactions of the exact motion are ill-conditioned")
    t = series["frame_t"][rows]
    size = float(np.max(np.linalg.norm(exact, axis=-1)))
    off = compute_moments_on_bodies(problem.system, series["frame_reaction"][rows], reference.states(t)) - exact
    worst = float(np.max(np.linalg.norm(off, axis=-1)))
    words = f"off by {worst:.3g} N m of {size:.3g} N m: {r.case}"
    return judge_value(worst / size, "of the largest", -math.inf, RIGHT_REACTION, words)


def check_recording(e: Evidence) -> Finding:
    """Measure the ratio of recorded steps to counted steps, which must be 1, in the run where it differs most."""
    shares = {r.case: r.steps / n for r in e.runs_with_steps if (n := r.counts.get("steps", 0)) > 0}
    if not shares:
        return leave_open("it has no counter named steps")
    case = max(shares, key=lambda k: abs(shares[k] - 1.0))
    return judge_value(shares[case], "of those counted", 1.0, 1.0, case)


def check_step_limit(e: Evidence) -> Finding:
    """Measure the largest ratio, over all runs, of the time between recorded steps to dt or max_step."""
    limit, column = ("dt", "dt_s") if e.control == "dt" else ("max_step", "max_step_s")
    gaps = {r.case: gap for r in e.runs_with_steps if math.isfinite(gap := r.step_max_s / getattr(r, column))}
    if not gaps:
        return leave_open("no run has steps")
    case = max(gaps, key=lambda k: gaps[k])
    return judge_value(gaps[case], f"of {limit}", most=1.0 + STEP, words=case)


def check_repeatability(e: Evidence) -> Finding:
    """Measure the largest difference between two runs with the same settings, which must be zero.

    Left open if a limit cut one of them, or if both failed alike.
    """
    (one, a), (two, b) = ((e.records[role], e.series[role]) for role in ("finer 1", "again"))
    cut = [r for r in (one, two) if r.status in (Status.STALLED, Status.UNFINISHED) or r.claimed == Status.STALLED]
    if cut:
        return leave_open(f"a limit cut {_describe_first(cut)}")
    if a is None or b is None:
        if one.status == two.status:
            return leave_open(_describe_first([two]))
        return _find_crash([two]) or make_failure(_describe_first([two]), remedy=CRASHED)
    if len(a["t"]) != len(b["t"]):
        return judge_value(abs(len(a["t"]) - len(b["t"])), "steps more", most=0)
    apart = max(float(np.max(np.abs(a[k] - b[k]))) for k in ("t", "end_r", "end_R", "end_v", "end_Omega"))
    return judge_value(apart, "apart", most=0, words="largest difference in t, r, R, v or Omega")


def make_stop_check(
    role: str, *, least: float = 0, most: float = math.inf, itself: bool = True
) -> Callable[[Evidence], Finding]:
    """Return a check that the run of this ``role`` took from ``least`` to ``most`` steps before it was stopped.

    With ``itself`` the solver must also have stopped itself: by returning ``stalled``.
    """

    def check_stop(e: Evidence) -> Finding:
        """Check the number of steps, and that the solver stopped itself; left open if it refused the run."""
        r = e.records[role]
        good = r.claimed == Status.STALLED or not itself
        if crash := _find_crash([r]):
            return crash
        return judge_value(
            r.steps, "steps", least, most, _describe_first([r]), good=good, tested=r.status != Status.REFUSED
        )

    return check_stop


def find_missing(*runs: RunRecord) -> Finding | None:
    """Return the finding for runs that did not all reach the end: a failure, or left open if all were refused.

    None if all reached it. A failure is that of the first such run; if a time limit ended one, the remedy says so.
    """
    if all(r.status == Status.REFUSED for r in runs):
        return leave_open(_describe_first(runs))
    bad = [r for r in runs if r.claimed != Status.SUCCESS]
    slow = [r for r in bad if r.status in (Status.STALLED, Status.UNFINISHED)]
    if not bad:
        return None
    return _find_crash(bad) or make_failure(
        _describe_first(bad), remedy=SLOW.format(slow[0].cpu_limit_s) if slow else ""
    )


def _find_crash(runs: Sequence[RunRecord]) -> Finding | None:
    """Return the failure of these runs if the first of them crashed, else None."""
    cause = _describe_crash(runs[0]) if runs else ""
    return make_failure(_describe_first(runs), remedy=CRASHED, cause=cause) if cause else None


def _describe_crash(r: RunRecord) -> str:
    """Return the cause of a run's crash; empty if it did not crash."""
    return f"{r.ended_by}: {'; '.join(list_reasons(r))}" if r.status == Status.CRASHED else ""


def _make_problem(r: RunRecord) -> Problem:
    """Create the problem of a record's run."""
    return registry.make_problem(r.problem, r.parameters)


def _describe_first(records: Sequence[RunRecord]) -> str:
    """Return case, status and reasons of the first record, and the number of the others; empty without records."""
    found = [f"{r.case}: {describe_status(r)}: {'; '.join(list_reasons(r))}" for r in records]
    return found[0] + (f" (and {len(found) - 1} more)" if found[1:] else "") if found else ""


def _describe_qualified(records: Sequence[RunRecord]) -> str:
    """Return the runs whose status says more than its word, such as how far they were compared; empty for none."""
    return "; ".join(f"{r.case}: {describe_status(r)}" for r in records if qualify_status(r))
