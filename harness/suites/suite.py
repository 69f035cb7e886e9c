"""Suites: TOML files that name the runs to run, products written as lists. Everything is checked before anything runs.

::

    name = "example"
    description = "one line"
    include = ["ci"]            # suites beside this file or in harness/suites/: their runs and plugins come first
    total_limit = 900.0         # [s] the whole run: what runs then is killed (stalled), what has not begun is left
    [defaults]                  # any key of a group but problem and solver; of this file alone
    wall_limit = 60.0           # [s] a run
    [[runs]]
    label = "recommended"
    problem = "spherical_pendulum"              # or a list
    parameters = { omega_z = [0.0, 0.1] }       # a list is a product; of a tuple-valued parameter give a list of lists
    solver = ["gc_weak_form", "rk45_strong_form"]
    options = { }
    dt = [0.02, 0.01]           # goes to the solvers controlled by dt, rtol and max_step to the others
    rtol = 1e-8

A run met again through an include is kept as first met, label and limits included; twice in one file it is an error.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..catalogue import registry
from ..catalogue.options import nearest
from ..catalogue.plugins import resolved
from ..sandbox.trial import tried
from ..types import Problem
from .includes import Source, SuiteError, path_of, read_source, source, suite_names, with_included
from .spec import RunSpec, make_spec

__all__ = ["Suite", "SuiteError", "load_suite", "parse_suite", "suite_names"]
LIMITS = ("wall_limit", "memory", "repeats", "label")
CONTROL = ("dt", "rtol", "max_step", "max_steps")
KEYS = (*LIMITS, *CONTROL, "parameters", "options", "problem", "solver")
MOST = {  # four months, a petabyte, and what a column of whole numbers can hold
    "total_limit": 1e7, "wall_limit": 1e7, "memory": 1e9, "repeats": 10**6, "max_steps": 2**63 - 1,
}  # fmt: skip
HEAD = ("schema", "name", "description", "include", "total_limit", "plugins", "defaults", "runs")


@dataclass(frozen=True)
class Suite:
    """Runs in the order of the files, each once."""

    name: str
    description: str
    specs: tuple[RunSpec, ...]
    text: str
    plugins: tuple[str, ...] = ()
    included: tuple[tuple[str, str], ...] = ()  # name and text of the suites it includes, for the run folder
    total_limit: float | None = None  # [s] wall time of a whole run


def load_suite(name: str, plugins: tuple[str, ...] = ()) -> Suite:
    """The suite of that name, or in that file."""
    return _suite(read_source(path_of(name)), plugins)


def parse_suite(text: str, name: str, where: str, beside: Path = Path(), plugins: tuple[str, ...] = ()) -> Suite:
    """The suite in ``text``; ``where`` names it in messages, plugins and includes are found ``beside`` it."""
    return _suite(source(text, name, where, beside), plugins)


def _suite(own: Source, plugins: tuple[str, ...]) -> Suite:
    sources = with_included(own)
    files = tuple(dict.fromkeys([*map(resolved, plugins), *(p for s in sources for p in _plugins(s))]))
    for s in sources:
        _known(s.plain, HEAD, s.where)
        if not s.plain.get("include") or "runs" in s.plain:
            _groups(s)
    specs = _tried(own, lambda: _expanded(own, sources, files)) if files else _expanded(own, sources, files)
    title = own.plain.get("name", own.name)
    if not isinstance(title, str) or not title or not title.replace("-", "").replace("_", "").isalnum():
        raise SuiteError(f"{own.where}: name must be letters, digits, - and _ (got {title!r})")
    total = own.plain.get("total_limit")
    if total is not None:
        _bounded("total_limit", total, own.where)
    included = tuple((s.name, s.text) for s in sources[:-1])
    return Suite(title, str(own.plain.get("description", "")), tuple(specs.values()), own.text, files, included, total)


def _tried(own: Source, expand: Callable[[], dict[str, RunSpec]]) -> dict[str, RunSpec]:
    """The runs of a suite with foreign code, which may hang, crash or leave when it is loaded or makes a problem."""
    try:
        return tried(own.where, expand)
    except SuiteError:
        raise
    except ValueError as error:
        raise SuiteError(" ".join(str(error).split())) from None


def _expanded(own: Source, sources: list[Source], files: tuple[str, ...]) -> dict[str, RunSpec]:
    """The runs of all files by their settings, each as first met."""
    try:
        for file in files:
            registry.load_plugin(file)
    except ValueError as error:
        raise SuiteError(f"{own.where}: {error}") from None
    made: dict[tuple[str, str], Problem] = {}
    specs: dict[str, RunSpec] = {}
    for s in sources:
        for settings, spec in _runs(s, made).items():
            specs.setdefault(settings, spec)
    return specs


def _plugins(s: Source) -> list[str]:
    own = _list(s.plain.get("plugins", []))
    if not all(isinstance(p, str) for p in own):
        raise SuiteError(f"{s.where}: plugins must be a list of file names")
    try:
        return [resolved(p, s.beside) for p in own]
    except (OSError, ValueError) as error:
        raise SuiteError(f"{s.where}: plugins: {error}") from None


def _groups(s: Source) -> list[dict[str, Any]]:
    groups = s.plain.get("runs", [])
    if not isinstance(groups, list) or not groups or not all(isinstance(g, dict) for g in groups):
        raise SuiteError(f"{s.where}: a suite needs at least one [[runs]] group")
    return groups


def _runs(s: Source, made: dict[tuple[str, str], Problem]) -> dict[str, RunSpec]:
    """The runs of one file by their settings."""
    defaults = s.plain.get("defaults", {})
    if not isinstance(defaults, dict):
        raise SuiteError(f"{s.where}: defaults must be a table")
    _known(defaults, KEYS[:-2], f"{s.where}: defaults")
    specs: dict[str, RunSpec] = {}
    for k, group in enumerate(s.plain.get("runs", []), start=1):
        place = f"{s.where}: runs group {k}"
        try:
            for spec in _expand({**defaults, **group}, place, made):
                if spec.settings_id in specs:
                    raise SuiteError(f"{place}: {spec.case} is there twice")
                specs[spec.settings_id] = spec
        except SuiteError:
            raise
        except (ValueError, OverflowError) as error:  # of the registry or a problem: its words, our place
            raise SuiteError(f"{place}: {' '.join(str(error).split())}") from None
    return specs


def _expand(group: Mapping[str, Any], place: str, made: dict[tuple[str, str], Problem]) -> Iterator[RunSpec]:
    _known(group, KEYS, place)
    for key in ("problem", "solver"):
        if not _list(group.get(key)) or not all(isinstance(n, str) for n in _list(group[key])):
            raise SuiteError(f"{place}: {key} must be a name or a list of names (got {group.get(key)!r})")
    limits = _limits({k: group[k] for k in LIMITS if k in group}, place)
    for name, solver in itertools.product(_list(group["problem"]), _list(group["solver"])):
        if solver not in registry.solvers():
            raise SuiteError(f"{place}: unknown solver {solver!r}{nearest(solver, list(registry.solvers()))}")
        if name not in registry.problems():
            raise SuiteError(f"{place}: unknown problem {name!r}{nearest(name, list(registry.problems()))}")
        entry = registry.solvers()[solver]
        control = {k: group[k] for k in CONTROL if k in group}
        if "dt" in control and "rtol" in control:  # both given: each solver takes the one it is controlled by
            control = {
                k: v
                for k, v in control.items()
                if k not in (("rtol", "max_step") if entry.control == "dt" else ("dt",))
            }
        for parameters in _product(group.get("parameters", {}), registry.problems()[name].parameters, place):
            variant = (name, repr(sorted(parameters.items())))
            if variant not in made:
                made[variant] = _made(name, parameters, place)
            for options in _product(group.get("options", {}), entry.parameters, place):
                for steps in _product(control, {}, place):
                    spec = make_spec(made[variant], solver, options, steps, **limits)
                    _bounded("max_steps", spec.control.max_steps, place)
                    yield spec


def _made(name: str, parameters: Mapping[str, Any], place: str) -> Problem:
    """A plugin's problem may raise anything: that is told in a line; in one of ours it is a bug."""
    try:
        return registry.make_problem(name, parameters)
    except (ValueError, OverflowError):
        raise
    except Exception as error:
        if registry.is_own_problem(name):
            raise
        raise SuiteError(f"{place}: problem {name}: {type(error).__name__}: {error}") from error


