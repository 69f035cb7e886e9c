"""Plan the runs of ``try`` for a solver, and derive the findings on their results."""

import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...base.code_meter import code_seconds_of_tree
from ...catalogue import registry
from ...catalogue.suites.spec import RunSpec
from ...catalogue.trial import make_problem
from ...mechanics.types import RIGHT_REACTION, Status, Trait
from ...results.findings import Finding, leave_undetermined, state_finding
from ...results.judgements.runs import Order
from ...results.least_cost import find_cheapest
from ...results.records import RunRecord
from ...results.words import compute_reaction_error, describe_status, format_accurate_times, list_reasons
from ...results.work import count_index_1_evaluations
from ..cost import judge_growth
from ..referee.certificates.drift import PERIODS, analyse_drift
from ..referee.certificates.orders import certify_orders
from .presentations import LOOP, TREE, assess_symmetries, make_trial_run, plan_symmetries

QUANTITIES = ("position", "orientation", "energy", "reaction")
ENDED = (Status.SUCCESS, Status.INACCURATE, Status.WRONG)
ABREAST = 6  # problems between two checks of the budget
STEPS = 100  # number of default steps run on each problem
LADDERS: Mapping[str, Mapping[str, Any]] = {  # spatial, loaded and spinning, so that every term matters
    "spherical_pendulum": {"omega_x": 5.0, "omega_z": 3.0, "t_end": 1.0},
    "heavy_top": {"t_end": 0.2},
}
VALUES = {
    ("spherical_pendulum", "dt"): 0.04 * 0.5 ** np.arange(6),
    ("heavy_top", "dt"): 0.004 * 0.5 ** np.arange(5),
    ("spherical_pendulum", "rtol"): 10.0 ** -np.arange(3.0, 10.0),
    ("heavy_top", "rtol"): 10.0 ** -np.arange(3.0, 10.0),
}
# solvers compared with, whose kernels are compiled in a minute
FIELD = ("rkmk_dopri5", "ida_index1", "scipy_strong_form")
LINKS = (6, 12, 24, 48)
SWING = {"omega_z": 0.1}
PERIOD = 0.97  # [s] period of that swing
LONGEST = 300.0 * PERIOD
LONG = {"dt": 0.01, "rtol": 1e-6}
CLOCK = 5e-3  # [s] shorter runs say nothing about cost


Run = TypeVar("Run", RunRecord, RunSpec)


def plan_runs(solver: str, cpu_limit: float) -> list[RunSpec]:
    """Return all runs but the long one, each of at most ``cpu_limit`` [s] of CPU time.

    They are ladders, symmetries and chains, then the problems.
    """
    out = []
    for who in (solver, *FIELD):
        for name, parameters in LADDERS.items():
            kind = registry.solvers()[who].control
            values = VALUES[name, kind] if who == solver else VALUES[name, kind][1::2]
            out += [
                make_trial_run(who, name, parameters, {kind: float(f"{x:.6g}")}, "ladder", cpu_limit) for x in values
            ]
    out += plan_symmetries(solver, "four_bar_grid", LOOP, cpu_limit)
    for links in LINKS:
        out.append(make_trial_run(solver, "chain", {"links": links, "t_end": 0.02}, {}, "growth", cpu_limit))
    for name in registry.problems():
        own = make_problem(name)
        out.append(make_trial_run(solver, name, {"t_end": min(own.t_end, STEPS * own.dt)}, {}, "problems", cpu_limit))
    return list({s.settings_id: s for s in out}.values())


def plan_stages(solver: str, specs: Sequence[RunSpec]) -> list[list[RunSpec]]:
    """Return the stages in order: own ladders, symmetries and growth, ladders of other solvers, groups of problems."""
    own = [s for s in specs if s.solver == solver and s.label != "problems"]
    problems = [s for s in specs if s.label == "problems"]
    first = [s for s in own if s.label == "ladder"]
    field = [s for s in specs if s.solver != solver]
    rest = [problems[k : k + ABREAST] for k in range(0, len(problems), ABREAST)]
    return [stage for stage in (first, [s for s in own if s.label != "ladder"], field, *rest) if stage]


