"""Place a run in a map: its settings are dimensions under the names that claims use.

A dimension is an option of the solver or a parameter of the problem under its own name, except for those that solvers
name differently: ``tolerance`` (rtol, or the stop test of ODE-GC), ``gain`` (alpha = beta), ``chart``, ``step`` (dt),
``duration`` (t_end), ``frame`` (how problem and axes lie). A dimension that a selection does not name must have its
default, so that no claim collects runs it was not written for.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from ....catalogue import registry
from ....catalogue.suites.spec import RunSpec
from ....catalogue.suites.suite import load_suite

ANY = "any"
AS_PRINTED = "as printed"  # label in the suite ``paper``
FRAMES = ("yaw", "rotation", "perturb", "seed")  # parameters that the dimension ``frame`` stands for
RENAMED: Mapping[str, tuple[str, Mapping[Any, str]]] = {  # options with their dimension and the words for their values
    "coordinates": ("chart", {}),
    "accelerations": ("form", {"unknown": "fi", "eliminated": "se", "mass_matrix": "mass matrix"}),  # unknown: w = u'
}
ALIGNED = "aligned"  # value of ``frame`` without such parameters
WHOLE = "the whole run"  # step of a run in one step


@dataclass(frozen=True)
class PlacedRun:
    """A run with its dimensions.

    ``usual`` names those at their defaults, ``options`` those that are options of its solver.
    """

    spec: RunSpec
    dimensions: Mapping[str, Any]
    usual: frozenset[str]
    options: frozenset[str]


def read_dimensions(spec: RunSpec) -> PlacedRun:
    """Return the dimensions of a run, with defaults from the catalogue."""
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
    return PlacedRun(spec, given | asked, frozenset(given) - unusual - asked.keys(), frozenset(options))


@cache
def own_duration(problem: str) -> float:
    """Return the default simulated time of a problem [s]."""
    return float(registry.make_problem(problem, {}).t_end)


def select(places: Iterable[PlacedRun], selections: Sequence[Mapping[str, Any]]) -> tuple[PlacedRun, ...]:
    """Return the runs in at least one of the selections, in their order.

    A selection maps dimensions to their wanted values. Of two runs that differ only in their limits, the one with
    fewer steps is kept: a stuck run without a step limit would be ended by a clock.
    """
    out: dict[str, PlacedRun] = {}
    for p in places:
        if is_in(p, selections):
            key = repr(sorted((k, str(v)) for k, v in p.dimensions.items()))
            if key not in out or p.spec.control.max_steps < out[key].spec.control.max_steps:
                out[key] = p
    return tuple(out.values())


def find_varied(settings: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the dimensions with more than one value among ``settings``, each with its values in order."""
    names = dict.fromkeys(itertools.chain.from_iterable(settings))
    found = {k: list_values(at.get(k) for at in settings) for k in names}
    return {k: v for k, v in found.items() if len(v) > 1}


def list_values(given: Iterable[Any]) -> list[Any]:
    """Return each value once, numbers by size before texts; None, for a missing dimension, comes last."""
    return sorted(dict.fromkeys(given), key=_order)


def is_printed(p: PlacedRun, printed: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether the paper prints the settings of a run; ``printed`` lists the settings that it prints.

    A dimension with the value ``as printed`` must equal that of a run with this label in the suite ``paper``;
    dimensions that are not listed may have any value.
    """
    for one in printed:
        named = [k for k, v in one.items() if v == AS_PRINTED]
        given = all(_is_allowed(p.dimensions.get(k), v) for k, v in one.items() if k not in named)
        runs = _printed_runs(p.spec.problem, p.spec.solver) if named else (p,)
        if given and any(all(are_equal(p.dimensions.get(k), q.dimensions.get(k)) for k in named) for q in runs):
            return True
    return False


@cache
def _printed_runs(problem: str, solver: str) -> tuple[PlacedRun, ...]:
    """Return the runs of the suite ``paper`` for a problem and a solver that have the label ``as printed``."""
    wanted = (AS_PRINTED, problem, solver)
    return tuple(read_dimensions(s) for s in load_suite("paper").specs if (s.label, s.problem, s.solver) == wanted)


def _options(spec: RunSpec) -> tuple[dict[str, Any], set[str]]:
    """Return a run's options under the names of dimensions, defaults included, and the names of those it sets."""
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
    """Return the value of the dimension ``frame``: how the problem and its axes are oriented, in words."""
    if parameters.get("perturb"):
        return f"start perturbed by {parameters['perturb']:g}"
    if parameters.get("yaw"):
        return f"yawed by {parameters['yaw']:g} rad"
    if parameters.get("rotation"):
        return "rotated"
    return ALIGNED


def is_in(p: PlacedRun, selections: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether a run is in one of the selections, which map dimensions to wanted values."""
    return any(_matches(p, s) for s in selections)


def _matches(p: PlacedRun, selection: Mapping[str, Any]) -> bool:
    """Return whether a run has the values of a selection, and defaults in all dimensions it does not name."""
    for name, wanted in selection.items():  # called a million times: leave early, most runs are of another problem
        if wanted != ANY and not _is_allowed(p.dimensions.get(name), wanted):
            return False
    return p.dimensions.keys() <= selection.keys() | p.usual


def _is_allowed(value: Any, wanted: Any) -> bool:
    """Return whether a value of a dimension is the wanted one, one of a wanted list, or in a wanted range from-to."""
    if isinstance(wanted, dict):
        low, high = sorted((wanted["from"], wanted["to"]))
        return isinstance(value, int | float) and bool(low <= value <= high)
    return any(are_equal(value, w) for w in wanted) if isinstance(wanted, list) else are_equal(value, wanted)


def are_equal(value: Any, wanted: Any) -> bool:
    """Return whether two values of a dimension are equal; True differs from 1."""
    return bool(value == wanted) and isinstance(value, bool) == isinstance(wanted, bool)


def _order(value: Any) -> tuple[int, float, str]:
    """Return the sort key of a dimension's value: numbers, True, False, texts, None."""
    if value is None:
        return 3, 0.0, ""
    if isinstance(value, bool):
        return 1, float(not value), ""
    if isinstance(value, int | float):
        return 0, float(value), ""
    return 2, 0.0, str(value)
