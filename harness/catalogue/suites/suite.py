"""Expand suites: TOML files that list runs, with lists as products; everything is checked before anything runs.

The keys of a file are in ``shape.py``. A run that occurs again through an include is kept as it first occurs, label and
limits included; a run that occurs twice in one file is an error.
"""

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from ...base.files import FileError
from ...base.text import check_text
from ...mechanics.types import Problem
from .. import registry
from ..plugins import resolve_plugin
from ..trial import try_in_process
from .includes import SuiteSource, find_suite_file, list_included, make_source, read_source
from .shape import Defaults, Group, Names, Tables
from .spec import RunSpec, make_spec

MOST_RUNS = 200_000  # most runs of a suite: two days on a core at a second each, and the list fits into memory
LIMITS = ("cpu_limit", "memory", "repeats", "min_time", "label")
CONTROL = ("dt", "rtol", "max_step", "max_steps")


@dataclass(frozen=True)
class Suite:
    """A suite, expanded and checked: its runs in the order of the files, each once, and what is stored with results."""

    name: str
    description: str
    specs: tuple[RunSpec, ...]
    text: str
    plugins: tuple[str, ...] = ()
    included: tuple[tuple[str, str], ...] = ()  # name and text of included suites, for the results folder
    total_limit: float | None = None  # [s] CPU time of all runs together, per parallel process
    parts: Mapping[str, frozenset[str]] = field(default_factory=dict)  # settings_id of runs, by included suite
    not_combined: tuple[str, ...] = ()  # "rattle with rtol": solvers with keys of their groups that they do not take


def load_suite(name: str, plugins: tuple[str, ...] = ()) -> Suite:
    """Return the suite of that name or in that file, expanded and checked; raise FileError if it is invalid.

    ``plugins`` are loaded besides its own.
    """
    return _build_suite(read_source(find_suite_file(name)), plugins)


def parse_suite(text: str, name: str, where: str, beside: Path = Path(), plugins: tuple[str, ...] = ()) -> Suite:
    """Return the suite in ``text``, expanded and checked; raise FileError if it is invalid.

    ``where`` names it in messages, plugins and includes are found ``beside`` it.
    """
    return _build_suite(make_source(text, name, where, beside), plugins)


def _build_suite(own: SuiteSource, plugins: tuple[str, ...]) -> Suite:
    """Return the suite in a file with all that it includes; one with plugins is first expanded in another process."""
    sources = list_included(own)
    for s in sources:
        if not s.file.runs and not s.file.include:
            raise FileError(f"{s.where}: a suite needs at least one [[runs]] group")
    files = tuple(dict.fromkeys([*map(resolve_plugin, plugins), *(p for s in sources for p in _resolve_plugins(s))]))
    if files:  # foreign code may hang, crash or exit when it is loaded or makes a problem
        try:
            loaded = ", ".join(Path(f).name for f in files)
            specs, parts, rest = try_in_process(
                f"{own.where} with {loaded}", lambda: _collect_specs(own, sources, files)
            )
        except ValueError as error:
            raise FileError(" ".join(str(error).split())) from None
    else:
        specs, parts, rest = _collect_specs(own, sources, files)
    included = tuple((s.name, s.text) for s in sources[:-1])
    name, words, total = own.file.name or own.name, own.file.description, own.file.total_limit
    return Suite(name, words, tuple(specs.values()), own.text, files, included, total, parts, rest)


def _collect_specs(
    own: SuiteSource, sources: list[SuiteSource], files: tuple[str, ...]
) -> tuple[dict[str, RunSpec], dict[str, frozenset[str]], tuple[str, ...]]:
    """Return the ``specs`` of all files by settings_id, and the ``parts`` and ``not_combined`` of the ``Suite``.

    ``own`` is the suite's file, ``sources`` are all files with ``own`` as the last, ``files`` the plugins to load
    first. Raise FileError if anything is invalid.
    """
    try:
        for file in files:
            registry.load_plugin(file)
    except ValueError as error:
        raise FileError(f"{own.where}: {error}") from None
    problems: dict[tuple[str, str], Problem] = {}
    specs: dict[str, RunSpec] = {}
    parts: dict[Path, frozenset[str]] = {}
    for s in sources:  # included files come first
        found = _expand_file(s, problems)
        below = (parts[find_suite_file(name, s.beside).resolve()] for name in s.file.include)
        parts[Path(s.where).resolve()] = frozenset(found).union(*below)
        for settings, spec in found.items():
            specs.setdefault(settings, spec)
        if len(specs) > MOST_RUNS:
            raise FileError(f"{own.where}: a suite has at most {MOST_RUNS:,} runs, with those that it includes")
    groups = (_add_defaults(group, s.file.defaults) for s in sources for group in s.file.runs)
    rest = tuple(dict.fromkeys(words for group in groups for words in list_not_combined(group)))
    return specs, {s.name: parts[Path(s.where).resolve()] for s in sources[:-1]}, rest


