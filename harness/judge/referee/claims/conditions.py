"""Find which settings decide a claim.

A condition that separates can be stated in a line: values of one dimension, or of two together, with which the claim
always and without which it never holds, or the reverse. Without such a condition, values and pairs with which it always
or never holds are listed. Conditions are found in the map, not written by hand.
"""

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from ....results.judgements.claims import Condition, Decision, SettingsCount
from .frame import find_varied, list_values, make_sort_key

Points = Sequence[tuple[Mapping[str, Any], bool]]  # values of a setting by dimension, and whether the claim holds
MOST_VALUES = 3  # most values of a dimension that a condition names one by one
MOST_NAMED = 4  # most conditions of each kind; the others are in the map
MOST_SUFFICIENT = 5  # most sufficient conditions that a verdict names
WHOSE = ("problem", "solver")  # dimensions to which all others belong, as parameters or options
MOST_TOGETHER = 3  # most dimensions in a sufficient condition


def _group_points(points: Points, *names: str) -> list[tuple[dict[str, Any], list[int]]]:
    """Return each combination of values of the dimensions ``names`` that occurs, with the indices of its points.

    Combinations are sorted by their values; None stands for a dimension that a setting does not have.
    """
    found: dict[tuple[Any, ...], list[int]] = {}
    for k, (at, _) in enumerate(points):
        values = [at.get(n) for n in names]
        found.setdefault(tuple((isinstance(v, bool), v) for v in values), []).append(k)  # True differs from 1
    rows = [({n: v for n, (_, v) in zip(names, key, strict=True)}, where) for key, where in found.items()]
    return sorted(rows, key=lambda row: [make_sort_key(v) for v in row[0].values()])


def _count_holding(points: Points, where: Collection[int]) -> tuple[int, int]:
    """Return in how many of the settings ``where`` (indices) the claim holds, and their number."""
    return sum(points[k][1] for k in where), len(where)


def count_values(points: Points, name: str) -> tuple[SettingsCount, ...]:
    """Count the settings with each value of one dimension, and those of them where the claim holds."""
    return tuple(SettingsCount(at[name], *_count_holding(points, where)) for at, where in _group_points(points, name))


def count_factors(points: Points) -> dict[str, tuple[SettingsCount, ...]]:
    """Count the settings with each value of each dimension that varies, and the settings where the claim holds."""
    return {n: count_values(points, n) for n in find_varied([at for at, _ in points])}


def find_separation(points: Points) -> Decision | None:
    """Return the condition that separates settings where the claim holds from the others; None if no short one does.

    It names values of one dimension, or of two together.
    """
    # other dimensions exist for some solvers only
    everywhere = [n for n, values in _find_free(points).items() if None not in values]
    for chosen in _combine_names(everywhere, 1, 2):
        found = [Condition(at, *_count_holding(points, where)) for at, where in _group_points(points, *chosen)]
        if all(c.holds in (0, c.settings) for c in found):
            for unless in (False, True):
                if by := _find_block(chosen, found, unless):
                    inside = [k for k, (_, holds) in enumerate(points) if holds is not unless]
                    named = {n: (v,) for n, v in _find_owners(points, inside, by).items()}
                    return Decision(named | by, unless)
    return None


def _combine_names(names: Iterable[str], *sizes: int) -> Iterable[tuple[str, ...]]:
    """Return all combinations of ``names`` of each of the ``sizes``, such as all single names and then all pairs."""
    known = tuple(names)
    return itertools.chain.from_iterable(itertools.combinations(known, size) for size in sizes)


def _find_free(points: Points) -> dict[str, list[Any]]:
    """Return the dimensions that vary, each with its values, without those that the problem determines.

    A condition on one of the latter would only be a condition on the problem by another name.
    """
    names = find_varied([at for at, _ in points])
    if "problem" not in names:
        return names
    values = {n: {(str(at.get("problem")), str(at.get(n))) for at, _ in points} for n in names}
    return {n: v for n, v in names.items() if n == "problem" or len(values[n]) > len(names["problem"])}


