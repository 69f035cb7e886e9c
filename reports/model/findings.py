"""What a run shows, in sentences made from its numbers. A winner is named only where the data show one."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from .accuracy import Measure, drifts, measure_for
from .posings import plain_cells
from .reading import Cell, Posing, Run
from .words import listed, mark, number, plural, seconds, time

SAME_ERROR = 1.25  # errors closer than this factor are called equal
SAME_CPU = 1.3  # so are timings: the spread of single timings on a shared machine
ACCURATE = 1e-3  # of the mechanism's size, or rad: the accuracy at which costs are compared


REASON = 240  # characters of a reason in a sentence: the cell's page has all


@dataclass(frozen=True)
class Finding:
    """A sentence, and how much it matters: wrong, failed or plain."""

    text: str
    kind: str = "plain"


def findings(run: Run) -> list[Finding]:
    """About the whole run."""
    if not run.cells:
        return [Finding("This run holds no finished cell.", "failed")]
    return [*_counts(run), *_by_label(run), *_wanderers(run)]


def findings_of(whole: Posing, label: str = "") -> list[Finding]:
    """About one problem: of the cells that speak for it; the others in a line."""
    cells = plain_cells(whole, label)
    posing = Posing(whole.title, whole.slug, cells)
    out: list[Finding] = []
    measure = measure_for(whole.cells)
    if not posing.solved():
        out.append(Finding("No cell reached the end of this problem with a motion that holds.", "failed"))
    if measure is not None:
        out += [*_most_accurate(posing, measure), *_cheapest(posing, measure), *_response(posing, measure)]
    out += _energy(posing)
    out += _ends(posing)
    if len(cells) < len(whole.cells):
        here = {c.record.cell for c in cells}
        out.append(_others([c for c in whole.cells if c.record.cell not in here], cells[0].record.label))
    return out


def _others(cells: Sequence[Cell], label: str) -> Finding:
    """How all other settings ended."""
    ends = Counter(_ending(c) for c in cells)
    words = listed([f"{n} {w}" for w, n in ends.most_common()])
    said = f"All this is about “{label}”" if label else "All this is about default options"
    return Finding(f"{said}. Of {plural(len(cells), 'cell')} at other settings, folded below, {words}.")


def _ending(c: Cell) -> str:
    return "held" if c.succeeded else c.status if c.status in ("wrong", "refused") else "stopped early"


def called(cell: Cell) -> str:
    """A cell in a sentence."""
    return f"{cell.record.solver} ({cell.settings()})"


def _counts(run: Run) -> Iterator[Finding]:
    count = Counter(c.status for c in run.cells)
    words = listed([f"{n} {mark(s).word}" for s, n in count.most_common()])
    yield Finding(f"{plural(len(run.cells), 'cell')} on {plural(len(run.posings), 'problem')}: {words}.")
    wrong = count["wrong"]
    if wrong:
        share = Counter(c.record.solver for c in run.cells if c.status == "wrong")
        whose = listed([f"{s} {n} of {sum(c.record.solver == s for c in run.cells)}" for s, n in share.most_common()])
        yield Finding(
            f"{plural(wrong, 'cell')} claimed success although energy, constraints, invariants or the reference say "
            f"no: {whose}.",
            "wrong",
        )


def _by_label(run: Run) -> Iterator[Finding]:
    if len(run.labels()) < 2:
        return
    for label in run.labels():
        own = [c for c in run.cells if c.record.label == label]
        ends = Counter("success" if c.succeeded else "wrong" if c.status == "wrong" else
                       "refused" if c.status == "refused" else "stopped early" for c in own)  # fmt: skip
        words = listed([f"{n} {w}" for w, n in ends.most_common()])
        yield Finding(f"“{label or 'no label'}”: of {plural(len(own), 'cell')} {words}.")


def _wanderers(run: Run) -> Iterator[Finding]:
    told = [(c, drifts(c)) for c in run.cells if c.succeeded]
    told = [(c, d) for c, d in told if d is not None]
    if not told:
        return
    words = []
    for solver in run.solvers:
        own = [d for c, d in told if c.record.solver == solver]
        if own:
            words.append(f"{solver} {sum(map(bool, own))} of {len(own)}")
    yield Finding(
        f"Among successes, the energy error drifts rather than swings in: {listed(words, 12)}. "
        "How large it is stands in the tables; a drift may be small and a swing large."
    )


def _most_accurate(posing: Posing, measure: Measure) -> Iterator[Finding]:
    ranked = sorted((c for c in posing.solved() if math.isfinite(measure.of(c))), key=measure.of)
    if not ranked:
        return
    best = measure.of(ranked[0])
    below = [c for c in ranked if measure.of(c) <= measure.own]
    if len(below) > 1:
        names = listed([called(c) for c in below])
        yield Finding(f"At or below the reference's own error, and so not told apart by {measure.what}: {names}.")
        return
    close = [c for c in ranked if measure.of(c) <= SAME_ERROR * best]
    who = listed([called(c) for c in close])
    many = f"{who} (within {SAME_ERROR:g} of each other)" if len(close) > 1 else who
    yield Finding(
        f"Smallest {measure.what} of {plural(len(ranked), 'success', 'successes')}: {number(best)} {measure.unit}, "
        f"{many}."
    )


def _cheapest(posing: Posing, measure: Measure) -> Iterator[Finding]:
    length = max((c.record.length_scale_m for c in posing.cells if c.record.length_scale_m > 0.0), default=1.0)
    target = ACCURATE * (length if measure.unit == "m" else 1.0)
    good = [c for c in posing.solved() if measure.of(c) <= target and c.record.cpu_median_s >= 0.0]
    words = f"with a {measure.what} within {number(target)} {measure.unit}"
    if not good:
        yield Finding(f"No success {words}.")
        return
    good.sort(key=lambda c: c.record.cpu_median_s)
    least = good[0].record.cpu_median_s
    close = [
        c for c in good if c.record.cpu_median_s <= SAME_CPU * least or c.record.cpu_min_s <= good[0].record.cpu_max_s
    ]
    who = listed([f"{called(c)} {seconds(c.record.cpu_median_s)}" for c in close])
    single = " (single timings)" if any(c.record.repeats < 2 for c in close) else ""
    told = f", too close to tell apart: {who}" if len(close) > 1 else f": {who}"
    next_one = next((c for c in good if c.record.solver not in {k.record.solver for k in close}), None)
    after = f"; next solver: {called(next_one)} {seconds(next_one.record.cpu_median_s)}" if next_one else ""
    yield Finding(f"Least CPU time {words}{single}{told}{after}. {len(good)} of {len(posing.solved())} successes are.")


def _response(posing: Posing, measure: Measure) -> Iterator[Finding]:
    families: dict[str, list[Cell]] = {}
    for c in posing.cells:
        whole = c.succeeded or c.status == "wrong"
        if whole and measure.of(c) > max(10.0 * measure.own, 0.0) and math.isfinite(measure.of(c)):
            families.setdefault(f"{c.method} {c.record.max_step_s:g}", []).append(c)
    for own in families.values():
        own.sort(key=lambda c: -c.fineness)
        coarse, fine = own[0], own[-1]
        if fine.fineness <= 0.0 or coarse.fineness / fine.fineness < 1.5:
            continue
        gain = measure.of(coarse) / measure.of(fine)
        if coarse.record.control == "dt":
            order = math.log(gain) / math.log(coarse.fineness / fine.fineness)
            yield Finding(f"{coarse.method}: from {coarse.step_words} to {fine.step_words} the {measure.what} falls by "
                          f"{number(gain)}: observed order {order:.2f}.")  # fmt: skip
        elif gain < 1.0:
            yield Finding(
                f"{coarse.method}: tightening from {coarse.step_words} to {fine.step_words} makes the {measure.what} "
                f"larger, from {number(measure.of(coarse))} to {number(measure.of(fine))} {measure.unit}.",
                "failed",
            )


def _energy(posing: Posing) -> Iterator[Finding]:
    known = [c for c in posing.solved() if math.isfinite(c.record.energy_drift_max_J)]
    if len(known) > 1:
        known.sort(key=lambda c: c.record.energy_drift_max_J)
        least, most = known[0].record.energy_drift_max_J, known[-1].record.energy_drift_max_J
        if most > SAME_ERROR * least:
            yield Finding(
                f"Energy errors of successes reach from {number(least)} J, {called(known[0])}, "
                f"to {number(most)} J, {called(known[-1])}."
            )
        else:
            yield Finding(f"All successes have about the same largest energy error, {number(most)} J.")
    allowed = next((c.record.energy_allowed_J for c in posing.cells if c.record.energy_allowed_J > 0.0), math.nan)
    if not math.isnan(allowed):
        over = [c for c in posing.cells if c.record.energy_drift_max_J > allowed]
        words = f"exceeded by {listed([called(c) for c in over])}" if over else "kept by every cell that made a step"
        yield Finding(
            f"The benchmark's limit on the energy error, {number(allowed)} J, is {words}. It does not make a cell "
            "wrong: that is a tenth of the energy to exchange, for all problems.",
            "failed" if over else "plain",
        )


def _ends(posing: Posing) -> Iterator[Finding]:
    """The earliest stop of each solver with its reason, the others counted."""
    early = sorted((c for c in posing.cells if c.stopped), key=lambda c: c.record.t_reached_s)
    for solver in dict.fromkeys(c.record.solver for c in early):
        own = [c for c in early if c.record.solver == solver]
        r = own[0].record
        where = (
            f"at {time(r.t_reached_s)} of {time(r.t_end_s)} s"
            if math.isfinite(r.t_reached_s)
            else "before its first step"
        )
        more = f" So did {len(own) - 1} more of {solver}, later." if len(own) > 1 else ""
        reason = _short(own[0].reasons[0])
        yield Finding(f"{called(own[0])} ended {where}, {mark(own[0].status).word}: {reason}{more}", "failed")
    refused: dict[tuple[str, str], list[Cell]] = {}
    for c in posing.cells:
        if c.status == "refused":
            refused.setdefault((c.record.solver, c.reasons[0]), []).append(c)
    for (_, reason), own in refused.items():
        more = f" and {len(own) - 1} more" if len(own) > 1 else ""
        yield Finding(f"{called(own[0])}{more} refused: {_short(reason)}")


def _short(reason: str) -> str:
    return reason if len(reason) <= REASON else reason[: REASON - 1] + "…"
