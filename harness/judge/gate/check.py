"""Compare records with thresholds, as the gate does; a missing, unjudged or empty run is a failure.

States, worst first: FAIL > XPASS (expected to fail, and did not) > XFAIL (expected to fail, and did) > SKIP (a package
that the caller named is not installed) > PASS. FAIL and XPASS close the gate: a threshold that no longer holds must be
corrected in the commit that changes the result. A run without its package fails, unless that package was named.
"""

import dataclasses
import datetime
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence

from msgspec.structs import replace

from ...catalogue.suites.spec import RunSpec
from ...mechanics.types import EndCause, Status
from ...results.findings import Finding, Verdict
from ...results.records import RunRecord
from ...results.store import select_newest
from ...results.words import describe_status, list_reasons, qualify_status
from .thresholds import ERRORS, ExpectedStatus, Threshold, Thresholds, propose_bounds, round_to_four_digits

CodeOf = Callable[[str, str], str]  # digest of the code for a run of a problem and a solver
STATUS, NONE = "status", "no threshold"  # names of findings that are not on a metric
WORTH = 0.95  # a bound is lowered if the new one is below this fraction of it: less is not worth a commit
UNBOUNDED = "no threshold for this run: propose one with gate --update"
TWICE = "two runs of the suite have this name, and one of them would not be judged"
NO_BOUNDS = "no threshold for this run, and none can be proposed: it was {}; fix it, or add a [[status]] entry"
UNKNOWN = "the suite has no such run"
MISSING = "no result: the run is missing"
OTHER_CODE = "result of other code, so the run is missing (--any-code accepts it)"
ABSENT = "not measured here: {}"
UNNAMED = "{}; without it, the other runs are judged with --without {}"
SMALLER = "smaller than its lower bound: better than it was, or the run does less; if meant, --update --loosen takes it"
REACHED_END = (Status.SUCCESS, Status.INACCURATE, Status.WRONG)
ROUNDED = 1e-11  # in the unit of any metric: smaller changes are rounding, which differs between machines


STATES = {
    Verdict.FAILED: "FAIL",
    Verdict.XPASS: "XPASS",
    Verdict.XFAIL: "XFAIL",
    Verdict.OPEN: "SKIP",
    Verdict.MET: "PASS",
}  # worst first
WORST = list(STATES)


def has_moved(f: Finding) -> bool:
    """Return whether a value changed by more than 1 % and more than rounding; False if it was not measured."""
    return abs(f.value - f.before) > max(0.01 * abs(f.before), ROUNDED)


def find_worst_verdict(findings: Sequence[Finding]) -> Verdict:
    """Return the worst verdict of the gate's findings, which are sorted with the worst first.

    Skipped findings do not count; FAILED if nothing was judged.
    """
    return next((f.verdict for f in findings if f.is_tested), Verdict.FAILED)


def is_open(findings: Sequence[Finding]) -> bool:
    """Return whether the gate is open: something was judged, and nothing failed or passed against expectation."""
    return find_worst_verdict(findings) in (Verdict.XFAIL, Verdict.MET)


def count_states(findings: Sequence[Finding]) -> dict[str, int]:
    """Return the number of findings in each state, the worst first."""
    return {state: sum(f.verdict is v for f in findings) for v, state in STATES.items()}


def count_cases(findings: Sequence[Finding]) -> int:
    """Return the number of cases, including those that were not measured."""
    return len({f.subject for f in findings})


def list_missing_packages(findings: Sequence[Finding]) -> dict[str, str]:
    """Return the missing package by the case that it leaves unmeasured."""
    return {f.subject: f.cause for f in findings if f.verdict is Verdict.OPEN}


def describe_gate(findings: Sequence[Finding]) -> str:
    """Return the state of the gate in words: ``open`` or ``CLOSED``, and the cases that were not measured.

    For example ``open for 28 of 30; 2 not measured here: casadi``, which names the missing packages.
    """
    word, absent = "open" if is_open(findings) else "CLOSED", list_missing_packages(findings)
    if not absent:
        return word
    cases, n = count_cases(findings), len(absent)
    share = f" for {cases - n} of {cases}" if is_open(findings) else ""
    return f"{word}{share}; {n} not measured here: {', '.join(sorted(set(absent.values())))}"


def describe_counts(findings: Sequence[Finding]) -> str:
    """Return the counts of what was judged, in words, such as ``2 FAIL, 30 PASS``."""
    counted = {state: n for state, n in count_states(findings).items() if n and state != STATES[Verdict.OPEN]}
    return ", ".join(f"{n} {state}" for state, n in counted.items()) or "nothing was judged"


def select_consequences(findings: Sequence[Finding]) -> list[Finding]:
    """Return the failed findings on metrics of runs whose status failed, too: consequences of the same cause."""
    broken = _list_failed_cases(findings)
    return [f for f in findings if f.verdict is Verdict.FAILED and _is_consequence(f, broken)]


