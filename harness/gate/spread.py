"""How far rounding alone moves a run: bounds around the repeats that it changed.

One sample says little about a number that rounding moves: under error control it may change which steps are accepted,
and at a fixed step that it changes next to nothing is to be measured. Bounds lie around all samples, by the width that
they would have around one.
"""

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from msgspec import structs

from ..results.records import RunRecord
from ..types import Status
from .thresholds import FINGERPRINT, FIXED_STEP, Spread, Threshold, Thresholds, four_digits, propose_bounds


@dataclass(frozen=True)
class Sample:
    """A record of a case, and the kind of rounding that changed its run; "" for the run as it is."""

    kind: str
    record: RunRecord


def find_unstable(samples: Mapping[str, Sequence[Sample]]) -> dict[str, str]:
    """Find the cases of which rounding decides the status, each with the kinds of rounding that lead to each status."""
    out = {}
    for case, found in samples.items():
        kinds: dict[str, Counter[str]] = {}
        for s in found:
            kinds.setdefault(s.record.status, Counter())[s.kind or "unchanged"] += 1
        if len(kinds) > 1:
            out[case] = "; ".join(f"{status} ({_list_kinds(n)})" for status, n in kinds.items())
    return out


def _list_kinds(kinds: Mapping[str, int]) -> str:
    return ", ".join(kind if n == 1 else f"{n} x {kind}" for kind, n in kinds.items())


def widen_by_spread(old: Thresholds, samples: Mapping[str, Sequence[Sample]]) -> Thresholds:
    """Return ``old`` with bounds around all ``samples`` of a case where one leaves them, or those around another.

    Rounding has to explain it: it does if the value that was measured when the threshold was set lies within the new
    bounds. Bounds of a case whose status rounding decides stay.
    """
    unstable = find_unstable(samples)
    lawful = {c: found for c, found in samples.items() if c not in unstable and Status(found[0].record.status).lawful}
    bounds = []
    for was in old.bounds:
        found = [(s.kind, b) for s in lawful.get(was.case, ()) for b in _bounds_of(was, s)]
        around = _widen_around(was, found, lawful[was.case][0].record.control) if found else None
        bounds.append(around if around and around.holds(was.value) else was)
    return structs.replace(old, bounds=tuple(bounds), spread=_summarise(lawful) or old.spread)


def _bounds_of(was: Threshold, s: Sample) -> list[Threshold]:
    found = propose_bounds([replace(s.record, case=was.case)])
    return [b for b in found if b.metric == was.metric]


def _widen_around(was: Threshold, found: Sequence[tuple[str, Threshold]], control: str) -> Threshold | None:
    """Return ``was`` with the widest of its bounds in ``found``; None where bounds around any one hold of all."""
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
        was, value=four_digits(statistics.median(values)), upper=upper, lower=lower, samples=len(found), reason=reason
    )


def _summarise(lawful: Mapping[str, Sequence[Sample]]) -> Spread | None:
    """Summarise how often and by what runs were changed, and where that moved a number of a fixed-step run most.

    That is the largest value over the least, of numbers that have bounds by ``FIXED_STEP`` and measure no rounding.
    """
    kinds = sorted({s.kind for found in lawful.values() for s in found if s.kind})
    if not kinds:
        return None
    most, case = 1.0, ""
    for name, found in lawful.items():
        values: dict[str, list[float]] = {}
        for s in found:
            for b in propose_bounds([s.record]):
                if b.reason == FIXED_STEP.reason:
                    values.setdefault(b.metric, []).append(float(getattr(s.record, b.metric)))
        for metric, all_of_it in values.items():
            if metric != FINGERPRINT and (ratio := max(all_of_it) / min(all_of_it)) > most:
                most, case = ratio, f"{name} {metric}"
    samples = min(len(found) for found in lawful.values())
    return Spread(samples, tuple(kinds), float(f"{most:.6g}"), case)
