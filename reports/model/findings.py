"""What the results show, in sentences made from the numbers. A winner is named only where the data show one."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from ...harness.types import ACCURATE as ACCURATE_WITHIN
from .accuracy import Measure, measure_for
from .results import Results, Run, Variant, by_solver, grouped
from .scores import score
from .variants import plain_runs
from .words import cut, listed, mark, number, plural, seconds, time

SAME_ERROR = 1.25  # errors closer than this factor are called equal
SAME_CPU = 1.3  # so are timings: the spread of single timings on a shared machine
ACCURATE = 1e-3  # of the mechanism's size, or rad: the accuracy at which costs are compared


REASON = 240  # characters of a reason in a sentence: the run's page has all


@dataclass(frozen=True)
class Finding:
    """A sentence, and how much it matters: wrong, failed or plain."""

    text: str
    kind: str = "plain"


def findings(results: Results) -> list[Finding]:
    """About all results."""
    return list(_counts(results)) if results.runs else [Finding("These results hold no finished run.", "failed")]


def findings_of(whole: Variant, label: str = "") -> list[Finding]:
    """About one problem: of the runs that speak for it; the others in a line."""
    runs = plain_runs(whole, label)
    variant = Variant(whole.title, whole.slug, runs)
    out: list[Finding] = []
    measure = measure_for(whole.runs)
    if not variant.solved():
        out.append(Finding("No run solved this problem to the end.", "failed"))
    if measure is not None:
        out += [*_most_accurate(variant, measure), *_cheapest(variant, measure), *_response(variant, measure)]
    out += [*_energy(variant), *_ends(variant)]
    if len(runs) < len(whole.runs):
        here = {c.record.run_id for c in runs}
        others = [c for c in whole.runs if c.record.run_id not in here]
        about = f"“{runs[0].record.label}”" if runs[0].record.label else "default options"
        words = f"Of {plural(len(others), 'run')} at other settings, folded below: {score(others).words}."
        out.append(Finding(f"These findings are about {about}. {words}"))
    return out


def called(run: Run) -> str:
    """A run in a sentence."""
    return f"{run.record.solver} ({run.settings()})"


def _counts(results: Results) -> Iterator[Finding]:
    count = Counter(c.status for c in results.runs)
    words = listed([f"{n} {mark(s).word}" for s, n in count.most_common()])
    yield Finding(f"{plural(len(results.runs), 'run')} on {plural(len(results.variants), 'variant')}: {words}.")
    scores = {solver: score(runs) for solver, runs in by_solver(results.runs).items()}
    wrong = sorted(((s, n) for s, n in scores.items() if n.wrong), key=lambda kv: -kv[1].wrong)
    if wrong:
        whose = listed([f"{solver} {n.wrong} of {n.runs}" for solver, n in wrong])
        yield Finding(f"{plural(count['wrong'], 'false success', 'false successes')}: energy, constraints or "
                      f"invariants are violated: {whose}.", "wrong")  # fmt: skip
    for label in results.labels() if len(results.labels()) > 1 else ():
        own = score(c for c in results.runs if c.record.label == label)
        yield Finding(f"“{label or 'no label'}”: of {plural(own.runs, 'run')} {own.words}.")
    judged = [(s, n.drifting, n.drifting + n.bounded) for s, n in scores.items() if n.drifting + n.bounded]
    if judged:
        where = listed([f"{s} {k} of {n}" for s, k, n in judged], 12)
        yield Finding(f"Among successes, the energy error drifts in: {where}. Its size is in the tables: a drift may "
                      "be small and a bounded error large.")  # fmt: skip


def _most_accurate(variant: Variant, measure: Measure) -> Iterator[Finding]:
    ranked = sorted((c for c in variant.solved() if math.isfinite(measure.of(c))), key=measure.of)
    if not ranked:
        return
    best = measure.of(ranked[0])
    below = [c for c in ranked if measure.of(c) <= measure.own]
    if len(below) > 1:
        names = listed([called(c) for c in below])
        yield Finding(f"At or below the reference's stated error, and so not distinguished by {measure.what}: {names}.")
        return
    close = [c for c in ranked if measure.of(c) <= SAME_ERROR * best]
    who = listed([called(c) for c in close])
    many = f"{who} (within {SAME_ERROR:g} of each other)" if len(close) > 1 else who
    yield Finding(f"Smallest {measure.what} of {plural(len(ranked), 'success', 'successes')}: {number(best)} "
                  f"{measure.unit}, {many}.")  # fmt: skip


def _cheapest(variant: Variant, measure: Measure) -> Iterator[Finding]:
    length = max((c.record.length_scale_m for c in variant.runs if c.record.length_scale_m > 0.0), default=1.0)
    target = ACCURATE * (length if measure.unit == "m" else 1.0)
    good = [c for c in variant.solved() if measure.of(c) <= target and c.record.cpu_median_s >= 0.0]
    words = f"with a {measure.what} within {number(target)} {measure.unit}"
    if not good:
        yield Finding(f"No success {words}.")
        return
    good.sort(key=lambda c: c.record.cpu_median_s)
    least = good[0].record.cpu_median_s
    most = good[0].record.cpu_max_s
    close = [c for c in good if c.record.cpu_median_s <= SAME_CPU * least or c.record.cpu_min_s <= most]
    who = listed([f"{called(c)} {seconds(c.record.cpu_median_s)}" for c in close])
    single = " (single timings)" if any(c.record.repeats < 2 for c in close) else ""
    close_words = f", too close to distinguish: {who}" if len(close) > 1 else f": {who}"
    next_one = next((c for c in good if c.record.solver not in {k.record.solver for k in close}), None)
    after = f"; next solver: {called(next_one)} {seconds(next_one.record.cpu_median_s)}" if next_one else ""
    share = f"{len(good)} of {len(variant.solved())} successes are that accurate"
    yield Finding(f"Least CPU time {words}{single}{close_words}{after}. {share}.")


def _response(variant: Variant, measure: Measure) -> Iterator[Finding]:
    whole = [c for c in variant.runs if c.status in ("success", "inaccurate", "wrong") and math.isfinite(measure.of(c))]
    above = [c for c in whole if measure.of(c) > max(10.0 * measure.own, 0.0)]
    for own in grouped(above, lambda c: f"{c.method} {c.record.max_step_s:g}").values():
        own.sort(key=lambda c: -c.step_or_tolerance)
        coarse, fine = own[0], own[-1]
        if fine.step_or_tolerance <= 0.0 or coarse.step_or_tolerance / fine.step_or_tolerance < 1.5:
            continue
        gain = measure.of(coarse) / measure.of(fine)
        if coarse.record.control == "dt":
            yield Finding(_fixed_steps(coarse, fine, measure))
        elif gain < 1.0:
            yield Finding(f"{coarse.method}: tightening from {coarse.step_words} to {fine.step_words} makes the "
                          f"{measure.what} larger, from {number(measure.of(coarse))} to {number(measure.of(fine))} "
                          f"{measure.unit}.", "failed")  # fmt: skip


def _fixed_steps(coarse: Run, fine: Run, measure: Measure) -> str:
    """How an error follows the step; never an order: that needs the ladders of the certificates."""
    large, small = measure.of(coarse), measure.of(fine)
    length = coarse.record.length_scale_m if measure.unit == "m" else 1.0
    words = f"{coarse.method}: from {coarse.step_words} to {fine.step_words} the {measure.what}"
    values = f"from {number(large)} to {number(small)} {measure.unit}"
    if small >= large:
        return f"{words} does not fall, {values}: it is not that of the scheme (rounding, or a limit of the iteration)."
    if large > ACCURATE_WITHIN["accurate_until_s"] * length:
        return f"{words} falls {values}: at the larger step it is saturated, and the ratio tells no order."
    return f"{words} falls by {number(large / small)}, {values}."


def _energy(variant: Variant) -> Iterator[Finding]:
    known = [c for c in variant.solved() if math.isfinite(c.record.energy_drift_max_J)]
    if len(known) > 1:
        known.sort(key=lambda c: c.record.energy_drift_max_J)
        least, most = known[0].record.energy_drift_max_J, known[-1].record.energy_drift_max_J
        if most > SAME_ERROR * least:
            yield Finding(f"Energy errors of successes range from {number(least)} J, {called(known[0])}, "
                          f"to {number(most)} J, {called(known[-1])}.")  # fmt: skip
        else:
            yield Finding(f"All successes have about the same largest energy error, {number(most)} J.")
    allowed = next((c.record.energy_allowed_J for c in variant.runs if c.record.energy_allowed_J > 0.0), math.nan)
    if not math.isnan(allowed):
        over = [c for c in variant.runs if c.record.energy_drift_max_J > allowed]
        words = f"exceeded by {listed([called(c) for c in over])}" if over else "kept by every run that took a step"
        yield Finding(f"The benchmark's own limit on the energy error, {number(allowed)} J, is {words}. Exceeding it "
                      "does not make a run wrong: the limit drawn above, a tenth of the energy scale, does.",
                      "failed" if over else "plain")  # fmt: skip


def _ends(variant: Variant) -> Iterator[Finding]:
    """The earliest stop of each solver with its reason, the others counted."""
    early = sorted((c for c in variant.runs if c.stopped and not c.unfinished), key=lambda c: c.record.t_reached_s)
    for solver, own in by_solver(early).items():
        r = own[0].record
        known = math.isfinite(r.t_reached_s)
        where = f"at {time(r.t_reached_s)} of {time(r.t_end_s)} s" if known else "before its first step"
        more = f" {len(own) - 1} more of {solver} did so later." if len(own) > 1 else ""
        reason = cut(own[0].reasons[0], REASON)
        yield Finding(f"{called(own[0])} ended {where}, {mark(own[0].status).word}: {reason}{more}", "failed")
    refused = [c for c in variant.runs if c.status == "refused"]
    for (_, reason), own in grouped(refused, lambda c: (c.record.solver, c.reasons[0])).items():
        more = f" and {len(own) - 1} more" if len(own) > 1 else ""
        yield Finding(f"{called(own[0])}{more} refused: {cut(reason, REASON)}")
