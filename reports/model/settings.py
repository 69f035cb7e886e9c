"""Which settings tell the runs of a group apart: the others need not be repeated beside every line."""

from collections.abc import Iterable

from .results import Run


def shared_options(runs: Iterable[Run]) -> dict[str, frozenset[str]]:
    """By solver, the options (and ``max_step``) that all its runs have alike."""
    out: dict[str, frozenset[str]] = {}
    runs = list(runs)
    for name in {c.record.solver for c in runs}:
        own = [c for c in runs if c.record.solver == name]
        alike = {k for k in own[0].options if all(c.options.get(k) == own[0].options[k] for c in own)}
        if all(c.record.max_step_s == own[0].record.max_step_s for c in own):
            alike.add("max_step")
        out[name] = frozenset(alike)
    return out
