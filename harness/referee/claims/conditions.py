"""Which settings decide: a small decision over single dimensions and pairs of them, in words with counts.

A verdict CONDITIONAL must name its conditions, and they are found in the map, not written by hand: one dimension that
separates what holds from what does not, else two together, else the values and pairs that always or never hold.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

from .maps import values_of

Points = Sequence[tuple[Mapping[str, Any], bool]]
MOST_NAMED = 4  # statements of each kind; the rest is in the map
MOST_LISTED = 6  # combinations of a pair that are listed one by one
SAID = {
    "lambda_in_error_test": ("multipliers in the error test", "multipliers outside the error test"),
    "velocities_in_error_test": ("velocities in the error test", "velocities outside the error test"),
    "consistent_start": ("a consistent start", "a start from lambda = 0"),
}


def factors(points: Points) -> dict[str, dict[str, list[int]]]:
    """For each dimension that varies, each value: ``[settings where it holds, settings]``."""
    return {
        name: {said(name, v): list(_count(points, {name: v})) for v in values}
        for name, values in _varied(points).items()
    }


def decision(points: Points) -> str:
    """What separates the settings where the claim holds from those where it does not."""
    names = _varied(points)
    everywhere = [n for n, values in names.items() if None not in values]  # others exist for some solvers only
    for size in (1, 2):
        for chosen in itertools.combinations(everywhere, size):
            specs = _cross(points, {n: names[n] for n in chosen})
            if all(held in (0, total) for _, held, total in specs):
                return _separated(chosen, specs)
    return _mixed(points, names)


def said(name: str, value: Any) -> str:
    """A value of a dimension in words: ``gain 5``, ``a consistent start``."""
    if isinstance(value, bool):
        yes, no = SAID.get(name, (name.replace("_", " "), f"no {name.replace('_', ' ')}"))
        return yes if value else no
    if value is None:
        return f"no {name.replace('_', ' ')}"
    if name in ("problem", "solver", "frame"):
        return str(value)
    return (
        f"{name.replace('_', ' ')} {value:g}" if isinstance(value, int | float) else f"{name.replace('_', ' ')} {value}"
    )


def _separated(chosen: Sequence[str], specs: Sequence[tuple[Mapping[str, Any], int, int]]) -> str:
    """Both sides by name where they are short, else the shorter one by name and the rest in a count."""
    where = " and ".join(n.replace("_", " ") for n in chosen)
    decides = "decides alone" if len(chosen) == 1 else "decide together"
    yes, no = [c for c in specs if c[1]], [c for c in specs if not c[1]]
    whole = len(specs) <= MOST_LISTED
    holds = _listed(yes) if whole or len(yes) <= len(no) else f"all else ({_sums(yes)})"
    fails = _listed(no) if whole or len(yes) > len(no) else f"anything else ({_sums(no)})"
    return f"{where} {decides}: holds with {holds}, not with {fails}"


def _listed(specs: Sequence[tuple[Mapping[str, Any], int, int]]) -> str:
    more = f"; and {len(specs) - MOST_LISTED} more" if len(specs) > MOST_LISTED else ""
    return "; ".join(f"{_said(at)} ({held} of {total})" for at, held, total in specs[:MOST_LISTED]) + more


def _sums(specs: Sequence[tuple[Mapping[str, Any], int, int]]) -> str:
    return f"{sum(c[1] for c in specs)} of {sum(c[2] for c in specs)}"


def _mixed(points: Points, names: Mapping[str, list[Any]]) -> str:
    """No one or two dimensions separate: values and pairs that always or never hold, then the most telling factor."""
    parts = []
    for word, wanted in (("always with", True), ("never with", False)):
        pure: list[tuple[Mapping[str, Any], frozenset[int]]] = []
        for size in (1, 2):
            for chosen in itertools.combinations(names, size):
                known = {n: [v for v in names[n] if v is not None] for n in chosen}
                for at, held, total in _cross(points, known):
                    here = _where(points, at)
                    said_already = any(here <= wider for _, wider in pure)
                    if held == (total if wanted else 0) and not said_already:
                        pure.append((at, here))
        pure.sort(key=lambda item: -len(item[1]))  # stable: ties stay in the order of the dimensions
        counts = [(at, len(here)) for at, here in pure[:MOST_NAMED]]
        listed = [f"{_said(at)} ({total if wanted else 0} of {total})" for at, total in counts]
        if listed:
            parts.append(f"{word} {'; '.join(listed)}")
    telling = [n for n in names if None not in names[n]] or list(names)
    best = max(telling, key=lambda n: _told(points, n, names[n]), default="")
    if best:
        counted = ", ".join(f"{said(best, v)} {held} of {total}" for v, (held, total) in _by(points, best, names[best]))
        parts.append(f"{best.replace('_', ' ')} tells most: {counted}")
    return "; ".join(parts) or "no dimension varies"


def _told(points: Points, name: str, values: Sequence[Any]) -> float:
    """How much is known about holding once the value is: the fall of entropy [bits]."""
    rest = sum(total * _entropy(held, total) for _, (held, total) in _by(points, name, values))
    return _entropy(sum(h for _, h in points), len(points)) - rest / len(points)


def _entropy(held: int, total: int) -> float:
    p = held / total if total else 0.0
    return -sum(q * math.log2(q) for q in (p, 1.0 - p) if q > 0.0)


def _varied(points: Points) -> dict[str, list[Any]]:
    names = dict.fromkeys(k for at, _ in points for k in at)
    found = {n: values_of(at.get(n) for at, _ in points) for n in names}
    return {n: v for n, v in found.items() if len(v) > 1}


def _by(points: Points, name: str, values: Sequence[Any]) -> list[tuple[Any, tuple[int, int]]]:
    return [(v, _count(points, {name: v})) for v in values]


def _cross(points: Points, chosen: Mapping[str, Sequence[Any]]) -> list[tuple[dict[str, Any], int, int]]:
    """Each combination that occurs, with the settings where it holds and all of them."""
    out = []
    for values in itertools.product(*chosen.values()):
        at = dict(zip(chosen, values, strict=True))
        held, total = _count(points, at)
        if total:
            out.append((at, held, total))
    return out


def _count(points: Points, at: Mapping[str, Any]) -> tuple[int, int]:
    here = _where(points, at)
    return sum(points[k][1] for k in here), len(here)


def _where(points: Points, at: Mapping[str, Any]) -> frozenset[int]:
    return frozenset(k for k, (where, _) in enumerate(points) if all(_equal(where.get(n), v) for n, v in at.items()))


def _equal(a: Any, b: Any) -> bool:
    return bool(a == b) and isinstance(a, bool) == isinstance(b, bool)


def _said(at: Mapping[str, Any]) -> str:
    return " and ".join(said(n, v) for n, v in at.items())
