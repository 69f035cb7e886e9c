"""Which runs are shown: ten of a variant, or every failure, by a rule that the page states with the runs left out."""

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any

from ...model.results import Run, Variant

AT_MOST = 10  # of one mechanism; more only where more solvers fail, so that each failure is seen
SOUND = 3  # the best, the middle and the worst
RULE = (
    "The best, the middle and the worst of the runs that succeeded by their energy error, of each solver the one with "
    "the fewest options, then the finest; then of each solver one that is wrong or stopped; then those of the others "
    "that succeeded, and the rest, failures first. "
    "Settings that differ only in their label or in the number of steps allowed are shown once."
)


def cast(variant: Variant, moved: Sequence[str], at_most: int = AT_MOST) -> tuple[tuple[Run, ...], tuple[Run, ...]]:
    """The runs that play and those left out; ``moved`` are ids of runs with poses. The first is the solid one.

    The first is one that succeeded, with the fewest options and then the least energy drift.
    """
    can = [c for c in variant.runs if c.record.run_id in set(moved)]
    failing = {c.record.solver for c in can if not c.succeeded}
    at_most += max(len(failing) - (AT_MOST - SOUND), 0)
    chosen: list[Run] = []
    for run in _order(can):
        if len(chosen) < at_most and all(_setting(run) != _setting(other) for other in chosen):
            chosen.append(run)
    chosen.sort(key=_soundness)
    return tuple(chosen), tuple(c for c in variant.runs if c not in chosen)


def _order(can: Sequence[Run]) -> Iterator[Run]:
    """All of ``can``, the most telling first; some more than once."""
    firsts = _one_each(can, _solver, lambda c: (not c.succeeded, len(c.options), c.step_or_tolerance))
    known = {_method(c) for c in firsts}
    sound = sorted((c for c in firsts if c.succeeded), key=_soundness)
    yield from (sound[k] for k in (0, len(sound) // 2, -1) if sound)
    yield from _one_each([c for c in can if not c.succeeded], _solver, _broke)
    yield from firsts
    yield from (c for c in _one_each(can, _method, _broke) if _method(c) not in known)
    yield from sorted(can, key=_broke)


def _one_each(runs: Sequence[Run], by: Callable[[Run], Any], key: Callable[[Run], Any]) -> list[Run]:
    """Keep the first by ``key`` of those that are alike ``by`` something."""
    return [min(own, key=key) for _, own in groupby(sorted(runs, key=by), by)]


def _solver(c: Run) -> str:
    return c.record.solver


def _method(c: Run) -> tuple[str, str]:
    return c.record.label, c.record.solver


def _setting(c: Run) -> tuple[str, ...]:
    """Its settings, but for the label and the largest number of steps."""
    r = c.record
    return (r.solver, r.control, *map(repr, (r.dt_s, r.rtol, r.max_step_s, r.t_end_s)), repr(sorted(c.options.items())))


def _broke(c: Run) -> tuple[bool, bool, float]:
    return (not c.stopped, c.succeeded, c.step_or_tolerance)


def _soundness(c: Run) -> tuple[bool, int, float, str]:
    drift = c.record.energy_drift_max_J
    return (not c.succeeded, len(c.options), drift if drift == drift else float("inf"), c.record.run_id)
