"""Hold a results folder as reports see it: runs, sorted into variants and labels."""

import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain, count
from pathlib import Path
from typing import Any, TypeVar

from ...harness.base.confined_paths import ConfinedPath
from ...harness.base.files import FileError
from ...harness.base.naming import format_exactly, format_name
from ...harness.mechanics.types import Status
from ...harness.results import store
from ...harness.results.provenance import read_environment
from ...harness.results.provisional import select_latest
from ...harness.results.records import RunRecord
from ...harness.results.series import Series, read_series
from ...harness.results.series import check_series as check_series_file
from ...harness.results.shadows import NearestMotion, choose_nearest, read_nearest
from ...harness.results.words import list_reasons, qualify_status

T = TypeVar("T")
K = TypeVar("K", bound=Hashable)
STDERR_SHOWN = 4000  # last characters shown: a native library prints the reason last
UNKNOWN = "not recorded"
SERIES = 200  # series without poses in the cache: half a megabyte each
WHOLE = 36  # series with poses in the cache: those of a theatre
STAMPED = ("numpy", "scipy")  # packages named in the stamp


@dataclass(frozen=True)
class StoredRun:
    """A record, the end of its standard error, and the true motion near it."""

    record: RunRecord
    stderr: str = ""
    nearest: NearestMotion | None = None

    @cached_property
    def variant(self) -> str:
        """The problem with the parameters that differ from its defaults."""
        return format_name(self.record.problem, self.parameters)

    @cached_property
    def method(self) -> str:
        """The solver with its options, without the step or tolerance."""
        return format_name(self.record.solver, self.options)

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The parameters of the problem that differ from its defaults."""
        return self.record.parameters

    @property
    def options(self) -> Mapping[str, Any]:
        """The options of the solver that differ from its defaults."""
        return self.record.options

    @property
    def notes(self) -> Sequence[str]:
        """The notes of the solver on the run."""
        return self.record.note_lines

    @cached_property
    def reasons(self) -> Sequence[str]:
        """The reasons why the run is not a success, in words; empty for a success."""
        near = self.nearest.words if self.nearest and self.status == Status.INACCURATE else ""
        return [] if self.is_success else [*list_reasons(self.record), *([f"yet {near}"] if near else [])]

    @property
    def status(self) -> str:
        """The status as the harness judged it; "unknown" for a record without one."""
        return self.record.status or "unknown"

    @property
    def qualifiers(self) -> str:
        """Words beside the status: how far the motion was compared, singular poses it passed, wrong reactions."""
        return qualify_status(self.record)

    @property
    def is_success(self) -> bool:
        return self.status == Status.SUCCESS

    @property
    def has_stopped(self) -> bool:
        """True if the run neither reached the end nor was refused: it diverged, crashed, or a limit ended it."""
        return self.status not in (Status.SUCCESS, Status.INACCURATE, Status.WRONG, Status.REFUSED)

    @property
    def is_unfinished(self) -> bool:
        """True if a time limit of the harness ended the run: it is not counted, and not held against its solver."""
        return self.status == Status.UNFINISHED

    @property
    def step_or_tolerance(self) -> float:
        """The step [s] or the tolerance, whichever controls the run; smaller means finer, 0 if neither is recorded."""
        value = self.record.dt_s if self.record.control == "dt" else self.record.rtol
        return value if value == value else 0.0

    @property
    def finest_first(self) -> tuple[float, int, str]:
        """The sort key that puts the finest step or tolerance first, then the fewest options."""
        return self.step_or_tolerance, len(self.options), self.record.case

    @property
    def step_words(self) -> str:
        """The step or tolerance in words."""
        r = self.record
        given = (("dt", r.dt_s, " s"), ("rtol", r.rtol, ""))
        return ", ".join(f"{k} = {v:g}{unit}" for k, v, unit in given if v == v) or "no step given"

    def settings(self, leave_out: frozenset[str] = frozenset()) -> str:
        """Format the step or tolerance, the largest step and the options, without those in ``leave_out``."""
        words = [self.step_words]
        if self.record.max_step_s == self.record.max_step_s and "max_step" not in leave_out:
            words.append(f"max step {self.record.max_step_s:g} s")
        words += [f"{k} = {format_exactly(v)}" for k, v in self.options.items() if k not in leave_out]
        return ", ".join(words)


@dataclass(frozen=True)
class Variant:
    """A problem with given parameters, and all its runs."""

    title: str
    slug: str
    runs: tuple[StoredRun, ...]

    @property
    def section(self) -> str:
        """The section of the paper that the problem is from; empty for other problems."""
        return self.runs[0].record.section

    @property
    def problem(self) -> str:
        return self.runs[0].record.problem

    @property
    def parameters(self) -> str:
        """The parameters in words; empty for the problem's defaults."""
        return ", ".join(f"{k} = {format_exactly(v)}" for k, v in self.runs[0].parameters.items())

    def labels(self) -> dict[str, tuple[StoredRun, ...]]:
        """Return the runs by label of the suite, the largest group first."""
        found = group_by(self.runs, lambda run: run.record.label)
        return {k: tuple(v) for k, v in sorted(found.items(), key=lambda kv: (-len(kv[1]), kv[0]))}


