"""The cells that a figure asks for, found in a run; one that is not there stays in the list, to be said."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..model.reading import Cell, named, text_of
from .spec import Pick


@dataclass(frozen=True)
class Chosen:
    """A pick and its cell; None where the run has none with these settings."""

    pick: Pick
    cell: Cell | None


def choose(picks: Iterable[Pick], cells: Iterable[Cell]) -> list[Chosen]:
    """Each pick with its cell. Of two cells that differ in limits, the one with more room; else the later one."""
    ordered = sorted(cells, key=lambda c: (c.record.max_steps, c.record.finished))
    return [Chosen(p, next((c for c in reversed(ordered) if fits(p, c)), None)) for p in picks]


def fits(pick: Pick, cell: Cell) -> bool:
    """Whether ``cell`` has exactly the pick's settings; limits and labels do not matter."""
    r = cell.record
    return (
        (r.solver, r.problem) == (pick.solver, pick.problem)
        and _same(cell.parameters, pick.parameters)
        and _same(cell.options, pick.options)
        and _equal(r.dt_s, pick.dt)
        and _equal(r.rtol, pick.rtol)
        and _equal(r.max_step_s, pick.max_step)
    )


def settings_of(pick: Pick) -> str:
    """In words, as ``Cell.settings`` says them."""
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
