"""Results over commits: one row for each run of each results folder and from small files of such rows.

Rows are matched by ``settings_id``, which the code is no part of: a line over time is one ``settings``.
"""

from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from ..files import parse_json, read_text, to_json, write_text
from ..shapes import convert_shape
from . import store
from .provenance import describe_processor, stamp_of
from .records import RunRecord
from .rows import METRICS, NAN, Row

COMMITTED = Path("results") / "history"  # rows worth keeping for good, one file a run
GATES = "history"  # beside the results folders: rows of runs that were judged by the gate and not kept
SAME = ("suite", "settings_id", "case", "label", "problem", "solver", "status")  # as in a record


def read_folder(folder: Path) -> list[Row]:
    """The rows of a results folder."""
    return make_rows(
        folder.resolve().name, stamp_of(folder), store.newest(store.load(folder, check_series=False).records)
    )


def merge_rows(of_folders: Iterable[Iterable[Row]], of_files: Iterable[Iterable[Row]]) -> tuple[Row, ...]:
    """All rows, the oldest first; judged rows, from files, replace those of folders."""
    found: dict[tuple[str, str], Row] = {}
    for row in chain(chain.from_iterable(of_folders), chain.from_iterable(of_files)):  # files last: judged
        found[row.results, row.settings_id] = row
    return _add_ratios(sorted(found.values(), key=lambda r: (r.time, r.results, r.case)))


def make_rows(
    results: str, stamp: Mapping[str, Any], records: Iterable[RunRecord], gate: Mapping[str, str] | None = None
) -> list[Row]:
    """The rows of one run; ``stamp`` is its ``environment.json``, ``gate`` the state of each judged case."""
    out = []
    for r in records:
        words: dict[str, Any] = {k: getattr(r, k) for k in SAME}
        numbers: dict[str, Any] = {k: float(getattr(r, k)) for k in METRICS if k != "cpu_ratio"}
        time = str(stamp.get("started") or r.finished)
        state = (gate or {}).get(r.case, "")
        out.append(Row(r.commit, time, results, **words, gate=state, **numbers, processor=describe_processor(stamp)))
    return out


def find_histories(local: Path = store.LOCAL, committed: Path = COMMITTED) -> tuple[list[Path], list[Path]]:
    """The results folders and the files of rows that there are."""
    folders = sorted(p for p in local.glob("*") if store.is_results(p) and not p.is_symlink())
    return folders, [*sorted(committed.glob("*.jsonl")), *sorted((local / GATES).glob("*.jsonl"))]


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """JSON lines; numbers that do not exist are null, ratios too: they depend on what else there is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, "".join(to_json(replace(r, cpu_ratio=NAN)) + "\n" for r in rows))


def read_rows(path: Path) -> list[Row]:
    """The inverse of ``write_rows``, or FileError."""
    lines = read_text(path, "rows").splitlines()
    return [_parse_row(line, f"{path}:{n}") for n, line in enumerate(lines, start=1) if line.strip()]


def _parse_row(line: str, where: str) -> Row:
    plain = parse_json(line, where)
    if isinstance(plain, dict):
        plain = {k: NAN if v is None and k in METRICS else v for k, v in plain.items()}
    return convert_shape(plain, Row, where)


def _add_ratios(rows: Iterable[Row]) -> tuple[Row, ...]:
    first: dict[tuple[str, str], float] = {}
    out = []
    for row in rows:
        ratio = NAN
        if row.status == "success" and row.cpu_min_s > 0.0:
            ratio = row.cpu_min_s / first.setdefault((row.settings_id, row.processor), row.cpu_min_s)
        out.append(replace(row, cpu_ratio=ratio))
    return tuple(out)
