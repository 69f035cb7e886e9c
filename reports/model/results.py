"""A results folder as reports see it: runs with their texts unpacked, sorted into variants and labels."""

import json
import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain, count
from pathlib import Path
from typing import Any, TypeVar

from ...harness.files import FileError
from ...harness.places import Place
from ...harness.results import store
from ...harness.results.naming import format_name, text_of
from ...harness.results.provenance import stamp_of
from ...harness.results.provisional import latest_of_each
from ...harness.results.records import RunRecord
from ...harness.results.series import Series, read_series
from ...harness.results.series import check_series as check_series_file
from ...harness.results.shadows import Nearest, nearest_of, read_nearest
from ...harness.results.words import comparison_words, why
from ...harness.types import Status

T = TypeVar("T")
K = TypeVar("K", bound=Hashable)
STDERR_SHOWN = 4000  # characters, the last ones: a native library says the reason last
UNKNOWN = "not recorded"
SERIES = 200  # without poses that are kept: half a megabyte each
STAMPED = ("numpy", "scipy")  # packages of the line


def _unpack_column(column: str) -> cached_property[Mapping[str, Any]]:
    return cached_property(lambda run: json.loads(getattr(run.record, column)))


@dataclass(frozen=True)
class Run:
    """A record with what its JSON columns hold, the end of its standard error, and the true motion near it."""

    record: RunRecord
    stderr: str = ""
    nearest: Nearest | None = None

    @cached_property
    def variant(self) -> str:
        """The problem with the parameters that differ from its defaults."""
        return format_name(self.record.problem, self.parameters)

    @cached_property
    def method(self) -> str:
        """The solver with its options, without the step or tolerance."""
        return format_name(self.record.solver, self.options)

    parameters = _unpack_column("problem_parameters")
    options = _unpack_column("solver_options")
    counters = _unpack_column("counters")
    observable_errors = _unpack_column("observable_errors")
    invariant_drifts = _unpack_column("invariant_drifts")

    @cached_property
    def notes(self) -> Sequence[str]:
        return [str(n) for n in json.loads(self.record.notes)]

    @cached_property
    def reasons(self) -> Sequence[str]:
        """Why it is not a success; empty for one that is."""
        near = self.nearest.words if self.nearest and self.status == Status.INACCURATE else ""
        return [] if self.is_success else [*why(self.record), *([f"yet {near}"] if near else [])]

    @property
    def status(self) -> str:
        return self.record.status or "unknown"

    @property
    def compared(self) -> str:
        """How far its motion was compared, where that is not to its end."""
        return comparison_words(self.record)

    @property
    def is_success(self) -> bool:
        return self.status == Status.SUCCESS

    @property
    def has_stopped(self) -> bool:
        """It neither reached the end nor was refused beforehand."""
        return self.status not in (Status.SUCCESS, Status.INACCURATE, Status.WRONG, Status.REFUSED)

    @property
    def is_unfinished(self) -> bool:
        """The harness ended it: in no count, and no mark against its solver."""
        return self.status == Status.UNFINISHED

    @property
    def step_or_tolerance(self) -> float:
        """Step or tolerance asked for; smaller asks for more accuracy."""
        value = self.record.dt_s if self.record.control == "dt" else self.record.rtol
        return value if value == value else 0.0

    @property
    def finest_first(self) -> tuple[float, int, str]:
        """A key to sort by: the finest step or tolerance first, among those the fewest options."""
        return self.step_or_tolerance, len(self.options), self.record.case

    @property
    def step_words(self) -> str:
        """Step or tolerance in words."""
        r = self.record
        given = (("dt", r.dt_s, " s"), ("rtol", r.rtol, ""))
        return ", ".join(f"{k} = {v:g}{unit}" for k, v, unit in given if v == v) or "no step given"

    def settings(self, leave_out: frozenset[str] = frozenset()) -> str:
        """Step, largest step and options in words, without the options in ``leave_out``."""
        words = [self.step_words]
        if self.record.max_step_s == self.record.max_step_s and "max_step" not in leave_out:
            words.append(f"max step {self.record.max_step_s:g} s")
        words += [f"{k} = {text_of(v)}" for k, v in self.options.items() if k not in leave_out]
        return ", ".join(words)


@dataclass(frozen=True)
class Variant:
    """One variant, with all runs that took it."""

    title: str
    slug: str
    runs: tuple[Run, ...]

    @property
    def section(self) -> str:
        return self.runs[0].record.section

    @property
    def problem(self) -> str:
        return self.runs[0].record.problem

    @property
    def parameters(self) -> str:
        """In words; empty for the problem as its file has it."""
        return ", ".join(f"{k} = {text_of(v)}" for k, v in self.runs[0].parameters.items())

    def labels(self) -> dict[str, tuple[Run, ...]]:
        """The runs by label of the suite, the largest group first."""
        found = group_by(self.runs, lambda run: run.record.label)
        return {k: tuple(v) for k, v in sorted(found.items(), key=lambda kv: (-len(kv[1]), kv[0]))}


