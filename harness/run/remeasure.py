"""Measure finished runs again by the laws of the present code: solve them once more and compare the bits of motions.

A changed law needs no new result: what a run cost, how it ended, and on which machine stay as recorded, and a note in
the record says so. A run whose steps have other bits now is left unchanged, because it is another motion. So is one
whose solver, problem or clocks have other code than they had, because its cost is not that of the present code. Columns
that are newer than a record are filled in the same way.
"""

import dataclasses
import io
import tarfile
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from ..catalogue import codes
from ..catalogue.suites.includes import OWN_COPY
from ..catalogue.suites.spec import RunSpec
from ..catalogue.suites.suite import Suite, load_suite
from ..mechanics.types import Status
from ..results import environment, store
from ..results.column_digests import add_column_digests
from ..results.provenance import read_environment
from ..results.provisional import list_record_files
from ..results.records import RunRecord, format_notes
from ..results.series import LARGEST, MARKS, OTHER, POSES, Series, name_series_file
from .full_series import limit_steps, rebuild_spec
from .runner import Request

KEPT = (  # columns of a record that stay as they were: what was requested, how it ended, what it cost
    "suite",
    "label",
    "control",
    "dt_s",
    "rtol",
    "max_step_s",
    "max_steps",
    "cpu_limit_s",
    "wall_limit_s",
    "memory_limit_MB",
    "settings_id",
    "case",
    "claimed",
    "ended_by",
    "ended_limit_s",
    "message",
    "exit_code",
    "signal",
    "repeats",
    "cpu_min_s",
    "cpu_q1_s",
    "cpu_median_s",
    "cpu_q3_s",
    "cpu_max_s",
    "cpu_call_s",
    "setup_s",
    "code_s",
    "cpu_import_s",
    "cpu_refuses_s",
    "cpu_process_s",
    "wall_s",
    "peak_memory_MB",
    "environment",
    "finished",
)
WHY = "its motion was measured again by later code"  # reason noted with the files set aside
AT_ONCE = 50  # runs that are solved before the first of them is replaced, so that an interruption loses no more


