"""The runs that a figure asks for, found in a run; one that is not there stays in the list, to be said."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..model.results import Run, named, text_of
from .spec import Pick


@dataclass(frozen=True)
class Chosen:
    """A pick and its run; None where the run has none with these settings."""

    pick: Pick
    run: Run | None


def choose(picks: Iterable[Pick], runs: Iterable[Run]) -> list[Chosen]:
    """Each pick with its run. Of two runs that differ in limits, the one with more room; else the later one."""
    ordered = sorted(runs, key=lambda c: (c.record.max_steps, c.record.finished))
    return [Chosen(p, next((c for c in reversed(ordered) if fits(p, c)), None)) for p in picks]


def fits(pick: Pick, run: Run) -> bool:
    """Whether ``run`` has exactly the pick's settings; limits and labels do not matter."""
    r = run.record
    return (
        (r.solver, r.problem) == (pick.solver, pick.problem)
        and _same(run.parameters, pick.parameters)
        and _same(run.options, pick.options)
        and _equal(r.dt_s, pick.dt)
        and _equal(r.rtol, pick.rtol)
        and _equal(r.max_step_s, pick.max_step)
    )


def settings_of(pick: Pick) -> str:
    """In words, as ``Run.settings`` says them."""
    words = [f"{k} = {v:g}{u}" for k, v, u in (("dt", pick.dt, " s"), ("rtol", pick.rtol, "")) if v is not None]
    words += [f"max step {pick.max_step:g} s"] if pick.max_step is not None else []
    words += [f"{k} = {text_of(v)}" for k, v in sorted(pick.options.items())]
    return ", ".join(words)


def asked_for(pick: Pick) -> str:
    """The whole of it in one line: what to run to have it."""
    return f"{pick.solver} on {named(pick.problem, pick.parameters)}, {settings_of(pick)}"


def _same(found: Mapping[str, Any], asked: Mapping[str, Any]) -> bool:
    return dict(found) == json.loads(json.dumps(dict(asked)))


def _equal(found: float, asked: float | None) -> bool:
    return math.isnan(found) if asked is None else math.isclose(found, asked, rel_tol=1e-12)
