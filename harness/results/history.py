"""Results over commits: one row for each run of each run, from run folders and from small files of such rows.

Rows are matched by ``settings``, which the code is no part of: a line over time is one ``settings``.
"""

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import store
from .provenance import stamp_of
from .records import RunRecord

COMMITTED = Path("results") / "history"  # rows worth keeping for good, one file a run
GATES = "history"  # beside the run folders: rows of runs that were judged by the gate and not kept
NAN = float("nan")


class HistoryError(ValueError):
    """A file of rows that cannot be read; one line."""


@dataclass(frozen=True)
class Row:
    """One run of one run. NaN where a quantity does not exist."""

    commit: str  # '+dirty' when the checkout had changes
    time: str  # UTC, ISO 8601: when the run was started
    results: str
    suite: str
    settings_id: str
    case: str
    label: str
    problem: str
    solver: str
    status: str
    gate: str = ""  # the worst state of the gate's findings on the run; empty where no gate has judged
    energy_drift_max_J: float = NAN
    energy_scale_J: float = NAN
    position_error_max_m: float = NAN
    position_error_judged_m: float = NAN
    orientation_error_max_rad: float = NAN
    phi_max: float = NAN
    phi_dot_max: float = NAN
    steps: float = NAN
    cpu_min_s: float = NAN
    cpu_ratio: float = NAN  # cpu_min_s over that of the oldest success of this run on the same processor
    processor: str = ""


SAME = ("suite", "settings_id", "case", "label", "problem", "solver", "status")  # as in a record
METRICS = tuple(f.name for f in dataclasses.fields(Row) if f.type is float)
WORDS = tuple(f.name for f in dataclasses.fields(Row) if f.type is str)


def history(folders: Iterable[Path], files: Iterable[Path] = ()) -> tuple[Row, ...]:
    """All rows, the oldest first; a run of a run that is there twice, once."""
    found: dict[tuple[str, str], Row] = {}
    for path in files:
        for row in read_rows(path):
            found[row.results, row.settings_id] = row
    for folder in folders:
        records = store.newest(store.load(folder, check_series=False).records)
        for row in rows_of(folder.resolve().name, stamp_of(folder), records):
            found.setdefault((row.results, row.settings_id), row)
    return _with_ratios(sorted(found.values(), key=lambda r: (r.time, r.results, r.case)))


def rows_of(
    results: str, stamp: Mapping[str, Any], records: Iterable[RunRecord], gate: Mapping[str, str] | None = None
) -> list[Row]:
    """The rows of one run; ``stamp`` is its ``environment.json``, ``gate`` the state of each judged case."""
    out = []
    for r in records:
        words: dict[str, Any] = {
            k: getattr(r, k) for k in ("suite", "settings_id", "case", "label", "problem", "solver", "status")
        }
        numbers: dict[str, Any] = {k: float(getattr(r, k)) for k in METRICS if k != "cpu_ratio"}
        time = str(stamp.get("started") or r.finished)
        state = (gate or {}).get(r.case, "")
        out.append(Row(r.commit, time, results, **words, gate=state, **numbers, processor=str(stamp.get("cpu") or "")))
    return out


def standing(local: Path = store.LOCAL, committed: Path = COMMITTED) -> tuple[list[Path], list[Path]]:
    """The run folders and the files of rows that there are."""
    folders = sorted(p for p in local.glob("*") if (p / "runs").is_dir() and not p.is_symlink())
    return folders, [*sorted(committed.glob("*.jsonl")), *sorted((local / GATES).glob("*.jsonl"))]


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """JSON lines; numbers that do not exist are null, ratios are left out: they depend on what else there is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = [{k: v for k, v in as_plain(r).items() if k != "cpu_ratio"} for r in rows]
    store.write_text(path, "".join(json.dumps(p, ensure_ascii=False, allow_nan=False) + "\n" for p in plain))


def read_rows(path: Path) -> list[Row]:
    """The inverse of ``write_rows``, or HistoryError."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise HistoryError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    return [_row(line, f"{path}:{n}") for n, line in enumerate(lines, start=1) if line.strip()]


def as_plain(row: Row) -> dict[str, Any]:
    """JSON-able: None for a number that does not exist."""
    plain = dataclasses.asdict(row)
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in plain.items()}


def _row(line: str, where: str) -> Row:
    try:
        plain = json.loads(line)
        words: dict[str, Any] = {k: plain[k] for k in WORDS if k != "gate" or k in plain}
        numbers: dict[str, Any] = {k: NAN if plain.get(k) is None else plain[k] for k in METRICS}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise HistoryError(f"{where} is not a row of a history") from None
    good = all(isinstance(v, str) for v in words.values())
    if not good or not all(isinstance(v, int | float) and not isinstance(v, bool) for v in numbers.values()):
        raise HistoryError(f"{where} is not a row of a history")
    try:
        return Row(**words, **{k: float(v) for k, v in numbers.items()})  # type: ignore[arg-type]
    except OverflowError:
        raise HistoryError(f"{where} holds a number that is too large") from None


def _with_ratios(rows: Iterable[Row]) -> tuple[Row, ...]:
    first: dict[tuple[str, str], float] = {}
    out = []
    for row in rows:
        ratio = NAN
        if row.status == "success" and row.cpu_min_s > 0.0:
            ratio = row.cpu_min_s / first.setdefault((row.settings_id, row.processor), row.cpu_min_s)
        out.append(dataclasses.replace(row, cpu_ratio=ratio))
    return tuple(out)
