"""Put choices into words: a value of a dimension, a setting, and the condition under which a claim holds."""

from collections.abc import Sequence

from ...harness.results.judgements import claims as judged
from .words import plural

MOST_LISTED = 6  # most combinations listed one by one
FLAGS = {
    "lambda_in_error_test": ("multipliers in the error test", "multipliers outside the error test"),
    "velocities_in_error_test": ("velocities in the error test", "velocities outside the error test"),
    "consistent_start": ("a consistent start", "a start from lambda = 0"),
}


def format_value(name: str, given: judged.Value) -> str:
    """Format the value ``given`` of the dimension ``name`` of a map: ``5``, ``a consistent start``."""
    if isinstance(given, bool):
        return FLAGS.get(name, (spell_out(name), f"no {spell_out(name)}"))[not given]
    if given is None:
        return f"no {spell_out(name)}"
    if isinstance(given, tuple):
        return f"({', '.join(f'{x:g}' for x in given)})"
    return given if isinstance(given, str) else f"{given:g}"


def format_setting(name: str, given: judged.Value) -> str:
    """Format a value with the name of its dimension where the value alone is not clear: ``gain 5``."""
    alone = given is None or isinstance(given, bool) or name in ("problem", "solver", "frame")
    return format_value(name, given) if alone else f"{spell_out(name)} {format_value(name, given)}"


def spell_out(name: str) -> str:
    """Replace the underscores of a name by spaces."""
    return name.replace("_", " ")


def describe_condition(d: judged.Decision, most: int | None = None) -> str:
    """Format a conditional verdict: ``reproduced if tolerance at most 1e-05``, ``reproduced unless gain 0``.

    Without such a condition on one or two dimensions, combinations of values that suffice are listed, at most ``most``
    of them if it is given.
    """
    if d.by:
        return f"reproduced {'unless' if d.unless else 'if'} {format_separation(d)}"
    if not d.any_of:
        return "reproduced if choices are made as in the rows that hold"
    terms = [" and ".join(_list_values(n, vs) for n, vs in at.items()) for at in _join_terms(d.any_of)]
    more = f", and in {plural(d.rest, 'setting')} more" if d.rest else ""
    if most and len(terms) > most:
        more = ", and in other settings"
    return f"reproduced if {', or if '.join(terms[:most])}{more}"


def is_met_by_choice(f: judged.ClaimFinding) -> bool:
    """Return whether every setting meets the claim at some value of a dimension of which one value suffices."""
    return bool(f.met and f.decision and f.decision.by and f.holds == f.settings)


def describe_choice(d: judged.Decision) -> str:
    """Describe a claim that holds if one value may be chosen: ``reproduced if the tolerance may be chosen, ...``."""
    return f"reproduced if the {spell_out(next(iter(d.by)))} may be chosen, all at {format_separation(d)}"


def _join_terms(conditions: Sequence[judged.Condition]) -> list[dict[str, list[judged.Value]]]:
    """Merge conditions that differ in the value of one dimension alone; return the values by dimension of each.

    Conditions ``gain 0, chart a`` and ``gain 5, chart a`` become ``{"gain": [0, 5], "chart": ["a"]}``.
    """
    out: list[dict[str, list[judged.Value]]] = []
    for c in conditions:
        for term in (t for t in out if t.keys() == c.at.keys()):
            differing = [n for n in term if c.at[n] not in term[n]]
            if len(differing) == 1 and all(len(values) == 1 for n, values in term.items() if n != differing[0]):
                term[differing[0]].append(c.at[differing[0]])
                break
        else:
            out.append({n: [v] for n, v in c.at.items()})
    return out


def _list_values(name: str, values: Sequence[judged.Value]) -> str:
    """Format the values of one dimension: ``tolerance 1e-10, 1e-09 or 3e-09``."""
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    ordered = sorted(values) if numbers else list(values)  # type: ignore[type-var]
    first, *rest = ordered
    return " or ".join([format_setting(name, first), *(format_value(name, v) for v in rest)])


def describe_decision(d: judged.Decision) -> str:
    """Describe the condition that separates the settings where a claim holds from the others.

    Without such a condition, describe the largest sets of settings where the claim always or never holds, and the
    dimension that separates them best.
    """
    if d.by:
        return (
            f"it holds with {format_separation(d)} never, and always without"
            if d.unless
            else (f"it holds with {format_separation(d)} always, and never without")
        )
    yes, no = ([x for x in d.conditions if bool(x.holds) is side] for side in (True, False))
    parts = [f"{word} with {_list_conditions(some)}" for word, some in (("always", yes), ("never", no)) if some]
    if d.told:
        parts.append(f"{spell_out(d.telling)} matters most: {_list_counts(d)}")
    return "; ".join(parts) or "no dimension varies"


def _list_counts(d: judged.Decision) -> str:
    """Format how many settings hold at each value of the dimension that separates best.

    ``gain 0 1 of 3, gain 5 3 of 3``; many values are counted as always, sometimes and never.
    """
    if len(d.told) <= MOST_LISTED:
        return ", ".join(f"{format_setting(d.telling, f.value)} {f.holds} of {f.settings}" for f in d.told)
    always, never = sum(f.holds == f.settings for f in d.told), sum(not f.holds for f in d.told)
    return f"of its {len(d.told)} values {always} always, {len(d.told) - always - never} sometimes, {never} never"


def format_separation(d: judged.Decision) -> str:
    """Format the values of a separating condition: ``tolerance 1e-05 or 1e-06 and gauge zero``."""
    return " and ".join(" or ".join(format_setting(name, v) for v in values) for name, values in d.by.items())


def _list_conditions(conditions: Sequence[judged.Condition]) -> str:
    """Format sets of settings with how many hold: ``gain 0 and chart quaternion (3 of 3)``; the rest is counted."""
    out = [
        f"{' and '.join(format_setting(n, v) for n, v in c.at.items())} ({c.holds} of {c.settings})" for c in conditions
    ]
    more = [f"and {len(out) - MOST_LISTED} more"] if len(out) > MOST_LISTED else []
    return "; ".join([*out[:MOST_LISTED], *more])