def _resolve_plugins(s: SuiteSource) -> list[str]:
    """Return the paths of the plugins that a suite file names; raise FileError if one is not found."""
    try:
        return [resolve_plugin(p, s.beside) for p in s.file.plugins]
    except (OSError, ValueError) as error:
        raise FileError(f"{s.where}: plugins: {error}") from None


def _expand_file(s: SuiteSource, problems: dict[tuple[str, str], Problem]) -> dict[str, RunSpec]:
    """Return the runs of one file by settings_id; raise FileError, naming the group, if one is invalid or occurs twice.

    ``problems`` keeps the problems made so far, by name and parameters; new ones are added.
    """
    specs: dict[str, RunSpec] = {}
    for k, group in enumerate(s.file.runs, start=1):
        try:
            check_text("label", group.label or s.file.defaults.label or "")
            whole = _add_defaults(group, s.file.defaults)
            if (count := len(specs) + count_runs(whole)) > MOST_RUNS:
                raise ValueError(f"a suite has at most {MOST_RUNS:,} runs (got {count:,})")
            for spec in _expand_group(whole, problems):
                if spec.settings_id in specs:
                    raise ValueError(f"{spec.case} is declared twice")
                specs[spec.settings_id] = spec
        except (ValueError, OverflowError) as error:  # also from the registry or a problem: prefix the place
            raise FileError(f"{s.where}: runs {k}: {' '.join(str(error).split())}") from None
    return specs


def _add_defaults(group: Group, defaults: Defaults) -> Group:
    """Return the group with the file's defaults for keys that it does not give."""
    shared = {k: v for k, v in msgspec.structs.asdict(defaults).items() if getattr(group, k) is None}
    return msgspec.structs.replace(group, **shared)


def count_runs(group: Group) -> int:
    """Count the runs that a group declares, without making any problem or run."""
    count = 0
    for name, solver in itertools.product(_as_tuple(group.problem), _as_tuple(group.solver)):
        entry = registry.find_entry("solver", solver, registry.solvers())
        known = registry.find_entry("problem", name, registry.problems()).parameters
        options = _count_tables(group.options, entry.parameters)
        count += (
            _count_tables(group.parameters, known) * options * _count_combinations(_select_control(group, entry), {})
        )
    return count


def _select_control(group: Group, entry: registry.SolverEntry) -> dict[str, Any]:
    """Return those control values of a group that a solver takes; of dt and rtol, if both are given, only its own."""
    control = group.select(*CONTROL)
    if "dt" in control and "rtol" in control:
        for other in ("rtol", "max_step") if entry.control == "dt" else ("dt",):
            control.pop(other, None)
    return control


def list_not_combined(group: Group) -> list[str]:
    """Return each solver of a group with each of its keys that the solver does not take, as "rattle with rtol"."""
    solvers = [(name, registry.solvers()[name]) for name in _as_tuple(group.solver)]
    return [
        f"{name} with {key}"
        for name, entry in solvers
        for key in group.select(*CONTROL)
        if key not in _select_control(group, entry)
    ]


def _count_tables(given: Tables | None, known: Mapping[str, tuple[Any, Any]]) -> int:
    """Count the combinations of values in one table of parameters or options, or in several, one after the other.

    ``known`` are the parameters of the problem or solver with their defaults.
    """
    return sum(_count_combinations(table, known) for table in (given if isinstance(given, tuple) else (given or {},)))


def _count_combinations(given: Mapping[str, Any], known: Mapping[str, tuple[Any, Any]]) -> int:
    """Count the combinations of values in one table; ``known`` are the parameters with their defaults."""
    return math.prod(
        _count_sweep(key, value)
        if isinstance(value, dict)
        else 1
        if _is_single_value(key, value, known)
        else len(value)
        for key, value in given.items()
    )