def run_stages(
    solver: str, budget: float, run_stage: Callable[[Sequence[RunSpec], float, bool], Sequence[RunRecord] | None]
) -> list[RunSpec]:
    """Run stages until ``budget`` [s] of CPU time is spent; return all runs that were planned.

    ``run_stage`` takes all runs of this stage and those before, the CPU time left [s], and whether some are done; it
    returns their records, or None if cut short, which ends all. Symmetries of a tree are added if those of the loop are
    refused, and a long run once symmetries are known.
    """
    begun = _cpu_seconds()
    specs = plan_runs(solver, cpu_limit=min(20.0, budget / 6.0))
    stages, done, long, on_tree = plan_stages(solver, specs), list[RunSpec](), False, False
    while stages and (not done or _cpu_seconds() - begun < budget):
        resume = bool(done)
        done += stages.pop(0)
        records = run_stage(done, budget - (_cpu_seconds() - begun), resume)
        if records is None:
            break
        presented = [r for r in records if r.label == "symmetries" and r.solver == solver]
        # refused for redundant rows
        if not on_tree and presented and all(r.status == Status.REFUSED for r in presented):
            on_tree = True
            stages.insert(0, plan_symmetries(solver, "random_mechanism", TREE, cpu_limit=min(20.0, budget / 6.0)))
            specs += stages[0]
        if not long and any(s.label == "symmetries" for s in done):
            long, rest = True, budget - (_cpu_seconds() - begun)
            if (more := plan_long_run(solver, records, min(budget / 6.0, rest / 3.0))) is not None:
                specs.append(more)
                stages.insert(0, [more])
    return specs


def _cpu_seconds() -> float:
    """Return the CPU time of this process and its finished children, without compilation [s]."""
    return sum(os.times()[:4]) - code_seconds_of_tree()


def plan_long_run(solver: str, records: Sequence[RunRecord], seconds: float) -> RunSpec | None:
    """Return a run of the pendulum for ``seconds`` [s] of CPU time; None if it has too few periods or unknown speed."""
    control = registry.solvers()[solver].control
    done = [r for r in _select_runs(solver, records, "ladder") if r.problem == "spherical_pendulum" and r.steps]
    if not done:
        return None
    if control == "dt":
        rate = LONG["dt"] / max(r.cpu_median_s / r.steps for r in done)
    else:
        near = min(done, key=lambda r: abs(math.log(r.rtol / LONG["rtol"])))
        rate = near.t_reached_s / max(near.cpu_median_s, 1e-6)
    t_end = min(LONGEST, 0.7 * seconds * rate)
    if t_end < 1.2 * PERIODS * PERIOD:
        return None
    parameters = {**SWING, "t_end": float(f"{t_end:.3g}")}
    return make_trial_run(solver, "spherical_pendulum", parameters, {control: LONG[control]}, "long", 2.0 * seconds)


def certify_ladders(solver: str, folder: Path, records: Sequence[RunRecord]) -> Sequence[Order]:
    """Return the orders that could be measured on the solver's ladders, among ``records`` of runs in ``folder``."""
    return [o for o in certify_orders(folder, _select_runs(solver, records, "ladder")) if o.is_measured]


def assess_solver(
    solver: str, folder: Path, records: Sequence[RunRecord], found: Sequence[Order], left: Sequence[RunSpec] = ()
) -> Iterator[Finding]:
    """Yield all findings on a solver, in the order of the page, from the records of the runs in ``folder``.

    ``found`` are the orders of its ladders, ``left`` the planned runs that the budget excluded.
    """
    ladder, rest = _select_runs(solver, records, "ladder"), _select_runs(solver, left, "ladder")
    yield from _assess_problems(_select_runs(solver, records, "problems"))
    yield from _assess_orders(found, ladder, rest)
    yield _assess_energy(solver, records, folder, left)
    yield from _assess_laws(_select_runs(solver, records, "problems"), ladder, rest)
    yield from _assess_work(solver, records, left)
    presented, cut = _select_runs(solver, records, "symmetries"), len(_select_runs(solver, left, "symmetries"))
    yield from assess_symmetries(folder, presented, _describe_cut(cut, len(presented)))
    yield _assess_growth(_select_runs(solver, records, "growth"), _select_runs(solver, left, "growth"))


