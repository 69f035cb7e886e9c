"""Where a run stands in a map: its settings as dimensions under the names that claims use.

A dimension is an option of the solver or a parameter of the problem under its own name, but for those that different
solvers name differently: ``tolerance`` (rtol, or the stop test of ODE-GC), ``gain`` (alpha = beta), ``chart``,
``step`` (dt), ``duration`` (t_end), ``frame`` (how problem and axes lie). What a selection does not name must be at
its default, so that no claim gathers runs it was not written for.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from ...catalogue import registry
from ...suites.spec import RunSpec
from ...suites.suite import load_suite

ANY = "any"
AS_PRINTED = "as printed"  # label in the suite ``paper``
FRAMES = ("yaw", "rotation", "perturb", "seed")
RENAMED: Mapping[str, tuple[str, Mapping[Any, str]]] = {  # options with their dimension, and other words for values
    "coordinates": ("chart", {}),
    "accelerations": ("form", {"unknown": "fi", "eliminated": "se", "mass_matrix": "mass matrix"}),  # unknown: w = u'
}
ALIGNED = "aligned"
WHOLE = "the whole run"  # of a run in one step


@dataclass(frozen=True)
class Place:
    """A run and its dimensions; ``usual`` holds those that are at their default."""

    spec: RunSpec
    dimensions: Mapping[str, Any]
    usual: frozenset[str]


def place(spec: RunSpec) -> Place:
    """The dimensions of a run, defaults filled in from the catalogue."""
    options, unusual = _options(spec)
    given: dict[str, Any] = {"problem": spec.problem, "solver": spec.solver}
    for name, (default, _) in registry.problems()[spec.problem].parameters.items():
        if name == "t_end":
            given["duration"] = spec.parameters.get("t_end") or own_duration(spec.problem)
            unusual |= {"duration"} if "t_end" in spec.parameters else set()
        elif name not in FRAMES:
            given[name] = spec.parameters.get(name, default)
            unusual |= {name} if name in spec.parameters else set()
    given["frame"] = _frame(spec.parameters)
    unusual |= {"frame"} if given["frame"] != ALIGNED else set()
    given |= options
    c = spec.control
    step = WHOLE if c.dt is not None and c.dt >= given["duration"] else c.dt
    asked = {k: v for k, v in (("tolerance", c.rtol), ("step", step), ("max_step", c.max_step)) if v is not None}
    # a step or tolerance is always asked for: a selection has to name it
    return Place(spec, given | asked, frozenset(given) - unusual - asked.keys())


@cache
def own_duration(problem: str) -> float:
    """The simulated time of a problem that is given none [s]."""
    return float(registry.make_problem(problem, {}).t_end)


def select(places: Iterable[Place], selections: Sequence[Mapping[str, Any]]) -> tuple[Place, ...]:
    """Those in one of the selections, in their order; of two that differ in limits alone that of fewer steps.

    A run without one that is stuck is ended by a clock.
    """
    out: dict[str, Place] = {}
    for p in places:
        if is_in(p, selections):
            key = repr(sorted((k, str(v)) for k, v in p.dimensions.items()))
            if key not in out or p.spec.control.max_steps < out[key].spec.control.max_steps:
                out[key] = p
    return tuple(out.values())


def find_varied(settings: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """The dimensions with more than one value among ``settings``, each with its values in order."""
    names = dict.fromkeys(itertools.chain.from_iterable(settings))
    found = {k: values_of(at.get(k) for at in settings) for k in names}
    return {k: v for k, v in found.items() if len(v) > 1}


def values_of(given: Iterable[Any]) -> list[Any]:
    """Each once, numbers by size before texts; None, where a dimension does not exist, comes last."""
    return sorted(dict.fromkeys(given), key=_order)


def is_printed(p: Place, printed: Iterable[Mapping[str, Any]]) -> bool:
    """Whether these are settings the paper prints, as far as it prints any.

    A dimension that is ``as printed`` has the value of a run with that label in the suite ``paper``.
    """
    for one in printed:
        named = [k for k, v in one.items() if v == AS_PRINTED]
        given = all(_is_allowed(p.dimensions.get(k), v) for k, v in one.items() if k not in named)
        runs = _printed_runs(p.spec.problem, p.spec.solver) if named else (p,)
        if given and any(all(same(p.dimensions.get(k), q.dimensions.get(k)) for k in named) for q in runs):
            return True
    return False


@cache
def _printed_runs(problem: str, solver: str) -> tuple[Place, ...]:
    wanted = (AS_PRINTED, problem, solver)
    return tuple(place(s) for s in load_suite("paper").specs if (s.label, s.problem, s.solver) == wanted)


def _options(spec: RunSpec) -> tuple[dict[str, Any], set[str]]:
    known = registry.solvers()[spec.solver].parameters
    options = {k: spec.options.get(k, default) for k, (default, _) in known.items()}
    unusual = {k for k in spec.options if k in known}
    if {"alpha", "beta"} <= options.keys():
        alpha, beta = options.pop("alpha"), options.pop("beta")
        options["gain"] = alpha if alpha == beta else f"{alpha:g}/{beta:g}"
        unusual = unusual - {"alpha", "beta"} | ({"gain"} if unusual & {"alpha", "beta"} else set())
    for old, (new, words) in RENAMED.items():
        if old in options:
            options[new] = words.get(value := options.pop(old), value)
            unusual = unusual - {old} | ({new} if old in unusual else set())
    return options, unusual


def _frame(parameters: Mapping[str, Any]) -> str:
    if parameters.get("perturb"):
        return f"start perturbed by {parameters['perturb']:g}"
    if parameters.get("yaw"):
        return f"yawed by {parameters['yaw']:g} rad"
    if parameters.get("rotation"):
        return "rotated"
    return ALIGNED


def is_in(p: Place, selections: Iterable[Mapping[str, Any]]) -> bool:
    """Whether the run is in one of the selections."""
    return any(_matches(p, s) for s in selections)


def _matches(p: Place, selection: Mapping[str, Any]) -> bool:
    for name, wanted in selection.items():  # a million times: most runs are of another problem
        if wanted != ANY and not _is_allowed(p.dimensions.get(name), wanted):
            return False
    return p.dimensions.keys() <= selection.keys() | p.usual


def _is_allowed(value: Any, wanted: Any) -> bool:
    if isinstance(wanted, dict):
        low, high = sorted((wanted["from"], wanted["to"]))
        return isinstance(value, int | float) and bool(low <= value <= high)
    return any(same(value, w) for w in wanted) if isinstance(wanted, list) else same(value, wanted)


def same(value: Any, wanted: Any) -> bool:
    """Whether two values of a dimension are one: True is no 1."""
    return bool(value == wanted) and isinstance(value, bool) == isinstance(wanted, bool)


def _order(value: Any) -> tuple[int, float, str]:
    if value is None:
        return 3, 0.0, ""
    if isinstance(value, bool):
        return 1, float(not value), ""
    if isinstance(value, int | float):
        return 0, float(value), ""
    return 2, 0.0, str(value)
