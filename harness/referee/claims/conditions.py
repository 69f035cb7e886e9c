"""Which settings decide. A condition that separates is one that a reader can say in a line: values of one dimension, or
of two together, with which the claim always and without which it never holds, or the other way round. Where there is
none, the values and pairs with which it always or never holds. Conditions are found in the map, not written by hand.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...results.judgements.claims import Condition, Count, Decision
from .maps import find_varied, same, values_of

Points = Sequence[tuple[Mapping[str, Any], bool]]
MOST_VALUES = 3  # of a dimension that a condition names one by one
MOST_NAMED = 4  # conditions of each kind; the rest is in the map
MOST_SUFFICIENT = 5  # conditions, each of which suffices, that a verdict names
MOST_TOGETHER = 3  # dimensions of one of these


def factors(points: Points) -> dict[str, tuple[Count, ...]]:
    """For each dimension that varies, the settings with each value."""
    return {n: tuple(_by(points, n, values)) for n, values in find_varied([at for at, _ in points]).items()}


def separation(points: Points) -> Decision | None:
    """The condition that separates the settings where the claim holds from the others; None if no short one does."""
    names = find_varied([at for at, _ in points])
    everywhere = [n for n, values in names.items() if None not in values]  # others exist for some solvers only
    for size in (1, 2):
        for chosen in itertools.combinations(everywhere, size):
            found = _cross(points, {n: names[n] for n in chosen})
            if all(c.holds in (0, c.settings) for c in found):
                for unless in (False, True):
                    if at := _block(chosen, found, unless):
                        return Decision(at, unless)
    return None


def _block(chosen: Sequence[str], found: Sequence[Condition], unless: bool) -> dict[str, tuple[Any, ...]]:
    """The values whose combinations are just those that hold (``unless``: do not); empty where they are not, or many.

    Several numbers at one end of their order are said by their limit: ``at most 0.01``.
    """
    inside = [c for c in found if bool(c.holds) is not unless]
    at = {n: tuple(values_of(c.at[n] for c in inside)) for n in chosen}
    if sum(all(c.at[n] in at[n] for n in chosen) for c in found) != len(inside):
        return {}
    said = {n: _limit(v, values_of(c.at[n] for c in found)) or v for n, v in at.items()}
    return said if all(len(v) <= MOST_VALUES for v in said.values()) else {}


def _limit(values: Sequence[Any], every: Sequence[Any]) -> tuple[str, ...]:
    """``at most 0.01``, where ``values`` are several numbers at one end of ``every``; else empty."""
    numbers = [v for v in every if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(numbers) < len(every) or not 1 < len(values) < len(every):
        return ()
    if list(values) == list(every[: len(values)]):
        return (f"at most {values[-1]:g}",)
    return (f"at least {values[0]:g}",) if list(values) == list(every[-len(values) :]) else ()


def decision(points: Points) -> Decision:
    """The condition that separates, else where the claim always or never holds, and the dimension that tells most."""
    if found := separation(points):
        return found
    names = find_varied([at for at, _ in points])
    pure = (*_pure(points, names, True), *_pure(points, names, False))
    telling = [n for n in names if None not in names[n]] or list(names)
    most = max(telling, key=lambda n: _information(points, _by(points, n, names[n])), default="")
    enough = sufficient(points)
    told = tuple(_by(points, most, names[most])) if most else ()
    return Decision({}, False, pure, most, enough, _count_outside(points, enough), told)


def decide_along(name: str, met: Sequence[Any], tried: Sequence[Any]) -> Decision:
    """The values along a dimension that meet a claim, of those tried: one by one, or ranges of neighbours."""
    values = values_of(met)
    if len(values) <= MOST_VALUES:
        return Decision({name: tuple(values)})
    runs: list[list[Any]] = []
    ordered = values_of(tried)
    for before, v in zip([None, *ordered], ordered, strict=False):
        if v in values:
            runs[-1].append(v) if runs and runs[-1][-1] == before else runs.append([v])
    return Decision({name: tuple(f"{r[0]:g} to {r[-1]:g}" if len(r) > 1 else f"{r[0]:g}" for r in runs)})


def sufficient(points: Points) -> tuple[Condition, ...]:
    """Values of up to three dimensions with which the claim always holds, the fewest, then those of most settings.

    Each holds in a setting that the ones before leave out; what none of them covers is a setting on its own.
    """
    names = sorted(find_varied([at for at, _ in points]))
    left = [k for k, (_, holds) in enumerate(points) if holds]
    out: list[Condition] = []
    for size in range(1, MOST_TOGETHER + 1):
        while left and len(out) < MOST_SUFFICIENT:
            best = _find_widest(points, names, size, left)
            if best is None or (best.settings == 1 and size < min(MOST_TOGETHER, len(names))):
                break
            out.append(best)
            left = [k for k in left if not _is_at(points[k][0], best.at)]
    return tuple(out)


def _find_widest(points: Points, names: Sequence[str], size: int, left: Sequence[int]) -> Condition | None:
    """Of the values with which the claim always holds, those of the most settings that are still to be covered."""
    best, rank = None, (0, 0, "")  # ties by name, so that the order of the settings is without effect
    for chosen in itertools.combinations(names, size):
        counts: dict[tuple[Any, ...], list[int]] = {}
        for k, (at, holds) in enumerate(points):
            count = counts.setdefault(_key(at.get(n) for n in chosen), [0, 0, 0, k])
            count[0] += holds
            count[1] += 1
        for k in left:
            counts[_key(points[k][0].get(n) for n in chosen)][2] += 1
        for holding, total, new, k in counts.values():
            at = {n: points[k][0].get(n) for n in chosen}
            if new and holding == total and None not in at.values():
                own = (-new, -total, repr(sorted(at.items())))
                if best is None or own < rank:
                    best, rank = Condition(at, holding, total), own
    return best


def _is_at(at: Mapping[str, Any], wanted: Mapping[str, Any]) -> bool:
    return all(same(at.get(n), v) for n, v in wanted.items())


def _count_outside(points: Points, conditions: Sequence[Condition]) -> int:
    return sum(holds and not any(_is_at(at, c.at) for c in conditions) for at, holds in points)


def _pure(points: Points, names: Mapping[str, list[Any]], wanted: bool) -> list[Condition]:
    """Values and pairs with which the claim always (or never) holds, those of most settings; none within another."""
    found: list[tuple[Condition, frozenset[int]]] = []
    for size in (1, 2):
        for chosen in itertools.combinations(names, size):
            for c in _cross(points, {n: [v for v in names[n] if v is not None] for n in chosen}):
                here = _where(points, c.at)
                if c.holds == (c.settings if wanted else 0) and not any(here <= wider for _, wider in found):
                    found.append((c, here))
    found.sort(key=lambda item: -item[0].settings)  # stable: ties stay in the order of the dimensions
    return [c for c, _ in found[:MOST_NAMED]]


def _information(points: Points, counts: Sequence[Count]) -> float:
    """How much is known about holding once the value is: the fall of entropy [bits]."""
    rest = sum(c.settings * _entropy(c.holds, c.settings) for c in counts)
    return _entropy(sum(holds for _, holds in points), len(points)) - rest / len(points)


def _entropy(holds: int, total: int) -> float:
    p = holds / total if total else 0.0
    return -sum(q * math.log2(q) for q in (p, 1.0 - p) if q > 0.0)


def _by(points: Points, name: str, values: Sequence[Any]) -> list[Count]:
    return [Count(c.at[name], c.holds, c.settings) for c in _cross(points, {name: values})]


def _cross(points: Points, chosen: Mapping[str, Sequence[Any]]) -> list[Condition]:
    """Each combination that occurs, in the order of the values."""
    counts: dict[tuple[Any, ...], list[bool]] = {}
    for at, holds in points:
        counts.setdefault(_key(at.get(n) for n in chosen), []).append(holds)
    found = (dict(zip(chosen, values, strict=True)) for values in itertools.product(*chosen.values()))
    return [Condition(at, sum(own), len(own)) for at in found if (own := counts.get(_key(at.values())))]


def _key(values: Iterable[Any]) -> tuple[Any, ...]:
    return tuple((isinstance(v, bool), v) for v in values)  # True is no 1


def _where(points: Points, at: Mapping[str, Any]) -> frozenset[int]:
    return frozenset(k for k, (where, _) in enumerate(points) if _is_at(where, at))
