"""Find which settings decide a claim.

A condition that separates can be stated in a line: values of one dimension, or of two together, with which the claim
always and without which it never holds, or the reverse. Without such a condition, values and pairs with which it always
or never holds are listed. Conditions are found in the map, not written by hand.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ....results.judgements.claims import Condition, Decision, SettingsCount
from .maps import are_equal, find_varied, list_values

Points = Sequence[tuple[Mapping[str, Any], bool]]  # values of a setting by dimension, and whether the claim holds
MOST_VALUES = 3  # most values of a dimension that a condition names one by one
MOST_NAMED = 4  # most conditions of each kind; the others are in the map
MOST_SUFFICIENT = 5  # most sufficient conditions that a verdict names
WHOSE = ("problem", "solver")  # dimensions to which all others belong, as parameters or options
MOST_TOGETHER = 3  # most dimensions in a sufficient condition


def factors(points: Points) -> dict[str, tuple[SettingsCount, ...]]:
    """Count the settings with each value of each dimension that varies, and the settings where the claim holds."""
    return {n: tuple(_by(points, n, values)) for n, values in find_varied([at for at, _ in points]).items()}


def separation(points: Points) -> Decision | None:
    """Return the condition that separates settings where the claim holds from the others; None if no short one does.

    It names values of one dimension, or of two together.
    """
    names = _find_free(points)
    # other dimensions exist for some solvers only
    everywhere = [n for n, values in names.items() if None not in values]
    for size in (1, 2):
        for chosen in itertools.combinations(everywhere, size):
            found = _cross(points, {n: names[n] for n in chosen})
            if all(c.holds in (0, c.settings) for c in found):
                for unless in (False, True):
                    if at := _block(chosen, found, unless):
                        inside = [where for where, holds in points if holds is not unless]
                        return Decision(_find_named(points, inside, at, lambda v: (v,)) | at, unless)
    return None


def _find_free(points: Points) -> dict[str, list[Any]]:
    """Return the dimensions that vary, each with its values, without those that the problem determines.

    A condition on the latter would name the dimension in place of the problem.
    """
    names = find_varied([at for at, _ in points])
    if "problem" not in names:
        return names
    values = {n: {(str(at.get("problem")), str(at.get(n))) for at, _ in points} for n in names}
    return {n: v for n, v in names.items() if n == "problem" or len(values[n]) > len(names["problem"])}


def _find_named(
    points: Points, inside: Sequence[Mapping[str, Any]], at: Mapping[str, Any], form: Callable[[Any], Any] = lambda v: v
) -> dict[str, Any]:
    """Return the problem and the solver that a condition must name in addition to its values ``at``.

    They are those that all settings ``inside`` the condition share. A step limit belongs to one problem and an option
    to one solver: a condition on its value alone would seem to hold for all of them. ``form`` wraps a value for the
    result.
    """
    if at.keys() <= set(WHOSE):
        return {}
    found = {n: list_values(w.get(n) for w in inside) for n in WHOSE if n not in at}
    varied = find_varied([w for w, _ in points])
    return {n: form(v[0]) for n, v in found.items() if n in varied and len(v) == 1}


def _block(chosen: Sequence[str], found: Sequence[Condition], unless: bool) -> dict[str, tuple[Any, ...]]:
    """Return values of each ``chosen`` dimension whose combinations are exactly those where the claim holds.

    With ``unless``, exactly those where it does not hold. Empty if no such values exist, or too many. ``found`` are all
    combinations that occur. Several numbers at one end of their order are named by their limit: ``at most 0.01``.
    """
    inside = [c for c in found if bool(c.holds) is not unless]
    at = {n: tuple(list_values(c.at[n] for c in inside)) for n in chosen}
    if sum(all(c.at[n] in at[n] for n in chosen) for c in found) != len(inside):
        return {}
    said = {n: _limit(v, list_values(c.at[n] for c in found)) or v for n, v in at.items()}
    return said if all(len(v) <= MOST_VALUES for v in said.values()) else {}


def _limit(values: Sequence[Any], every: Sequence[Any]) -> tuple[str, ...]:
    """Return ``at most 0.01`` (or at least) if ``values`` are several numbers at one end of ``every``.

    The text is in a tuple of one, which is otherwise empty. ``every`` are all values of the dimension, in order.
    """
    numbers = [v for v in every if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(numbers) < len(every) or not 1 < len(values) < len(every):
        return ()
    if list(values) == list(every[: len(values)]):
        return (f"at most {values[-1]:g}",)
    return (f"at least {values[0]:g}",) if list(values) == list(every[-len(values) :]) else ()


def decision(points: Points) -> Decision:
    """Return which settings decide a claim that holds for some settings only.

    It is the separating condition or, without one, where the claim always or never holds and the dimension that
    separates best.
    """
    if found := separation(points):
        return found
    names = _find_free(points)
    pure = (*_find_pure(points, names, True), *_find_pure(points, names, False))
    telling = [n for n in names if None not in names[n]] or list(names)
    most = max(telling, key=lambda n: _information(points, _by(points, n, names[n])), default="")
    enough = find_sufficient(points)
    told = tuple(_by(points, most, names[most])) if most else ()
    return Decision({}, False, pure, most, enough, _count_outside(points, enough), told)


def decide_along(name: str, met: Sequence[Any], tried: Sequence[Any]) -> Decision:
    """Return the values along dimension ``name`` that meet a claim, one by one or, if many, as ranges of neighbours.

    ``met`` are the values that meet it, ``tried`` all values; many values must be numbers.
    """
    values = list_values(met)
    if len(values) <= MOST_VALUES:
        return Decision({name: tuple(values)})
    runs: list[list[Any]] = []
    ordered = list_values(tried)
    for before, v in zip([None, *ordered], ordered, strict=False):
        if v in values:
            runs[-1].append(v) if runs and runs[-1][-1] == before else runs.append([v])
    return Decision({name: tuple(f"{r[0]:g} to {r[-1]:g}" if len(r) > 1 else f"{r[0]:g}" for r in runs)})


def find_sufficient(points: Points) -> tuple[Condition, ...]:
    """Return combinations of values of up to three dimensions with which the claim always holds.

    Combinations of the fewest dimensions come first, then those with the most settings. Each holds in a setting not
    covered by those before; a setting that none covers is named by itself.
    """
    names = sorted(_find_free(points))
    left = [k for k, (_, holds) in enumerate(points) if holds]
    out: list[Condition] = []
    for size in range(1, MOST_TOGETHER + 1):
        while left and len(out) < MOST_SUFFICIENT:
            best = _find_widest(points, names, size, left)
            if best is None or (best.settings == 1 and size < min(MOST_TOGETHER, len(names))):
                break
            out.append(_name(points, best))
            left = [k for k in left if not _is_at(points[k][0], best.at)]
    return tuple(out)


def _name(points: Points, c: Condition) -> Condition:
    """Return the condition with its problem and solver added, if its settings are of one problem or one solver."""
    inside = [at for at, _ in points if _is_at(at, c.at)]
    return Condition({**_find_named(points, inside, c.at), **c.at}, c.holds, c.settings)


def _find_widest(points: Points, names: Sequence[str], size: int, left: Sequence[int]) -> Condition | None:
    """Return the values of ``size`` dimensions with which the claim always holds and that cover most of ``left``.

    ``left`` are the indices of settings that are not covered yet. Return None if no values cover any of them.
    """
    best, rank = None, (0, 0, "")  # ties by name, so that the order of settings has no effect
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
    """Return whether a setting, ``at``, has all the wanted values."""
    return all(are_equal(at.get(n), v) for n, v in wanted.items())


def _count_outside(points: Points, conditions: Sequence[Condition]) -> int:
    """Count the settings where the claim holds that none of the conditions covers."""
    return sum(holds and not any(_is_at(at, c.at) for c in conditions) for at, holds in points)


def _find_pure(points: Points, names: Mapping[str, list[Any]], wanted: bool) -> list[Condition]:
    """Return values and pairs of values with which the claim always (``wanted``) or never holds, the widest first.

    Those whose settings lie within the settings of another are left out, and at most ``MOST_NAMED`` are returned.
    """
    found: list[tuple[Condition, frozenset[int]]] = []
    for size in (1, 2):
        for chosen in itertools.combinations(names, size):
            for c in _cross(points, {n: [v for v in names[n] if v is not None] for n in chosen}):
                here = _where(points, c.at)
                if c.holds == (c.settings if wanted else 0) and not any(here <= wider for _, wider in found):
                    found.append((c, here))
    found.sort(key=lambda item: -item[0].settings)  # stable: ties keep the order of the dimensions
    return [_name(points, c) for c, _ in found[:MOST_NAMED]]


def _information(points: Points, counts: Sequence[SettingsCount]) -> float:
    """Return by how much the entropy of whether the claim holds falls when a dimension's value is known [bits].

    ``counts`` are the settings by that value.
    """
    rest = sum(c.settings * _entropy(c.holds, c.settings) for c in counts)
    return _entropy(sum(holds for _, holds in points), len(points)) - rest / len(points)


def _entropy(holds: int, total: int) -> float:
    """Return the entropy of a yes-or-no answer that is yes in ``holds`` of ``total`` cases [bits]."""
    p = holds / total if total else 0.0
    return -sum(q * math.log2(q) for q in (p, 1.0 - p) if q > 0.0)


def _by(points: Points, name: str, values: Sequence[Any]) -> list[SettingsCount]:
    """Count the settings with each value of one dimension."""
    return [SettingsCount(c.at[name], c.holds, c.settings) for c in _cross(points, {name: values})]


def _cross(points: Points, chosen: Mapping[str, Sequence[Any]]) -> list[Condition]:
    """Return each combination of values of the chosen dimensions that occurs, with its count, in their order."""
    counts: dict[tuple[Any, ...], list[bool]] = {}
    for at, holds in points:
        counts.setdefault(_key(at.get(n) for n in chosen), []).append(holds)
    found = (dict(zip(chosen, values, strict=True)) for values in itertools.product(*chosen.values()))
    return [Condition(at, sum(own), len(own)) for at in found if (own := counts.get(_key(at.values())))]


def _key(values: Iterable[Any]) -> tuple[Any, ...]:
    """Return values as a key of a dict, in which True differs from 1."""
    return tuple((isinstance(v, bool), v) for v in values)  # True differs from 1


def _where(points: Points, at: Mapping[str, Any]) -> frozenset[int]:
    """Return the indices of the settings that have the values ``at``."""
    return frozenset(k for k, (where, _) in enumerate(points) if _is_at(where, at))
