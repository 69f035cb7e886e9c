"""How far rounding alone moves a run under error control: repeats with rtol changed by rounding-sized amounts.

One sample says little about a number that depends on which steps were accepted. The bounds of such a number lie around
all of its samples, by the width that they would have around one.
"""

import dataclasses
import math
import statistics
from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from ..results.findings import Verdict
from ..results.records import RunRecord
from ..suites.spec import RunSpec
from .check import Judged
from .thresholds import Threshold, Thresholds, four_digits, propose_bounds

STEP = 1e-13  # of rtol: hundreds of roundings, and far below what an error is known to


def runs_to_repeat(specs: Sequence[RunSpec], result: Judged) -> list[RunSpec]:
    """The runs under error control of which a number has left its bounds, or moved by more than 1 %."""
    found = [f for f in result.notable if f.verdict in (Verdict.FAILED, Verdict.MET)]
    moved = {f.subject for f in found if not math.isnan(f.measured.value)}
    return [s for s in specs if s.case in moved and s.control.rtol is not None]


def perturb_tolerance(spec: RunSpec, times: int) -> list[RunSpec]:
    """``spec`` with ``rtol`` times 1 + k 1e-13, for k = 1, -1, 2, -2 and so on: the same accuracy, other roundings."""
    assert spec.control.rtol is not None
    shifts = [(-1) ** i * (i // 2 + 1) * STEP for i in range(times)]
    return [
        dataclasses.replace(spec, control=dataclasses.replace(spec.control, rtol=spec.control.rtol * (1.0 + shift)))
        for shift in shifts
    ]


def widen_by_spread(old: Thresholds, samples: Mapping[str, Sequence[RunRecord]]) -> Thresholds:
    """``old`` with bounds around all ``samples`` of a case, where one leaves the bounds, or those around another.

    Rounding has to explain it: it does if the value that was measured when the threshold was set lies within the new
    bounds. A sample that did not succeed is no rounding: the bounds of its case stay.
    """
    lawful = {case: tuple(records) for case, records in samples.items() if all(r.status == "success" for r in records)}
    bounds = []
    for was in old.bounds:
        found = [b for r in lawful.get(was.case, ()) for b in propose_bounds([dataclasses.replace(r, case=was.case)])]
        around = _widen_around(was, [b for b in found if b.metric == was.metric])
        bounds.append(around if around and around.holds(was.value) else was)
    return replace(old, bounds=tuple(bounds))


def _widen_around(was: Threshold, found: Sequence[Threshold]) -> Threshold | None:
    """``was`` with the widest of the bounds that it has in ``found``; None where bounds around any one hold of all."""
    values = [b.value for b in found]
    bounds = (was,) if was.samples > 1 else (was, *found)
    if was.tolerance is not None or all(b.holds(value) for b in bounds for value in values):
        return None
    low, high = min(values), max(values)
    reason = f"error control: {len(found)} runs that differ by rounding gave {low:.3g} to {high:.3g}"
    lower = min(b.lower for b in found) if was.lower > -math.inf else was.lower
    upper = max(b.upper for b in found) if was.upper < math.inf else was.upper
    return replace(
        was, value=four_digits(statistics.median(values)), upper=upper, lower=lower, samples=len(found), reason=reason
    )
