"""Collect results over commits: one row per run of each results folder, and rows from small files.

Rows are matched by ``settings_id``, which excludes the code: all points of a line over time have the same.
"""

from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from ..base.files import parse_json, read_text, to_json, write_text
from ..base.shapes import convert_shape
from . import store
from .provenance import describe_processor, read_environment
from .records import RunRecord
from .rows import METRICS, NAN, Row

COMMITTED = Path("results") / "history"  # rows that are kept permanently, one file per run
GATES = "history"  # beside the results folders: rows of runs judged by the gate and not kept
SAME = ("suite", "settings_id", "case", "label", "problem", "solver", "status")  # columns as in a record


def read_folder(folder: Path) -> list[Row]:
    """Return the rows of a results folder, one per run, from its newest records and its stamp."""
    return make_rows(
        folder.resolve().name,
        read_environment(folder),
        store.select_newest(store.load(folder, check_series=False).records),
    )


def merge_rows(of_folders: Iterable[Iterable[Row]], of_files: Iterable[Iterable[Row]]) -> tuple[Row, ...]:
    """Return the rows of all results folders and all files in one sequence, the oldest first, with CPU time ratios.

    If a folder and a file have a row for the same run, that of the file is taken, since the gate has judged it.
    """
    found: dict[tuple[str, str], Row] = {}
    # files last, since their rows are judged
    for row in chain(chain.from_iterable(of_folders), chain.from_iterable(of_files)):
        found[row.results, row.settings_id] = row
    return _add_ratios(sorted(found.values(), key=lambda r: (r.time, r.results, r.case)))


def make_rows(
    results: str, stamp: Mapping[str, Any], records: Iterable[RunRecord], gate: Mapping[str, str] | None = None
) -> list[Row]:
    """Return a row for each record of the results folder named ``results``.

    ``stamp`` is the folder's ``environment.json``; ``gate`` maps the cases that the gate judged to their states. Ratios
    of CPU times are left NaN.
    """
    out = []
    for r in records:
        words: dict[str, Any] = {k: getattr(r, k) for k in SAME}
        numbers: dict[str, Any] = {k: float(getattr(r, k)) for k in METRICS if k != "cpu_ratio"}
        time = str(stamp.get("started") or r.finished)
        state = (gate or {}).get(r.case, "")
        out.append(Row(r.commit, time, results, **words, gate=state, **numbers, processor=describe_processor(stamp)))
    return out


def find_histories(local: Path = store.LOCAL, committed: Path = COMMITTED) -> tuple[list[Path], list[Path]]:
    """Return the results folders in ``local``, and the files of rows: committed ones and those written by the gate."""
    folders = sorted(p for p in local.glob("*") if store.is_results(p) and not p.is_symlink())
    return folders, [*sorted(committed.glob("*.jsonl")), *sorted((local / GATES).glob("*.jsonl"))]


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as lines of JSON; NaN becomes null, and so do ratios, which depend on the other rows."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, "".join(to_json(replace(r, cpu_ratio=NAN)) + "\n" for r in rows))


def read_rows(path: Path) -> list[Row]:
    """Read the rows in a file that ``write_rows`` wrote; raise FileError, with the line, if one is invalid."""
    lines = read_text(path, "rows").splitlines()
    return [_parse_row(line, f"{path}:{n}") for n, line in enumerate(lines, start=1) if line.strip()]


def _parse_row(line: str, where: str) -> Row:
    """Return the row in a line of JSON; ``where`` names the line in messages."""
    plain = parse_json(line, where)
    if isinstance(plain, dict):
        plain = {k: NAN if v is None and k in METRICS else v for k, v in plain.items()}
    return convert_shape(plain, Row, where)


def _add_ratios(rows: Iterable[Row]) -> tuple[Row, ...]:
    """Return the rows, which are sorted by time, with ``cpu_ratio`` filled in for successes.

    It is the CPU time over that of the oldest success of the same run on the same processor.
    """
    first: dict[tuple[str, str], float] = {}
    out = []
    for row in rows:
        ratio = NAN
        if row.status == "success" and row.cpu_min_s > 0.0:
            ratio = row.cpu_min_s / first.setdefault((row.settings_id, row.processor), row.cpu_min_s)
        out.append(replace(row, cpu_ratio=ratio))
    return tuple(out)