@dataclass
class RemeasuredRuns:
    """The runs that were measured again, with their new records, and those left unchanged, with the reason.

    ``set_aside`` are damaged files of the folder that were replaced.
    """

    records: list[RunRecord] = field(default_factory=list)
    left: list[tuple[RunRecord, str]] = field(default_factory=list)
    set_aside: Mapping[Path, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _KeptSeries:
    """The content of a run's series file, which the new file must have too; empty if there is no file."""

    steps_sha256: str = ""  # digest of all its steps
    lossless: bool = False  # whether it has the states of every step
    rows: tuple[str, ...] | None = None  # series that a brief file has row by row


def find_outdated(records: Sequence[RunRecord], plugins: tuple[str, ...] = ()) -> list[RunRecord]:
    """Return the records whose measurements or runs were made by other code than the present.

    Those that lack a newer column are among them. ``plugins`` are those of the runs.
    """
    here = codes.read_column_digests().digest
    return [
        r for r in records if r.measured_by != here or r.code != codes.digest_run_code(r.problem, r.solver, plugins)
    ]


def replace_outdated(
    folder: Path,
    outdated: Sequence[RunRecord],
    jobs: int,
    run: Callable[[Request], object],
    plugins: tuple[str, ...] = (),
) -> RemeasuredRuns:
    """Solve the ``outdated`` runs of ``folder`` again, and replace the measurements of those that have the same bits.

    Return which were replaced, and which were left and why; the table of the folder is written anew. ``run`` executes
    a request, ``jobs`` runs at a time. Plugins of the runs must be loaded. Raise FileError if another command writes to
    the folder.
    """
    done = RemeasuredRuns()
    with store.lock_folder(folder):
        done.set_aside = add_column_digests(folder, codes.read_column_digests())
        asked, specs = _list_asked(folder, plugins), dict[str, RunSpec]()
        with provide_commit_folders() as folder_of:
            for record in outdated:
                try:
                    _check_origin(folder, record, plugins, folder_of)
                    specs[record.run_id] = _find_spec(record, asked)
                except ValueError as error:
                    done.left.append((record, str(error)))
        some = [r for r in outdated if r.run_id in specs]
        for k in range(0, len(some), AT_ONCE):
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
                _remeasure_records(folder, some[k : k + AT_ONCE], specs, Path(place), jobs, run, plugins, done)
        store.write_table(folder, store.select_newest(store.load(folder, check_series=False).records))
    return done


def _remeasure_records(
    folder: Path,
    some: Sequence[RunRecord],
    specs: Mapping[str, RunSpec],
    place: Path,
    jobs: int,
    run: Callable[[Request], object],
    plugins: tuple[str, ...],
    done: RemeasuredRuns,
) -> None:
    """Solve the runs ``some`` again below ``place``, and replace the measurements of each that has the same bits.

    Runs whose files have every state and all others are solved separately. ``specs`` are the specs to solve, by run_id.
    The new records, and the reasons why other runs stay as they are, are added to ``done``.
    """
    kept = {r.run_id: _inspect_series(r, store.read_run_series(folder, r, poses=False)) for r in some}
    for lossless in (False, True):
        alike = [r for r in some if kept[r.run_id].lossless is lossless]
        if not alike:
            continue
        again = {r.run_id: _solve_once(specs[r.run_id], r) for r in alike}
        rows = {again[r.run_id].settings_id: kept[r.run_id].rows for r in alike}
        different = tuple({s.settings_id: s for s in again.values()}.values())
        suite = Suite("again", "finished runs solved again", different, "", plugins)
        there = place / ("lossless" if lossless else "thinned")
        run(Request(suite, there, jobs, lossless=lossless, choose_rows=_make_row_lookup(rows)))
        found = {r.settings_id: r for r in store.load(there, check_series=False).records}
        for record in alike:
            new = found.get(again[record.run_id].settings_id)
            if why := _find_difference(record, kept[record.run_id].steps_sha256, new, there):
                done.left.append((record, why))
            elif new is not None:
                own = codes.digest_run_code(record.problem, record.solver, plugins)
                done.records.append(_replace_record(folder, record, there, new, specs[record.run_id].address(own)))


@contextmanager
def provide_commit_folders() -> Iterator[Callable[[str], Path]]:
    """Yield a function that returns a folder with the code of a commit, extracted from the repository.

    The folders are temporary: they are removed at the end of the ``with`` block.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        known = dict[str, Path]()

        def extract_commit(commit: str) -> Path:
            """Return the folder with the code of ``commit``, which the first call extracts.

            Raise ValueError if the repository does not have the commit.
            """
            if commit not in known:
                content = io.BytesIO(environment.archive_commit(commit))
                root = Path(place) / commit
                with tarfile.TarFile(fileobj=content) as archive:
                    archive.extractall(root, filter="data")
                known[commit] = root
            return known[commit]

        yield extract_commit


def _check_origin(folder: Path, record: RunRecord, plugins: tuple[str, ...], folder_of: Callable[[str], Path]) -> None:
    """Raise ValueError if a run of ``folder`` cannot be measured again: it was killed, or more than laws has changed.

    The plugins, and the code of its solver, its problem and what counts its cost, must be those of the run.
    ``folder_of`` returns the folder with the code of a commit.
    """
    if record.series and not record.claimed:
        raise ValueError("its process was ended before its solver returned: run its suite again")
    name = f"environment.{record.environment}.json"
    stamp = read_environment(folder, name if (ConfinedPath(folder) / name).is_own_file() else "environment.json")
    named = stamp.get("plugins")
    made_with = sorted(Path(str(p)).name for p in named) if isinstance(named, list) else []
    if made_with != sorted(Path(p).name for p in plugins):
        asked = " ".join(f"--plugin {name}" for name in made_with)
        raise ValueError(f"it was made {f'with {asked}' if asked else 'without plugins'}: give the same plugins")
    then = codes.list_run_digests(record.problem, record.solver, folder_of(record.commit))
    now = codes.list_run_digests(record.problem, record.solver)
    changed = [what for what, digest in now.items() if then[what] != digest]
    if changed:
        raise ValueError(f"the code of {' and '.join(changed)} has changed, so that its cost may differ: run it again")


def _find_spec(record: RunRecord, asked: Mapping[str, RunSpec]) -> RunSpec:
    """Return the spec of a record's run with its limits, from the folder's own suite or, without one, from the record.

    ``asked`` are the specs of that suite by ``settings_id``; empty without a suite. Raise ValueError if the suite does
    not contain the run.
    """
    if not asked:
        return rebuild_spec(record)
    if record.settings_id not in asked:
        raise ValueError("the suite stored in the folder does not contain it: run its own suite again")
    return asked[record.settings_id]


def _make_row_lookup(rows: Mapping[str, tuple[str, ...] | None]) -> Callable[[RunSpec], tuple[str, ...] | None]:
    """Return a function that gives, for a spec, the series whose rows its file keeps (None: every step)."""
    return lambda spec: rows[spec.settings_id]


def _list_asked(folder: Path, plugins: tuple[str, ...]) -> Mapping[str, RunSpec]:
    """Return the specs of the suite whose copy is in the folder, with their limits, by ``settings_id``.

    Empty if there is no copy, or only one in an older format.
    """
    copy = ConfinedPath(folder) / f"{OWN_COPY}.toml"
    if not copy.is_own_file():
        return {}
    try:
        return {s.settings_id: s for s in load_suite(str(copy.path), plugins).specs}
    except (FileError, ValueError):  # a suite in an older format: each run is rebuilt from its record
        return {}


def _solve_once(spec: RunSpec, record: RunRecord) -> RunSpec:
    """Return the spec that repeats the record's motion: as many steps, one solve, no loop to measure CPU time."""
    return dataclasses.replace(limit_steps(spec, record), repeats=1, min_time=0.0)


def _inspect_series(record: RunRecord, series: Series | None) -> _KeptSeries:
    """Return what the new series file of a run must have, too: the steps, all states or not, and the same rows."""
    if series is None:
        return _KeptSeries()
    whole = not series.is_brief and len(series.arrays.get("state_t", ())) == record.steps + 1
    return _KeptSeries(series.steps_sha256, whole, _list_rows(series))


def _list_rows(series: Series) -> tuple[str, ...] | None:
    """Return the names of the series that a brief file keeps row by row; None for a file of every step."""
    if not series.is_brief:
        return None
    whole = len(series["t"])
    other = (*(f"{kind}_" for kind in POSES), *OTHER)
    kept = sorted(k for k, a in series.arrays.items() if a.shape[:1] == (whole,) and not k.startswith(other))
    return (*kept, *((MARKS,) if MARKS in series.arrays else ()))


def _find_difference(record: RunRecord, steps: str, new: RunRecord | None, there: Path) -> str:
    """Return in words how the repeated run differs from the record; empty if it does not.

    ``steps`` is the digest of the record's steps, ``new`` the record of the repeated run in the folder ``there``, None
    without one. The status of equal steps may differ, since another law judges them; without steps it may not.
    """
    if new is None:
        return "it has no result when solved again"
    again = store.read_run_series(there, new, poses=False)
    same_kind = (again is None) == (not record.series) and record.claimed == new.claimed
    if not same_kind or (again is None and record.status != new.status):
        return f"it is {new.status} when solved again"
    if again is not None and again.steps_sha256 != steps:
        return "its steps are not the same bit for bit when solved again: it is another motion, run its suite again"
    return ""


def _replace_record(folder: Path, record: RunRecord, there: Path, new: RunRecord, run_id: str) -> RunRecord:
    """Replace ``record`` in ``folder`` by one with the measurements of ``new`` in the folder ``there``; return it.

    The files of ``record`` are set aside first; its standard error is copied. The columns ``KEPT`` stay, as does the
    status of a run that did not claim success. ``run_id`` is that of the new record.
    """
    judged = record.claimed == Status.SUCCESS
    status: dict[str, Any] = {} if judged else {"status": record.status, "wrong_because": "[]"}
    note = f"measured again by code {new.measured_by}; solved and timed by code {record.code}"
    files: dict[str, Any] = {"series": "", "stderr": ""}
    contents = dict[str, bytes]()
    if new.series:
        files["series"] = name_series_file(run_id, brief=new.series.endswith(".xz"))
        contents[files["series"]] = (ConfinedPath(there) / new.series).read(LARGEST)
    if record.stderr:
        files["stderr"] = f"stderr/{run_id}.txt"
        contents[files["stderr"]] = (ConfinedPath(folder) / record.stderr).read(store.NATIVE)
    found = dataclasses.replace(
        new,
        **{name: getattr(record, name) for name in KEPT},
        **status,
        **files,
        run_id=run_id,
        notes=format_notes([*new.note_lines, note]),
        commit=environment.read_commit(),
    )
    store.set_aside(folder, list_record_files(folder, record, WHY))  # first: the address of the run may be the same
    for name, content in contents.items():
        (ConfinedPath(folder) / name).write(content)
    store.list_as_started(folder, run_id)
    store.write_record(folder, found)
    return found
