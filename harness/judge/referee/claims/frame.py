"""Hold the frame of runs: a row per run, its settings as dimensions beside its record and the numbers measured on it.

A dimension is an option of the solver or a parameter of the problem under its own name, except for those that solvers
name differently: ``tolerance`` (rtol, or the stop test of ODE-GC), ``gain`` (alpha = beta), ``chart``, ``step`` (dt),
``duration`` (t_end), ``frame`` (how problem and axes lie). A map of a claim is a query of this frame (``select_runs``).
A dimension that a selection does not name must have its default, so that no claim collects runs it was not written for.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache, partial
from typing import Any

from ....catalogue import registry
from ....catalogue.suites.spec import RunSpec
from ....catalogue.suites.suite import load_suite
from ....results.judgements.claims import Ending
from ....results.records import RunRecord
from ....results.series import EnvelopedSeries, Series
from .endings import classify_ending, ended_by_budget
from .measures import evaluate
from .register import Test

ANY = "any"
AS_PRINTED = "as printed"  # label in the suite ``paper``
FRAMES = ("yaw", "rotation", "perturb", "seed")  # parameters that the dimension ``frame`` stands for
RENAMED: Mapping[str, tuple[str, Mapping[Any, str]]] = {  # options with their dimension and the words for their values
    "coordinates": ("chart", {}),
    "accelerations": ("form", {"unknown": "fi", "eliminated": "se", "mass_matrix": "mass matrix"}),  # unknown: w = u'
}
ALIGNED = "aligned"  # value of ``frame`` without such parameters
WHOLE = "the whole run"  # step of a run in one step
KEPT = 8  # series kept in memory for distances between runs
NO_RECORD = RunRecord()
SeriesOf = Callable[[RunRecord], Series | None]


@dataclass(frozen=True, eq=False)
class TriedRun:
    """A row of the frame: a run's settings, and what was found of it once ``measure_runs`` was called.

    ``usual`` names the dimensions at their defaults, ``options`` those that are options of its solver.
    """

    spec: RunSpec
    dimensions: Mapping[str, Any]
    usual: frozenset[str]
    options: frozenset[str]
    record: RunRecord = NO_RECORD  # empty if the results lack the run
    ending: Ending = Ending.FINAL
    numbers: dict[object, float] = field(default_factory=dict)  # by test, and by test and partner
    read: Callable[[], Series | None] = lambda: None

    @property
    def settings_id(self) -> str:
        """The digest of the settings, by which runs are identified."""
        return self.spec.settings_id

    def find_number(self, test: Test) -> float:
        """Return the number of a test on this run, for which it was measured."""
        return self.numbers[test.key]

    def find_distance(self, other: "TriedRun", test: Test) -> float:
        """Return the number of a test on two runs together, such as their distance, measured when first asked for."""
        key = (test.key, other.settings_id)
        if key not in self.numbers:
            them = other.record, other.read()
            self.numbers[key] = evaluate(test.metric, self.record, self.read(), test.arguments, *them)
        return self.numbers[key]


def measure_runs(
    wanted: Iterable[tuple[TriedRun, Sequence[Test]]], records: Iterable[RunRecord], series_of: SeriesOf
) -> dict[str, TriedRun]:
    """Return the runs in ``wanted``, by settings_id, with their records, endings and the numbers of their tests.

    ``wanted`` pairs runs with tests; a run may come several times. The series of a run, from ``series_of``, are read
    once for all its tests. A run without a record is returned as it is. Tests of two runs together are not measured
    here (``find_distance``). Raise EnvelopedSeries if a test reads a series that is stored as an envelope.
    """
    found = {r.settings_id: r for r in records}
    read = lru_cache(maxsize=KEPT)(lambda settings: series_of(found[settings]))
    asked: dict[str, tuple[TriedRun, dict[object, Test]]] = {}
    for run, tests in wanted:
        asked.setdefault(run.settings_id, (run, {}))[1].update({t.key: t for t in tests})
    out = {}
    for settings, (run, by_key) in asked.items():
        out[settings] = run
        if settings in found and by_key:
            record, own = found[settings], {k: t for k, t in by_key.items() if not t.measure.of_pair}
            reads = ended_by_budget(record) or any(t.measure.needs_series for t in own.values())
            series = read(settings) if reads else None
            numbers: dict[object, float] = {k: _measure_one(t, record, series) for k, t in own.items()}
            ending = classify_ending(record, series)
            out[settings] = replace(run, record=record, ending=ending, numbers=numbers, read=partial(read, settings))
    return out


def _measure_one(test: Test, record: RunRecord, series: Series | None) -> float:
    """Return the number of a test on one run; an EnvelopedSeries that this raises names the test and the run."""
    try:
        return evaluate(test.metric, record, series, test.arguments)
    except EnvelopedSeries as error:
        raise EnvelopedSeries(f"{record.case}: a claim's test {test.metric!r} reads every step: {error}") from error


def read_dimensions(spec: RunSpec) -> TriedRun:
    """Return the row of a run without its record: its dimensions, with defaults from the catalogue.

    A step or a tolerance is never counted among the defaults, so that a selection has to name it.
    """
    options, unusual = _read_options(spec)
    given: dict[str, Any] = {"problem": spec.problem, "solver": spec.solver}
    for name, (default, _) in registry.problems()[spec.problem].parameters.items():
        if name == "t_end":
            given["duration"] = spec.parameters.get("t_end") or find_default_duration(spec.problem)
            unusual |= {"duration"} if "t_end" in spec.parameters else set()
        elif name not in FRAMES:
            given[name] = spec.parameters.get(name, default)
            unusual |= {name} if name in spec.parameters else set()
    given["frame"] = _name_frame(spec.parameters)
    unusual |= {"frame"} if given["frame"] != ALIGNED else set()
    given |= options
    c = spec.control
    step = WHOLE if c.dt is not None and c.dt >= given["duration"] else c.dt
    asked = {k: v for k, v in (("tolerance", c.rtol), ("step", step), ("max_step", c.max_step)) if v is not None}
    return TriedRun(spec, given | asked, frozenset(given) - unusual - asked.keys(), frozenset(options))


@cache
def find_default_duration(problem: str) -> float:
    """Return the default simulated time of a problem [s]."""
    return float(registry.share_problem(problem).t_end)


def _read_options(spec: RunSpec) -> tuple[dict[str, Any], set[str]]:
    """Return a run's options by the names of their dimensions, defaults included, and the names of those it sets.

    Options are renamed as in ``RENAMED``, and alpha and beta are one dimension, ``gain``.
    """
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


def _name_frame(parameters: Mapping[str, Any]) -> str:
    """Return the value of the dimension ``frame`` for the ``parameters`` of a problem: how it lies, in words."""
    if parameters.get("perturb"):
        return f"start perturbed by {parameters['perturb']:g}"
    if parameters.get("yaw"):
        return f"yawed by {parameters['yaw']:g} rad"
    return "rotated" if parameters.get("rotation") else ALIGNED


def select_runs(runs: Iterable[TriedRun], selections: Sequence[Mapping[str, Any]]) -> tuple[TriedRun, ...]:
    """Return the runs in at least one of the selections, in their order.

    A selection maps dimensions to their wanted values. Of two runs that differ only in their limits, the one with the
    lower limit on steps is returned: a stuck run without such a limit would be ended by a clock.
    """
    out: dict[str, TriedRun] = {}
    fitting: dict[tuple[str, str], list[Mapping[str, Any]]] = {}  # by problem and solver: few selections fit any
    for p in runs:
        named = p.spec.problem, p.spec.solver
        if named not in fitting:
            fitting[named] = [s for s in selections if _wants(s, "problem", named[0]) and _wants(s, "solver", named[1])]
        if fitting[named] and is_in(p, fitting[named]):
            key = repr(sorted((k, str(v)) for k, v in p.dimensions.items()))
            if key not in out or p.spec.control.max_steps < out[key].spec.control.max_steps:
                out[key] = p
    return tuple(out.values())


def _wants(selection: Mapping[str, Any], dimension: str, value: str) -> bool:
    """Return whether a selection wants this value of a dimension, or any."""
    wanted = selection.get(dimension, ANY)
    return wanted == ANY or _is_allowed(value, wanted)


def is_in(p: TriedRun, selections: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether a run is in one of the selections, which map dimensions to wanted values."""
    return any(_matches(p, s) for s in selections)