def _select_runs(solver: str, runs: Sequence[Run], label: str) -> list[Run]:
    """Return the runs of ``solver`` that have the ``label``."""
    return [r for r in runs if r.solver == solver and r.label == label]


def _describe_cut(left: int, run: int) -> str:
    """Describe why a finding is undetermined: the budget excluded ``left`` of its runs, and ``run`` were made."""
    if not run:
        return "no run of it within the budget"
    return f"{left} of {left + run} runs of it are left out by the budget"


def _assess_problems(runs: Sequence[RunRecord]) -> Iterator[Finding]:
    """Yield a finding on how the solver ended on each problem; refusals and runs that were too slow are left open."""
    for r in sorted(runs, key=lambda r: r.problem):
        open_ = r.status in (Status.REFUSED, Status.STALLED, Status.UNFINISHED)
        if Trait.STIFF in registry.problems()[r.problem].tests:  # stiff: a step may be too long for any method
            open_ |= r.status in (Status.DIVERGED, Status.STEP_UNDERFLOW)
        good = None if open_ else r.status == Status.SUCCESS
        said = "" if r.status == Status.SUCCESS else f": {'; '.join(list_reasons(r))}"
        until = (
            f", accurate to {format_accurate_times(r)[0].split(' (')[0]}"
            if format_accurate_times(r) and r.steps
            else ""
        )
        yield state_finding(
            f"{r.problem}, {r.t_end_s:g} s", f"{describe_status(r)}{said}{until}", "success, or a reason", good
        )


def _assess_orders(
    found: Sequence[Order], ladder: Sequence[RunRecord], left: Sequence[RunSpec] = ()
) -> Iterator[Finding]:
    """Yield the orders ``found`` of each ladder or, without any, why: runs that failed, or were ``left`` out."""
    for name in LADDERS:
        yield from (o.as_finding() for o in found if o.problem == name and o.quantity in QUANTITIES)
        if not any(o.problem == name for o in found):
            rungs = [r for r in ladder if r.problem == name]
            yield _explain_no_order(f"order, {name}", rungs, sum(s.problem == name for s in left))


def _explain_no_order(what: str, ladder: Sequence[RunRecord], left: int) -> Finding:
    """Return the finding named ``what`` on a ladder without an order, with the reason.

    It is undetermined if the budget excluded runs (``left`` of them) or if all unfinished runs were too slow; otherwise
    it fails, with the statuses of the runs.
    """
    ends = Counter(str(r.status or "unknown") for r in ladder if r.status not in ENDED)
    if not ladder or (left and not ends):
        return leave_undetermined(what, _describe_cut(left, len(ladder)), "a ladder")
    if ends and set(ends) <= {Status.STALLED, Status.UNFINISHED}:
        return leave_undetermined(what, "the runs were too slow for the budget", "a ladder")
    words = ", ".join(f"{n} {status}" for status, n in sorted(ends.items()))
    said = f"no ladder of steps or tolerances finished{': ' if words else ''}{words}"
    return state_finding(what, said, "a ladder", good=False)


def _assess_energy(solver: str, records: Sequence[RunRecord], folder: Path, left: Sequence[RunSpec]) -> Finding:
    """Return the finding, without a limit, on oscillation [J] and trend [W] of the energy error of a long run.

    ``left`` are the planned runs that the budget excluded.
    """
    runs = _select_runs(solver, records, "long")
    if not runs:
        words = _describe_cut(1, 0) if left else f"{PERIODS} periods would take longer than the budget"
        return leave_undetermined("energy over many periods", words)
    (d,) = analyse_drift(folder, runs)[:1]
    if not d.periods:
        return state_finding(
            "energy over many periods", f"{d.verdict}: {'; '.join(list_reasons(runs[0])) or 'no periods'}", good=None
        )
    words = f"{d.verdict} over {d.periods} periods: oscillation {d.oscillation_J:.2g} J"
    trend = f", trend {d.trend_W:.2g} [{d.trend_low_W:.2g}, {d.trend_high_W:.2g}] W"
    return state_finding("energy over many periods", words + trend)