def _product(given: Any, known: Mapping[str, tuple[Any, Any]], place: str) -> Iterator[dict[str, Any]]:
    """One dict for each combination of the listed values; a tuple-valued one takes a flat list as one value."""
    if not isinstance(given, dict):
        raise SuiteError(f"{place}: expected a table (got {given!r})")
    choices = []
    for key, value in given.items():
        is_tuple = key in known and isinstance(known[key][0], tuple)
        one = not isinstance(value, list) or (is_tuple and not any(isinstance(v, list | str) for v in value))
        values = [value] if one else value
        if not values:
            raise SuiteError(f"{place}: {key} is an empty list: no run would be run")
        choices.append([(key, v) for v in values])
    for combination in itertools.product(*choices):
        yield dict(combination)


def _limits(given: dict[str, Any], place: str) -> dict[str, Any]:
    for key in ("wall_limit", "memory", "repeats"):
        _bounded(key, given.get(key, 1), place)
    if not isinstance(given.get("repeats", 1), int):
        raise SuiteError(f"{place}: repeats must be a whole number (got {given['repeats']!r})")
    if not isinstance(given.get("label", ""), str):
        raise SuiteError(f"{place}: label must be text (got {given['label']!r})")
    return given


def _bounded(key: str, value: Any, place: str) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= MOST[key]:
        raise SuiteError(f"{place}: {key} must be a finite number > 0, at most {MOST[key]:g} (got {str(value)[:40]})")


def _known(given: Mapping[str, Any], known: tuple[str, ...], place: str) -> None:
    for key in given:
        if key not in known:
            raise SuiteError(f"{place}: unknown key {key!r}{nearest(key, list(known))}")


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]