def _matches(p: TriedRun, selection: Mapping[str, Any]) -> bool:
    """Return whether a run has the values of a selection, and defaults in all dimensions it does not name."""
    for name, wanted in selection.items():
        if wanted != ANY and not _is_allowed(p.dimensions.get(name), wanted):
            return False
    return p.dimensions.keys() <= selection.keys() | p.usual


def _is_allowed(value: Any, wanted: Any) -> bool:
    """Return whether a value of a dimension is the wanted one, one of a wanted list, or in a wanted range.

    A range is a dict with ``from`` and ``to``, both included.
    """
    if isinstance(wanted, dict):
        low, high = sorted((wanted["from"], wanted["to"]))
        return isinstance(value, int | float) and bool(low <= value <= high)
    return any(are_equal(value, w) for w in wanted) if isinstance(wanted, list) else are_equal(value, wanted)


def are_equal(value: Any, wanted: Any) -> bool:
    """Return whether two values of a dimension are equal; True differs from 1."""
    return bool(value == wanted) and isinstance(value, bool) == isinstance(wanted, bool)


def is_printed(p: TriedRun, printed: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether the paper prints the settings of a run; ``printed`` lists the settings that it prints.

    In these, the value ``as printed`` stands for that of a run with this label, of the same problem and solver, in the
    suite ``paper``. Dimensions that are not listed may have any value.
    """
    for one in printed:
        named = [k for k, v in one.items() if v == AS_PRINTED]
        given = all(_is_allowed(p.dimensions.get(k), v) for k, v in one.items() if k not in named)
        runs = _list_printed(p.spec.problem, p.spec.solver) if named else (p,)
        if given and any(all(are_equal(p.dimensions.get(k), q.dimensions.get(k)) for k in named) for q in runs):
            return True
    return False


@cache
def _list_printed(problem: str, solver: str) -> tuple[TriedRun, ...]:
    """Return the runs of the suite ``paper`` for a problem and a solver that have the label ``as printed``."""
    wanted = (AS_PRINTED, problem, solver)
    return tuple(read_dimensions(s) for s in load_suite("paper").specs if (s.label, s.problem, s.solver) == wanted)


def find_varied(settings: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the dimensions with more than one value among ``settings``, each with its values in order.

    None stands for a dimension that a setting does not have.
    """
    names = dict.fromkeys(itertools.chain.from_iterable(settings))
    found = {k: list_values(at.get(k) for at in settings) for k in names}
    return {k: v for k, v in found.items() if len(v) > 1}


def list_values(given: Iterable[Any]) -> list[Any]:
    """Return each value once: numbers by size, True, False, texts; None, for a missing dimension, comes last."""
    return sorted(dict.fromkeys(given), key=make_sort_key)


def make_sort_key(value: Any) -> tuple[int, float, str]:
    """Return the sort key of a dimension's value: numbers by size, True, False, texts by letters, and None last."""
    if value is None:
        return 3, 0.0, ""
    if isinstance(value, bool):
        return 1, float(not value), ""
    return (0, float(value), "") if isinstance(value, int | float) else (2, 0.0, str(value))


def find_chosen(runs: Iterable[TriedRun]) -> set[str]:
    """Return the names of the dimensions that some run sets to other than the default, and problem and solver."""
    return {"problem", "solver"}.union(*(p.dimensions.keys() - p.usual for p in runs))