def _expand_group(group: Group, problems: dict[tuple[str, str], Problem]) -> Iterator[RunSpec]:
    """Yield every run of a group: the product of its problems, parameters, solvers, options and steps.

    ``problems`` keeps the problems made so far, by name and parameters; new ones are added. Raise ValueError for
    anything invalid.
    """
    limits = group.select(*LIMITS)
    for key in ("problem", "solver"):
        if getattr(group, key) is None:
            raise ValueError(f"{key} is missing: name it in the group or in [defaults]")
    for name, solver in itertools.product(_as_tuple(group.problem), _as_tuple(group.solver)):
        entry = registry.find_entry("solver", solver, registry.solvers())
        known = registry.find_entry("problem", name, registry.problems()).parameters
        control = _select_control(group, entry)
        for parameters in _combine_tables(group.parameters, known):
            variant = (name, repr(sorted(parameters.items())))
            if variant not in problems:
                problems[variant] = _make_problem(name, parameters)
            for options in _combine_tables(group.options, entry.parameters):
                for steps in _combine(control, {}):
                    yield make_spec(problems[variant], solver, options, steps, **limits)


def _make_problem(name: str, parameters: Mapping[str, Any]) -> Problem:
    """Return a problem made by the registry; raise ValueError in one line if that fails.

    Any exception of a plugin's problem becomes one; one of our own problems is a bug and keeps its traceback.
    """
    try:
        return registry.share_problem(name, parameters)
    except (ValueError, OverflowError):
        raise
    except Exception as error:  # a plugin may raise anything; our own problems keep their traceback
        if registry.is_own_problem(name):
            raise
        raise ValueError(f"problem {name}: {type(error).__name__}: {error}") from error


def _combine_tables(given: Tables | None, known: Mapping[str, tuple[Any, Any]]) -> Iterator[dict[str, Any]]:
    """Yield each combination of values in one table, or in several in turn; ``known`` is that of ``_combine``."""
    for table in given if isinstance(given, tuple) else (given or {},):
        yield from _combine(table, known)


def _combine(given: Mapping[str, Any], known: Mapping[str, tuple[Any, Any]]) -> Iterator[dict[str, Any]]:
    """Yield a dict for each combination of the values of a table, in which a value may be a list or a sweep.

    A flat list is one value of a tuple-valued parameter; ``known`` are the parameters with their defaults. Raise
    ValueError for an empty list.
    """
    choices = []
    for key, value in given.items():
        value = _expand_sweep(key, value) if isinstance(value, dict) else value
        if value == []:
            raise ValueError(f"{key} is an empty list: nothing would be run")
        values = [value] if _is_single_value(key, value, known) else value
        choices.append([dict.fromkeys(_split_names(key), v) for v in values])
    for combination in itertools.product(*choices):
        yield {name: v for part in combination for name, v in part.items()}


def _split_names(key: str) -> list[str]:
    """Split ``"alpha, beta"`` into two names, which have the same value."""
    return [name.strip() for name in key.split(",")]


def _is_single_value(key: str, value: Any, known: Mapping[str, tuple[Any, Any]]) -> bool:
    """Return whether a value is single, not a list of values.

    A flat list is one value of a tuple-valued parameter. ``known`` are the parameters with their defaults.
    """
    first = _split_names(key)[0]
    is_tuple = first in known and isinstance(known[first][0], tuple)
    return not isinstance(value, list) or (is_tuple and not any(isinstance(v, list | str) for v in value))


def _count_sweep(key: str, sweep: Mapping[str, Any]) -> int:
    """Return the number of values of the sweep of ``key``; raise ValueError unless it has from, to and per_decade."""
    if sweep.keys() != {"from", "to", "per_decade"} or not all(isinstance(v, int | float) for v in sweep.values()):
        raise ValueError(f"{key} must be a value, a list, or {{ from, to, per_decade }} (got {dict(sweep)})")
    first, last, steps = sweep["from"], sweep["to"], sweep["per_decade"]
    if not (first > 0.0 and last > 0.0 and first != last and steps >= 1):
        raise ValueError(
            f"{key}: a sweep goes from one number > 0 to another, with per_decade >= 1 (got {dict(sweep)})"
        )
    return round(abs(math.log10(last / first)) * steps) + 1


def _expand_sweep(key: str, sweep: Mapping[str, Any]) -> list[float]:
    """Return the values of the sweep of ``key``: evenly spaced in the logarithm, ends included, to three digits."""
    count, first = _count_sweep(key, sweep), sweep["from"]
    decades = math.log10(sweep["to"] / first)
    return [float(f"{first * 10.0 ** (decades * k / (count - 1)):.3g}") for k in range(count)]


def _as_tuple(names: Names | None) -> tuple[str, ...]:
    """Return one name, several or None as a tuple."""
    return (names,) if isinstance(names, str) else names or ()