def select_notable(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings that did not pass, and those whose value has moved; skipped ones are left out."""
    return [f for f in findings if f.verdict not in (Verdict.MET, Verdict.OPEN) or has_moved(f)]


def select_judged(records: Sequence[RunRecord], code: CodeOf | None) -> tuple[RunRecord, ...]:
    """Return the newest record of each run: of those made by the present code, or of all if ``code`` is None."""
    return select_newest(tuple(r for r in records if code is None or code(r.problem, r.solver) == r.code))


def describe_contradiction(record: RunRecord) -> str:
    """Describe the contradiction in a record; empty if there is none.

    It contradicts itself if its status is lawful though the solver did not claim success or something else ended the
    run, and if it ended in the future.
    """
    claimed, by = record.claimed or "nothing", record.ended_by
    if Status(record.status).lawful and (claimed, by) != (Status.SUCCESS, EndCause.SOLVER):
        return f"{record.status}, though its solver claimed {claimed} and {by} ended it"
    latest = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=1)
    late = record.finished > latest.strftime("%Y-%m-%dT%H:%M:%SZ")
    return f"finished at {record.finished}, which is to come" if late else ""


def judge_runs(
    specs: Sequence[RunSpec | RunRecord],
    records: Sequence[RunRecord],
    thresholds: Thresholds,
    code: CodeOf | None = None,
    without: Collection[str] = (),
) -> tuple[Finding, ...]:
    """Judge the status and all thresholds of every run; return the findings, the worst first, causes before effects.

    ``specs`` are the runs of the suite, ``records`` the results. A run without a threshold, a threshold without a run
    and two runs of one name fail. With ``code``, a result of other code counts as missing; of several results of a run
    the newest is judged. A run that was refused because a package is not installed is skipped if the package is in
    ``without``, with the package as the finding's cause, and fails otherwise.
    """
    by_settings = {r.settings_id: r for r in select_judged(records, code)}
    other = {r.settings_id for r in records} - {*by_settings}
    found: list[Finding] = []
    by_case = {c.case: by_settings.get(c.settings_id) for c in specs}
    missing = {c.case: OTHER_CODE if c.settings_id in other else MISSING for c in specs}
    found += [
        _make_finding(Verdict.FAILED, c, STATUS, TWICE) for c, n in Counter(c.case for c in specs).items() if n > 1
    ]
    bounded: dict[str, set[str]] = {}
    for b in thresholds.bounds:
        bounded.setdefault(b.case, set()).add(b.metric)
    statuses = {e.case: e for e in thresholds.statuses}
    absent: set[str] = set()
    for case, record in by_case.items():
        if record is not None and record.status == Status.REFUSED and (package := record.missing_package):
            absent.add(case)
            words = record.message if package in without else UNNAMED.format(record.message, package)
            verdict = Verdict.OPEN if package in without else Verdict.FAILED
            skipped = _make_finding(verdict, case, STATUS, ABSENT.format(words))
            found.append(dataclasses.replace(skipped, cause=package if verdict is Verdict.OPEN else ""))
            continue
        found.append(_judge_status(case, record, statuses.get(case), missing[case]))
        wanted = statuses[case].status if case in statuses else Status.SUCCESS
        if case not in bounded and wanted is Status.SUCCESS:
            ended = record.status if record else Status.SUCCESS
            words = UNBOUNDED if ended == Status.SUCCESS else NO_BOUNDS.format(ended)
            found.append(_make_finding(Verdict.FAILED, case, NONE, words))
        elif case in bounded and record is not None:
            needed = {b.metric for b in propose_bounds([record])} - bounded[case]
            found += [_make_finding(Verdict.FAILED, case, metric, UNBOUNDED) for metric in sorted(needed)]
    judged = [b for b in thresholds.bounds if b.case not in absent]
    found += [_judge_bound(b, by_case.get(b.case), missing.get(b.case, UNKNOWN)) for b in judged]
    found += [_make_finding(Verdict.FAILED, case, STATUS, UNKNOWN) for case in statuses if case not in by_case]
    broken = _list_failed_cases(found)
    cut = {case for case, r in by_case.items() if r and case in broken and Status(r.status) not in REACHED_END}
    # a run that was cut short meets bounds by its zeros
    found = [f for f in found if not (f.subject in cut and f.verdict is Verdict.MET)]

    def make_sort_key(f: Finding) -> tuple[int, bool, bool, str, str]:
        """Return the sort key of a finding: the worst first, causes before consequences."""
        metric = f.quantity
        return WORST.index(f.verdict), _is_consequence(f, broken), metric != STATUS, f.subject, metric

    return tuple(sorted(found, key=make_sort_key))


def _list_failed_cases(findings: Iterable[Finding]) -> set[str]:
    """Return the cases whose status does not hold, as a set."""
    return {f.subject for f in findings if f.quantity == STATUS and not f.holds}


def _is_consequence(f: Finding, broken: Collection[str]) -> bool:
    """Return whether a finding is on a metric of a run whose status failed; ``broken`` are the cases of such runs."""
    return f.subject in broken and f.quantity not in (STATUS, NONE)


def tighten_bounds(
    old: Thresholds, records: Sequence[RunRecord], proposed: Sequence[Threshold], *, loosen: bool
) -> Thresholds:
    """Return ``old`` with the bounds that ``proposed`` adds or tightens and, with ``loosen``, those that it widens.

    ``records`` are the runs that the bounds are proposed from; with ``loosen``, bounds of cases without a record are
    dropped. A threshold with a tolerance, or around several runs, changes only with ``loosen``.
    """
    cases = {r.case for r in records}
    bounds = {(b.case, b.metric): b for b in old.bounds if b.case in cases or not loosen}
    for new in proposed:
        was = bounds.get((new.case, new.metric))
        if was is None:
            bounds[new.case, new.metric] = new
        elif {new.tolerance, was.tolerance} != {None}:  # another value is neither better nor worse: only on request
            if loosen:
                bounds[new.case, new.metric] = replace(new, reason=was.reason, expect=was.expect)
        elif was.samples > 1:  # bounds around many runs, which a single run moves only on request
            if loosen:
                bounds[new.case, new.metric] = replace(new, expect=was.expect)
        elif (changed := _move_bounds(was, new, loosen=loosen)) is not None:
            bounds[new.case, new.metric] = changed
    return replace(old, bounds=tuple(bounds[k] for k in sorted(bounds)))


def _move_bounds(was: Threshold, new: Threshold, *, loosen: bool) -> Threshold | None:
    """Return the threshold ``was`` with its value and bounds moved to those of ``new``; None if it stays as it is.

    The upper bound keeps its ratio to the value if that is wider than in ``new``, and rises only with ``loosen``; none
    is added where ``was`` has none. A lower bound is added where ``was`` has none; it falls only with ``loosen``, if
    the new value is below it. A change that lowers the upper bound by less than 5 % is not made, except with ``loosen``
    or if the lower bound rises.
    """
    fallen = new.value < was.lower
    lower = was.lower if was.lower > -math.inf else new.lower
    if fallen and loosen:
        lower = min(new.value, new.lower) if new.lower > -math.inf else new.value
    if was.upper == math.inf:
        return replace(was, value=new.value, lower=lower) if lower < was.lower else None
    wide = new.value * was.upper / was.value if was.value > 0.0 else 0.0
    upper = (
        round_to_four_digits(wide) if wide > 1.001 * new.upper else new.upper
    )  # a width with a reason of its own stays
    if not loosen:
        upper = min(upper, was.upper)
    if upper < lower or not (loosen or upper < WORTH * was.upper or lower > was.lower):
        return None
    return replace(was, value=new.value, upper=upper, lower=lower)


def _make_finding(verdict: Verdict, case: str, metric: str, why: str = "", bound: str = "") -> Finding:
    """Return a finding without a number on a metric of a case.

    ``bound`` is what was required, in words, and ``why`` the reason of the verdict.
    """
    return Finding(metric, required=bound, verdict=verdict, subject=case, why=why)


def _judge_status(case: str, record: RunRecord | None, expected: ExpectedStatus | None, missing: str) -> Finding:
    """Return the finding on the status of a case, which must be the expected one or, without an entry, success.

    ``missing`` is the reason stated if the case has no record.
    """
    wanted = expected.status if expected else Status.SUCCESS
    if record is None:
        return _make_finding(Verdict.FAILED, case, STATUS, missing)
    if record.status == wanted:
        verdict = Verdict.MET if wanted is Status.SUCCESS else Verdict.XFAIL
        why = "; ".join(filter(None, (expected.reason if expected else "", qualify_status(record))))
        return _make_finding(verdict, case, STATUS, why, str(wanted))
    words = f"{describe_status(record)}, expected {wanted}: {'; '.join(list_reasons(record))}"
    verdict = Verdict.XPASS if record.status == Status.SUCCESS else Verdict.FAILED
    return _make_finding(verdict, case, STATUS, words, str(wanted))


def _judge_bound(b: Threshold, record: RunRecord | None, missing: str) -> Finding:
    """Return the finding on one threshold; ``missing`` is the reason stated if its case has no record.

    A metric that was not measured fails. A known breach (``expect = "fail"``) is XFAIL while it lasts, then XPASS.
    """
    value = math.nan if record is None else float(getattr(record, b.metric))
    words, verdict = b.reason, Verdict.from_outcome(b.holds(value))
    if math.isnan(value):
        words, verdict = missing if record is None else f"not measured: the run was {record.status}", Verdict.FAILED
    elif value < b.lower and b.metric in ERRORS:
        words = f"{SMALLER}; {b.reason}"
    if b.expect == "fail" and not math.isnan(value):
        verdict = Verdict.XPASS if b.holds(value) else Verdict.XFAIL
    bound = _describe_range(b)
    return Finding(b.metric, value, b.unit, required=bound, verdict=verdict, subject=b.case, why=words, before=b.value)


def _describe_range(b: Threshold) -> str:
    """Return a bound in words, such as ``>= 1 and <= 2`` or ``= 100 exactly``."""
    if b.tolerance is not None:
        return f"= {b.value:.12g}" + (f" within {b.tolerance:g} of it" if b.tolerance else " exactly")
    low = f">= {b.lower:.3g}" if math.isfinite(b.lower) else ""
    high = f"<= {b.upper:.3g}" if math.isfinite(b.upper) else ""
    return " and ".join(filter(None, (low, high)))