@dataclass(frozen=True)
class Results:
    """All that a report needs."""

    folder: Path
    environment: Mapping[str, Any]
    runs: tuple[Run, ...]
    unreadable: tuple[store.Unreadable, ...]
    made_again: int = 0  # runs left out: a later one with the same settings is shown
    cut_short: int = 0  # runs left out: an earlier one with the same settings is shown

    @cached_property
    def variants(self) -> tuple[Variant, ...]:
        """In the order of the paper's sections, then by name."""
        found = group_by(self.runs, lambda run: run.variant).items()
        ordered = sorted(found, key=lambda kv: (kv[1][0].record.section or "~", natural(kv[0])))
        taken: set[str] = set()
        return tuple(Variant(title, slug(title, taken), tuple(runs)) for title, runs in ordered)

    @cached_property
    def solvers(self) -> tuple[str, ...]:
        return tuple(sorted({c.record.solver for c in self.runs}))

    @cached_property
    def by_settings(self) -> dict[str, Run]:
        """By settings_id."""
        return {c.record.settings_id: c for c in self.runs}

    @property
    def suite_runs(self) -> int:
        """The number of runs of the whole suite; 0 where it is not recorded."""
        found = self.environment.get("suite_runs")
        return found if isinstance(found, int) else 0

    @property
    def to_come(self) -> int:
        """How many runs of the suite have no result yet, readable or not."""
        return max(self.suite_runs - len(self.runs) - len(self.unreadable), 0)

    @property
    def plugins(self) -> list[str]:
        """Files and packages with problems or solvers that were not ours."""
        return [str(p) for p in self.environment.get("plugins") or []]

    def labels(self) -> tuple[str, ...]:
        """Labels of the suite, the one with most runs first."""
        number = Counter(run.record.label for run in self.runs)
        return tuple(sorted(number, key=lambda k: (-number[k], k)))

    def series(self, run: Run, *, poses: bool = True) -> Series | None:
        r = run.record
        if poses or not r.series:
            return store.series_of(self.folder, r)
        return _read_without_poses(self.folder, r.series, r.series_sha256)

    def readable_series(self, run: Run) -> Series | None:
        """None where the file is damaged, too: the figure says so."""
        try:
            return self.series(run)
        except FileError:
            return None


def read_results(folder: Path, *, check_series: bool = True) -> Results:
    """The results in ``folder``, of runs with the same settings one; what cannot be read is listed, not hidden.

    Unchecked series are checked when taken.
    """
    loaded = store.load(folder, check_series=False)
    faults = {}
    for r in loaded.records if check_series else ():
        try:
            if r.series:
                check_series_file(folder / r.series, r.series_sha256)
        except FileError as error:
            faults[r.run_id] = f"its series file {r.series}: {error}"
    sound = [r for r in loaded.records if r.run_id not in faults]
    shown = {r.settings_id: r for r in latest_of_each(sound)}
    later = sum(r.finished > shown[r.settings_id].finished for r in sound)
    near = read_nearest(folder)
    runs = []
    for r in shown.values():
        text = store.native_of(folder, r)
        last = text if len(text) <= STDERR_SHOWN else "[...]\n" + text[-STDERR_SHOWN:]
        runs.append(Run(r, last, nearest_of(r, near)))
    runs.sort(key=lambda c: (c.record.solver, c.method, -c.step_or_tolerance, c.record.case))
    bad = [store.Unreadable(folder / "runs" / f"{run}.json", why) for run, why in faults.items()]
    earlier = len(sound) - len(shown) - later
    return Results(folder, stamp_of(folder), tuple(runs), (*loaded.unreadable, *bad), earlier, later)


@lru_cache(SERIES)
def _read_without_poses(folder: Path, name: str, sha256: str) -> Series:
    """A series file without its poses, which several pages draw."""
    return read_series(Place(folder) / name, sha256, poses=False)


def group_by(items: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Items by key, keys in the order of their first items."""
    found: dict[K, list[T]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return found


def by_solver(runs: Iterable[Run]) -> dict[str, list[Run]]:
    """In the order of their first runs."""
    return group_by(runs, lambda run: run.record.solver)


def natural(text: str) -> list[tuple[int, float, str]]:
    """A key to sort by that puts ``links=6`` before ``links=30``."""
    parts = re.split(r"(\d+(?:\.\d+)?)", text)
    return [(1, float(p), "") if k % 2 else (0, 0.0, p) for k, p in enumerate(parts)]


def slug(title: str, taken: set[str]) -> str:
    """A name for files and anchors, unlike those in ``taken``, to which it is added."""
    base = re.sub(r"[^a-zA-Z0-9.]+", "-", title).strip("-.")[:80] or "unnamed"
    names = chain([base], (f"{base}-{n}" for n in count(2)))
    name = next(name for name in names if name.lower() not in taken)
    taken.add(name.lower())
    return name


def stamp(results: Results) -> str:
    """Commit, dirty flag, versions, machine."""
    e, versions = results.environment, dict(packages(results))
    known = [f"Python {e.get('python') or UNKNOWN}", *(f"{k} {versions[k]}" for k in STAMPED if k in versions)]
    commit = str(e.get("commit") or UNKNOWN)[:12] + (" with uncommitted changes (dirty)" if e.get("dirty") else "")
    return f"Commit {commit}; {', '.join(known)}; {e.get('cpu') or UNKNOWN}, {e.get('cores', '?')} cores."


def packages(results: Results) -> list[tuple[str, str]]:
    """Every recorded package."""
    found = results.environment.get("packages")
    return sorted((str(k), str(v)) for k, v in found.items()) if isinstance(found, dict) else []
