"""Widen bounds by how far rounding alone moves a run, as measured by repeats.

One sample says little about a number that rounding moves: under error control it may change which steps are accepted;
at a fixed step it should change next to nothing, which has to be measured. The new bounds enclose all samples by the
width that they would have around one.
"""

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from msgspec import structs

from ...mechanics.types import Status
from ...results.records import RunRecord
from .thresholds import FINGERPRINT, FIXED_STEP, Spread, Threshold, Thresholds, propose_bounds, round_to_four_digits

# by case, its runs: the kind of rounding that changed each (empty for the unchanged one), and the record
Samples = Mapping[str, Sequence[tuple[str, RunRecord]]]


def find_unstable(samples: Samples) -> dict[str, str]:
    """Return the cases whose samples differ in status, each with a text that lists the statuses.

    For example ``success (unchanged, 2 x frame); diverged (start)``, with the kinds of rounding that lead to each.
    """
    out = {}
    for case, found in samples.items():
        kinds: dict[str, Counter[str]] = {}
        for kind, record in found:
            kinds.setdefault(record.status, Counter())[kind or "unchanged"] += 1
        if len(kinds) > 1:
            out[case] = "; ".join(f"{status} ({_list_kinds(n)})" for status, n in kinds.items())
    return out


def _list_kinds(kinds: Mapping[str, int]) -> str:
    """Return counted kinds of rounding in words, such as ``start, 2 x frame``."""
    return ", ".join(kind if n == 1 else f"{n} x {kind}" for kind, n in kinds.items())


def widen_by_spread(old: Thresholds, samples: Samples) -> Thresholds:
    """Return ``old`` with bounds widened to enclose all samples of a case, where rounding alone would break them.

    A bound is widened if it, or the bound around one sample, excludes another sample. It stays if rounding decides the
    status of its case, and if its value lies outside the new bounds: then more than rounding has changed.
    """
    unstable = find_unstable(samples)
    lawful = {c: found for c, found in samples.items() if c not in unstable and Status(found[0][1].status).lawful}
    bounds = []
    for was in old.bounds:
        found = [(kind, b) for kind, record in lawful.get(was.case, ()) for b in _propose_bound(was, record)]
        around = _widen_bound(was, found, lawful[was.case][0][1].control) if found else None
        bounds.append(around if around and around.holds(was.value) else was)
    return structs.replace(old, bounds=tuple(bounds), spread=_summarise_spread(lawful) or old.spread)


def _propose_bound(was: Threshold, record: RunRecord) -> list[Threshold]:
    """Return the bound that one sample alone proposes for the metric of ``was``, as a list of at most one."""
    found = propose_bounds([replace(record, case=was.case)])
    return [b for b in found if b.metric == was.metric]


def _widen_bound(was: Threshold, found: Sequence[tuple[str, Threshold]], control: str) -> Threshold | None:
    """Return ``was`` widened to all bounds in ``found``; None if it is wide enough, or has a tolerance.

    ``found`` has the kind of rounding of each sample and the bound around it. ``was`` is wide enough if it holds for
    all samples and, unless it encloses several already, so does each of these bounds. ``control`` is ``dt`` or
    ``rtol``, for the reason stated.
    """
    values = [b.value for _, b in found]
    bounds = (was,) if was.samples > 1 else (was, *(b for _, b in found))
    if was.tolerance is not None or all(b.holds(value) for b in bounds for value in values):
        return None
    low, high = min(values), max(values)
    words = "fixed step" if control == "dt" else "error control"
    kinds = ", ".join(sorted({kind for kind, _ in found if kind}))
    reason = f"{words}: {len(found)} runs that differ by rounding ({kinds}) gave {low:.3g} to {high:.3g}"
    lower = min(b.lower for _, b in found) if was.lower > -math.inf else was.lower
    upper = max(b.upper for _, b in found) if was.upper < math.inf else was.upper
    return structs.replace(
        was,
        value=round_to_four_digits(statistics.median(values)),
        upper=upper,
        lower=lower,
        samples=len(found),
        reason=reason,
    )


def _summarise_spread(lawful: Samples) -> Spread | None:
    """Return the number and kinds of repeats, and the largest ratio by which rounding changed a number at a fixed step.

    The ratio is that of the largest to the least value of a metric over the samples of a case, of numbers with bounds
    by ``FIXED_STEP``. None if ``lawful`` has no repeats.
    """
    kinds = sorted({kind for found in lawful.values() for kind, _ in found if kind})
    if not kinds:
        return None
    most, case = 1.0, ""
    for name, found in lawful.items():
        values: dict[str, list[float]] = {}
        for _, record in found:
            for b in propose_bounds([record]):
                if b.reason == FIXED_STEP.reason:
                    values.setdefault(b.metric, []).append(float(getattr(record, b.metric)))
        for metric, all_of_it in values.items():
            if metric != FINGERPRINT and (ratio := max(all_of_it) / min(all_of_it)) > most:
                most, case = ratio, f"{name} {metric}"
    samples = min(len(found) for found in lawful.values())
    return Spread(samples, tuple(kinds), float(f"{most:.6g}"), case)