@dataclass(frozen=True)
class StoredResults:
    """The contents of a results folder."""

    folder: Path
    environment: Mapping[str, Any]
    runs: tuple[StoredRun, ...]
    unreadable: Mapping[Path, str]
    made_again: int = 0  # runs replaced by a later one with the same settings
    cut_short: int = 0  # runs replaced by an earlier one with the same settings

    @cached_property
    def variants(self) -> tuple[Variant, ...]:
        """The variants in the order of the paper's sections, then by name."""
        found = group_by(self.runs, lambda run: run.variant).items()
        ordered = sorted(found, key=lambda kv: (kv[1][0].record.section or "~", make_natural_key(kv[0])))
        taken: set[str] = set()
        return tuple(Variant(title, make_slug(title, taken), tuple(runs)) for title, runs in ordered)

    @cached_property
    def solvers(self) -> tuple[str, ...]:
        """The names of the solvers, sorted."""
        return tuple(sorted({c.record.solver for c in self.runs}))

    @cached_property
    def by_settings(self) -> dict[str, StoredRun]:
        """The runs by settings_id."""
        return {c.record.settings_id: c for c in self.runs}

    @property
    def suite_runs(self) -> int:
        """The number of runs of the whole suite; 0 if it is not recorded."""
        found = self.environment.get("suite_runs")
        return found if isinstance(found, int) else 0

    @property
    def to_come(self) -> int:
        """The number of runs of the suite that have no result yet, neither readable nor damaged."""
        return max(self.suite_runs - len(self.runs) - len(self.unreadable), 0)

    @property
    def plugins(self) -> list[str]:
        """The plug-in files and packages that provided problems or solvers."""
        return [str(p) for p in self.environment.get("plugins") or []]

    def labels(self) -> tuple[str, ...]:
        """Return the labels of the suite, the one with most runs first."""
        number = Counter(run.record.label for run in self.runs)
        return tuple(sorted(number, key=lambda k: (-number[k], k)))

    def series(self, run: StoredRun, *, poses: bool = True) -> Series | None:
        """Return the stored time histories of a run, None if it has none; raise FileError for a damaged file.

        Those read last are kept in memory, since several pages draw them: ``WHOLE`` with poses, ``SERIES`` without.
        """
        r = run.record
        if not r.series:
            return None
        key = self.folder, r.series, r.series_sha256
        return _read_whole(*key) if poses or key in _whole else _read_without_poses(*key)

    def readable_series(self, run: StoredRun) -> Series | None:
        """Return the stored time histories of a run; None if there are none or the file is damaged."""
        try:
            return self.series(run)
        except FileError:
            return None