def _find_owners(points: Points, where: Iterable[int], at: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem and the solver that a condition must name in addition to its values ``at``.

    A step limit belongs to one problem and an option to one solver: a condition on its value alone would seem to hold
    for all problems and solvers. They are named if they vary, and if all settings ``where`` (indices) the condition
    holds share them.
    """
    if at.keys() <= set(WHOSE):
        return {}
    found = {n: list_values(points[k][0].get(n) for k in where) for n in WHOSE if n not in at}
    varied = find_varied([w for w, _ in points])
    return {n: v[0] for n, v in found.items() if n in varied and len(v) == 1}


def _name_condition(points: Points, at: Mapping[str, Any], where: Collection[int]) -> Condition:
    """Return the condition that names the values ``at`` and their owners (``_find_owners``), with its counts.

    ``where`` are the indices of the settings that it describes.
    """
    return Condition({**_find_owners(points, where, at), **at}, *_count_holding(points, where))


def _find_block(chosen: Sequence[str], found: Sequence[Condition], unless: bool) -> dict[str, tuple[Any, ...]]:
    """Return values of each ``chosen`` dimension whose combinations are exactly those where the claim holds.

    With ``unless``, exactly those where it does not hold. Empty if no such values exist, or more than ``MOST_VALUES``.
    ``found`` are conditions on all combinations that occur. Several numbers that are the smallest or the largest ones
    of a dimension are named by their limit: ``at most 0.01``.
    """
    inside = [c for c in found if bool(c.holds) is not unless]
    at = {n: tuple(list_values(c.at[n] for c in inside)) for n in chosen}
    if sum(all(c.at[n] in at[n] for n in chosen) for c in found) != len(inside):
        return {}
    said = {n: _find_limit(v, list_values(c.at[n] for c in found)) or v for n, v in at.items()}
    return said if all(len(v) <= MOST_VALUES for v in said.values()) else {}


def _find_limit(values: Sequence[Any], every: Sequence[Any]) -> tuple[str, ...]:
    """Return a limit in words, such as ``at most 0.01``, that selects ``values`` among ``every``, in a tuple of one.

    The tuple is empty unless ``values`` are several numbers, the smallest or the largest ones of ``every``, all values
    of the dimension in order.
    """
    numbers = [v for v in every if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(numbers) < len(every) or not 1 < len(values) < len(every):
        return ()
    if list(values) == list(every[: len(values)]):
        return (f"at most {values[-1]:g}",)
    return (f"at least {values[0]:g}",) if list(values) == list(every[-len(values) :]) else ()


def find_decision(points: Points) -> Decision:
    """Return which values of dimensions decide a claim that holds for some settings only.

    They are those of the condition that separates the settings. Without one, the result has conditions with which the
    claim always or never holds, combinations that suffice, and the dimension that separates best, with its counts.
    """
    if found := find_separation(points):
        return found
    names = _find_free(points)
    pure = (*_find_pure(points, names, True), *_find_pure(points, names, False))
    told = {n: count_values(points, n) for n in names}
    telling = [n for n in names if None not in names[n]] or list(names)
    most = max(telling, key=lambda n: _measure_information(points, told[n]), default="")
    return Decision({}, False, pure, most, *find_sufficient(points), told.get(most, ()))


def decide_along(name: str, met: Iterable[Any], tried: Iterable[Any]) -> Decision:
    """Return the values of the dimension ``name`` that meet a claim as a decision.

    They are named one by one or, if there are more than ``MOST_VALUES``, which must then be numbers, as ranges such as
    ``0.1 to 0.4``. ``met`` are the values that meet the claim, ``tried`` all values.
    """
    values = list_values(met)
    if len(values) <= MOST_VALUES:
        return Decision({name: tuple(values)})
    neighbours = itertools.groupby(list_values(tried), key=values.__contains__)
    runs = [list(run) for meets, run in neighbours if meets]
    return Decision({name: tuple(f"{r[0]:g} to {r[-1]:g}" if len(r) > 1 else f"{r[0]:g}" for r in runs)})


def find_sufficient(points: Points) -> tuple[tuple[Condition, ...], int]:
    """Return combinations of values with which the claim always holds, and how many settings they leave uncovered.

    Combinations of the fewest dimensions, at most ``MOST_TOGETHER``, come first, then those that cover the most
    settings not covered by those before. One that names a single setting is used only among the combinations of the
    most dimensions. The second result counts the settings where the claim holds that no combination covers.
    """
    names = sorted(_find_free(points))
    uncovered = {k for k, (_, holds) in enumerate(points) if holds}
    out: list[Condition] = []
    for size in range(1, MOST_TOGETHER + 1):
        groups = (g for chosen in _combine_names(names, size) for g in _group_points(points, *chosen))
        pure = [g for g in groups if _is_pure(points, *g, True)] if uncovered else []
        while uncovered and len(out) < MOST_SUFFICIENT:
            # the most newly covered settings first, then the most settings (both counts negative, for ``min``); ties by
            # name, so that the order of settings has no effect
            ranks = ((-len(uncovered.intersection(w)), -len(w), repr(sorted(at.items())), at, w) for at, w in pure)
            covered, total, _, at, where = min(ranks, key=lambda r: r[:3], default=(0, 0, "", {}, []))
            if not covered or (total == -1 and size < min(MOST_TOGETHER, len(names))):
                break
            out.append(_name_condition(points, at, where))
            uncovered.difference_update(where)
    return tuple(out), len(uncovered)


def _is_pure(points: Points, at: Mapping[str, Any], where: Collection[int], wanted: bool) -> bool:
    """Return whether the claim always holds in the settings ``where`` (indices) or, if not ``wanted``, never.

    False if one of their common values ``at`` is None: a dimension that they do not have.
    """
    holds, total = _count_holding(points, where)
    return None not in at.values() and holds == (total if wanted else 0)


def _find_pure(points: Points, names: Iterable[str], wanted: bool) -> list[Condition]:
    """Return values and pairs of values with which the claim always (``wanted``) or never holds, the widest first.

    Those whose settings lie within the settings of another are left out, and at most ``MOST_NAMED`` are returned.
    """
    found: list[tuple[dict[str, Any], list[int]]] = []
    for chosen in _combine_names(names, 1, 2):
        for at, where in _group_points(points, *chosen):
            if _is_pure(points, at, where, wanted) and not any(set(where) <= set(wider) for _, wider in found):
                found.append((at, where))
    found.sort(key=lambda item: -len(item[1]))  # stable: ties keep the order of the dimensions
    return [_name_condition(points, *item) for item in found[:MOST_NAMED]]


def _measure_information(points: Points, counts: Sequence[SettingsCount]) -> float:
    """Return by how much the entropy of whether the claim holds falls when a dimension's value is known [bits].

    ``counts`` are the settings by that value.
    """
    rest = sum(c.settings * _measure_entropy(c.holds, c.settings) for c in counts)
    return _measure_entropy(*_count_holding(points, range(len(points)))) - rest / len(points)


def _measure_entropy(holds: int, total: int) -> float:
    """Return the entropy of a yes-or-no answer that is yes in ``holds`` of ``total`` cases [bits]."""
    p = holds / total if total else 0.0
    return -sum(q * math.log2(q) for q in (p, 1.0 - p) if q > 0.0)
