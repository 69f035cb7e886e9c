"""Work against error: CPU time, which is this machine's, and evaluations, which are not."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...model.accuracy import measure_for
from ...model.results import Run, Variant
from ...model.words import seconds
from ..spec import Axis, Plot, Trace
from .time import Chapter

NOTE = (
    "Lower and further left is better. Lines join the steps or tolerances of the same settings. A run that stopped "
    "early (star) has the error up to there and is not comparable. Zeros have no place on a logarithmic axis: "
    "they are drawn hollow below all other values, to be read as “at most”. "
    "A click opens the run."
)


def work(variant: Variant, url: Callable[[Run], str]) -> Chapter | None:
    """All runs of a problem; None when none has both work and an error."""
    measure = measure_for(variant.runs)
    errors: list[tuple[str, str, str, Callable[[Run], float]]] = [
        ("energy-error", "largest energy error", "J", lambda c: c.record.energy_drift_max_J)
    ]
    if measure is not None:
        errors.insert(0, ("error", measure.what, measure.unit, measure.of))
    costs: list[tuple[str, str, str, Callable[[Run], float]]] = [
        ("cpu", "CPU time", "s", lambda c: c.record.cpu_median_s),
        ("evaluations", "evaluations", "", lambda c: c.record.evaluations),
    ]
    plots = []
    for key, what, in_unit, error in errors:
        for cost_key, cost_what, cost_unit, cost in costs:
            found = _traces(variant.runs, cost, error, url)
            if found:
                title = f"{what[0].upper()}{what[1:]} over {cost_what}"
                axes = Axis(cost_what, cost_unit, log=True), Axis(what, in_unit, log=True)
                plots.append(Plot(f"work-{key}-{cost_key}", title, "", *axes, found))
    return Chapter("Work against error", NOTE, tuple(plots)) if plots else None


def _traces(runs: Sequence[Run], cost: Callable[[Run], float], error: Callable[[Run], float],
            url: Callable[[Run], str]) -> list[Trace]:  # fmt: skip
    families: dict[tuple[str, str, str], list[Run]] = {}
    for c in runs:
        if math.isfinite(cost(c)) and math.isfinite(error(c)):
            families.setdefault((c.method, f"{c.record.max_step_s}", c.record.label), []).append(c)
    out, seen = [], dict.fromkeys((c.record.solver for c in runs), 0)
    for (method, _, label), own in families.items():
        own.sort(key=lambda c: c.fineness)
        solver = own[0].record.solver
        for joined, part in ((True, [c for c in own if not c.stopped]), (False, [c for c in own if c.stopped])):
            if part:
                out.append(Trace(
                    f"{method} ({label})" if label else method, np.array([cost(c) for c in part]),
                    np.array([error(c) for c in part]), solver=solver, mode="lines+markers" if joined else "markers",
                    dash=seen[solver], group=label, urls=[url(c) for c in part], words=[_words(c) for c in part],
                    ends=["failed" if c.stopped else "wrong" if c.status == "wrong" else "" for c in part],
                ))  # fmt: skip
        seen[solver] += 1
    return out


def _words(c: Run) -> str:
    return f"{c.step_words}, {c.status.replace('_', ' ')}, {_spread(c)}, {c.record.steps} steps"


def _spread(c: Run) -> str:
    r = c.record
    if r.repeats > 1:
        return f"CPU {seconds(r.cpu_min_s)} to {seconds(r.cpu_max_s)} in {r.repeats} repeats"
    return f"CPU {seconds(r.cpu_median_s)}, single timing"