def read_results(folder: Path, *, check_series: bool = True) -> StoredResults:
    """Read the results in ``folder``, one run per settings: the latest, or an earlier success if that was cut short.

    Files that cannot be read are listed in ``unreadable``. With ``check_series`` a run whose series file is damaged is
    among these; without, a series is checked when it is read.
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
    shown = {r.settings_id: r for r in select_latest(sound)}
    later = sum(r.finished > shown[r.settings_id].finished for r in sound)
    near = read_nearest(folder)
    runs = []
    for r in shown.values():
        text = store.read_stderr(folder, r)
        last = text if len(text) <= STDERR_SHOWN else "[...]\n" + text[-STDERR_SHOWN:]
        runs.append(StoredRun(r, last, choose_nearest(r, near)))
    runs.sort(key=lambda c: (c.record.solver, c.method, -c.step_or_tolerance, c.record.case))
    unreadable = {**loaded.unreadable, **{folder / "runs" / f"{run}.json": why for run, why in faults.items()}}
    earlier = len(sound) - len(shown) - later
    return StoredResults(folder, read_environment(folder), tuple(runs), unreadable, made_again=earlier, cut_short=later)


@lru_cache(SERIES)
def _read_without_poses(folder: Path, name: str, sha256: str) -> Series:
    """Read a series file without its poses; cached, since several pages draw it."""
    return read_series(ConfinedPath(folder) / name, sha256, poses=False)


_whole: dict[tuple[Path, str, str], Series] = {}  # the series read last, with their poses


def _read_whole(folder: Path, name: str, sha256: str) -> Series:
    """Return the series in a file with its poses, from memory if it is among the last ``WHOLE`` that were read."""
    key = folder, name, sha256
    if key not in _whole:
        if len(_whole) >= WHOLE:
            del _whole[next(iter(_whole))]
        _whole[key] = read_series(ConfinedPath(folder) / name, sha256)
    return _whole[key]


def forget_series() -> None:
    """Remove from memory the series that are kept with their poses, as those of a large system fill it."""
    _whole.clear()


def group_by(items: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Group items by key, with keys in the order of their first items."""
    found: dict[K, list[T]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return found


def group_by_solver(runs: Iterable[StoredRun]) -> dict[str, list[StoredRun]]:
    """Group runs by solver, in the order of their first runs."""
    return group_by(runs, lambda run: run.record.solver)


def make_natural_key(text: str) -> list[tuple[int, float, str]]:
    """Return a sort key by which ``links=6`` precedes ``links=30``."""
    parts = re.split(r"(\d+(?:\.\d+)?)", text)
    return [(1, float(p), "") if k % 2 else (0, 0.0, p) for k, p in enumerate(parts)]


def make_slug(title: str, taken: set[str]) -> str:
    """Return a name for files and anchors made from ``title`` but not ``taken``, and add it to these in lower case."""
    base = re.sub(r"[^a-zA-Z0-9.]+", "-", title).strip("-.")[:80] or "unnamed"
    names = chain([base], (f"{base}-{n}" for n in count(2)))
    name = next(name for name in names if name.lower() not in taken)
    taken.add(name.lower())
    return name


def format_stamp(results: StoredResults) -> str:
    """Return a line that states commit, uncommitted changes, versions and machine of the results."""
    e, versions = results.environment, dict(list_recorded_packages(results))
    known = [f"Python {e.get('python') or UNKNOWN}", *(f"{k} {versions[k]}" for k in STAMPED if k in versions)]
    commit = str(e.get("commit") or UNKNOWN)[:12] + (" with uncommitted changes (dirty)" if e.get("dirty") else "")
    return f"Commit {commit}; {', '.join(known)}; {e.get('cpu') or UNKNOWN}, {e.get('cores', '?')} cores."


def list_recorded_packages(results: StoredResults) -> list[tuple[str, str]]:
    """Return every recorded package with its version, sorted by name."""
    found = results.environment.get("packages")
    return sorted((str(k), str(v)) for k, v in found.items()) if isinstance(found, dict) else []