def _assess_laws(
    runs: Sequence[RunRecord], ladder: Sequence[RunRecord], left: Sequence[RunSpec] = ()
) -> Iterator[Finding]:
    """Yield the largest violation of joints over ``runs``, and the least error of reactions over ``ladder``."""
    moved = [r for r in runs if r.steps and r.gap_share_max >= 0.0]
    if moved:
        worst = max(moved, key=lambda r: r.gap_share_max)
        words = f"{worst.gap_share_max:.2g} and {worst.gap_rate_share_max:.2g} of the limits ({worst.problem})"
        yield state_finding("largest |phi|, |phi_dot|", words, "|phi| within its limit", worst.gap_share_max <= 1.0)
    done = [r for r in ladder if r.claimed == Status.SUCCESS]
    known = [r for r in done if math.isfinite(r.reaction_size_N)]
    if not known:
        none = "none returned" if done else "no run of the ladders succeeded"
        yield leave_undetermined("reactions", none if ladder else _describe_cut(len(left), 0))
        return
    error = min(map(compute_reaction_error, known))
    good = True if error <= RIGHT_REACTION else None if left else False  # a finer setting may have been left out
    yield state_finding("reactions at the finest setting", f"off by {100.0 * error:.2g} %", "5 %", good)


def _assess_work(solver: str, records: Sequence[RunRecord], left: Sequence[RunSpec] = ()) -> Iterator[Finding]:
    """Yield the least error on each ladder with its CPU time, and the cheapest run of a rival that is as accurate."""
    for name in LADDERS:
        sound = [r for r in records if r.label == "ladder" and r.problem == name and r.status == Status.SUCCESS]
        mine = [r for r in sound if r.solver == solver]
        if not mine:
            continue
        best = min(mine, key=lambda r: r.motion_error_max_m)
        rivals = [r for r in sound if r.solver != solver]
        words = f"{best.motion_error_max_m:.2g} m in {_describe_time(best)}"
        r = find_cheapest(rivals, best.motion_error_max_m, lambda r: r.motion_error_max_m, lambda r: r.cpu_median_s)
        if r is not None:
            words += f"; {r.solver} {r.motion_error_max_m:.2g} m in {_describe_time(r)}"
            if 0.0 < count_index_1_evaluations(best) < math.inf and math.isfinite(count_index_1_evaluations(r)):
                words += (
                    f", {count_index_1_evaluations(r) / count_index_1_evaluations(best):.2g} of the index-1 evaluations"
                )
        else:
            cut = {s.solver for s in left if s.label == "ladder" and s.problem == name}  # they might have come nearer
            whole = [who for who in FIELD if who != solver and who not in cut]
            words += f"; none of {', '.join(whole)} comes as near" if whole else ""
        yield state_finding(f"work, {name}", words)


def _describe_time(r: RunRecord) -> str:
    """Return the CPU time of a run, such as ``0.12 s``; shorter than ``CLOCK`` it is not stated."""
    return f"{r.cpu_median_s:.2g} s" if r.cpu_median_s > CLOCK else f"less than {1e3 * CLOCK:g} ms"


def _assess_growth(runs: Sequence[RunRecord], left: Sequence[RunSpec] = ()) -> Finding:
    """Return the finding on how the CPU time of a step grows with the number n of bodies of a chain: p of n^p."""
    quantity = "cost of a step in bodies"
    done = sorted((r.parameters.get("links", 15), r.cpu_median_s / r.steps) for r in runs if r.steps)
    if len(done) < 3:
        few = "too few chains finished, or all faster than the clock resolves"
        return leave_undetermined(quantity, _describe_cut(len(left), len(runs)) if left else few)
    return judge_growth(quantity, *zip(*done, strict=True))
