"""Show a results folder as a table on the terminal, or one of its runs in detail (``show``)."""

import argparse
import csv
import json
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from ..harness.base.files import FileError
from ..harness.base.hints import suggest_name
from ..harness.base.text import escape_text
from ..harness.columns.declaring import find_key
from ..harness.mechanics.types import Status
from ..harness.results import records, store
from ..harness.results.provenance import read_environment
from ..harness.results.records import COLUMNS, DECLARED, RunRecord, find_limit
from ..harness.results.reproduce import write_command
from ..harness.results.series import OTHER, POSES
from ..harness.results.words import (
    describe_breach,
    describe_ending,
    describe_errors,
    describe_status,
    find_error_end,
    list_reasons,
    qualify_status,
    select_judged_error,
)
from ..harness.run.full_series import name_run
from .arguments import UsageError, load_plugins
from .commands import FILTERS, SORTS
from .full_series import provide_full_series
from .terminal import (
    Column,
    choose_status_style,
    draw_timeline,
    fit_table,
    make_console,
    make_table_console,
    number,
    plural,
    print_json,
    print_table,
    print_unreadable,
)

SERIES = {  # name in the series file: label
    "energy_error": "|dE| [J]",
    "position_error": "error [m]",
    "orientation_error": "error [rad]",
    "phi_norm": "|phi| [m]",
    "phi_dot_norm": "|phi'| [m/s]",
    "dt": "step [s]",
}
SETTINGS = ("label", "section", "suite", "dt_s", "rtol", "max_step_s", "max_steps", "t_end_s", "cpu_limit_s")
NOT_NUMBERS = {*SETTINGS, "schema", "exit_code", "signal", "memory_limit_MB"}
LAST = 5  # lines of standard error
SPARK = 12  # characters of the energy error over time
PREFIX = 7  # characters of the run_id in the table
RUN_ID = re.compile(r"[0-9a-f]{4,16}")  # full, or its first digits
NAMED = 4  # most runs named in a message
DERIVED = {  # columns of the table that are no field of a record, with their places
    "position_error": (90, Column("error [m]", rank=2)),
    "error_until": (91, Column("error to [s]", rank=2)),
    "orientation_error": (100, Column("error [rad]", rank=4)),
}
ERRORS: dict[str, Callable[[RunRecord], float]] = {  # as in the reports
    "position_error": lambda r: select_judged_error(r, "position_error", "m"),
    "error_until": find_error_end,
    "orientation_error": lambda r: select_judged_error(r, "orientation_error", "rad"),
}


def _list_columns() -> dict[str, Column]:
    """Return the columns with numbers of the table by name, in order of their places.

    They are the record's columns that are declared for the table, and errors as reports show them.
    """
    own = {k: (d.order, Column(d.tables["show"] or k, d.rank)) for k, d in DECLARED.items() if "show" in d.tables}
    found = sorted((DERIVED | own).items(), key=lambda item: item[1][0])
    return {name: column for name, (_, column) in found}


SHOWN = _list_columns()


def show_run(folder: Path, record: RunRecord, command: str) -> None:
    """Print a run in detail: status, reasons, settings, series, numbers, standard error, ``command`` to repeat it."""
    out = make_table_console()
    ending = describe_ending(record)
    out.print(Text(record.case, "bold"))
    out.print(
        Text.assemble((describe_status(record), choose_status_style(record.status)), f": {ending}" if ending else "")
    )
    for reason in record.reasons:
        out.print(Text(f"  because: {describe_breach(reason)}"))
    if error := describe_errors(record):
        out.print(Text(f"error {error}"))
    for words in record.note_lines:
        out.print(Text(f"  note: {escape_text(words)}"))
    _print_heading(out, "Settings")
    for name, value in _list_settings(record).items():
        out.print(Text(f"  {name:<18} {value}"))
    _print_series(out, folder, record)
    _print_heading(out, "Measured")
    _print_numbers(out, record)
    if native := store.read_stderr(folder, record):
        _print_heading(out, f"Standard error (last lines of {record.stderr})")
        for line in native.splitlines()[-LAST:]:
            out.print(Text("  " + line))
    _print_heading(out, "Command that repeats this run")
    make_console().print(f"  {command}")


def print_steps(folder: Path, record: RunRecord, plugins: tuple[str, ...]) -> None:
    """Print every step as CSV with full precision; the run is solved again if its results keep envelopes.

    Raise UsageError if it has no steps, FileError if it has more than a series file holds.
    """
    series = store.read_run_series(folder, record, poses=False)
    if series is None:
        raise UsageError(f"{name_run(record)} has no steps")
    lacking = [record] if series.envelopes or len(series["t"]) <= record.steps else []
    with provide_full_series(folder, lacking, 1, plugins, lossless=False) as again:
        series = again.get(record.run_id, series)
    rows = len(series["t"])
    if rows <= record.steps:  # a complete series has the start, too
        raise FileError(f"{name_run(record)} has {record.steps} steps: more than the {rows} rows of a series file")
    names = [k for k, a in series.arrays.items() if a.shape == (rows,) and not k.startswith((*POSES, *OTHER))]
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(names)
    out.writerows(zip(*(series[name].tolist() for name in names), strict=True))


def _list_settings(r: RunRecord) -> dict[str, str]:
    """Return problem, solver and settings of a record by name, without those that were not set."""
    out = {
        "problem": _format_assignments(r.problem, r.parameters),
        "solver": _format_assignments(r.solver, r.options),
    }
    for name in SETTINGS:
        value = getattr(r, name)
        if value not in ("", 0) and not (isinstance(value, float) and math.isnan(value)):
            out[name] = f"{value:.12g}" if isinstance(value, float) else str(value)
    return {**out, "run_id": r.run_id, "code, commit": f"{r.code}, {r.commit or 'none'}", "finished": r.finished}


def _format_assignments(name: str, given: Mapping[str, Any]) -> str:
    """Join a name and its parameters or options: ``chain links=6``."""
    return " ".join([name, *(f"{k}={json.dumps(v)}" for k, v in given.items())])


def _print_series(out: Console, folder: Path, record: RunRecord) -> None:
    """Print a sparkline over time and the range of each of ``SERIES`` that the run recorded."""
    _print_heading(out, f"Over time, 0 to {record.t_end_s:g} s (one bar is a factor of ten; * marks where it stopped)")
    try:
        series = store.read_run_series(folder, record)
    except FileError as error:
        out.print(Text(f"  unreadable: {error}"))
        return
    if series is None:
        out.print("  no steps were kept")
        return
    width = max(10, min(60, out.width - 46))
    for name, words in SERIES.items():
        if name in series:
            t, values = series.points(name)
            finite = np.abs(values[np.isfinite(values)])
            ends = f"{finite.min():.2e} to {finite.max():.2e}" if len(finite) else "-"
            line = draw_timeline(t, values, record.t_end_s, width)
            out.print(Text(f"  {words:<12} {line}  {ends}"))


def _print_numbers(out: Console, record: RunRecord) -> None:
    """Print every measured number of a record that is known, with its meaning; then invariants and observables."""
    rows = []
    for c in COLUMNS:
        value = getattr(record, c.name)
        if c.type in (float, int) and c.name not in NOT_NUMBERS and not math.isnan(value):
            limit = find_limit(record, c.name)
            words = f"; limit {limit:.6g}" if 0.0 < limit < math.inf else ""
            rows.append((f"  {c.name}", f"{value:.6g}", f"{DECLARED[c.name].doc}{words}"))
    for words, found in (("invariant_drift", record.invariants), ("observable_error", record.observables)):
        rows += [(f"  {words}: {name}", f"{d.max:.6g}", f"{d.unit}, max") for name, d in found.items()]
    columns = (
        Column("  column", fold=True),
        Column("value"),
        Column("meaning", fold=True, least=20),
    )
    out.print(fit_table(columns, rows, out.width))


def _print_heading(out: Console, words: str) -> None:
    """Print a heading with an empty line above it."""
    out.print(Text(f"\n{words}", "bold"))


def run(arguments: argparse.Namespace) -> int:
    """Print the runs as a table or as JSON, one run in detail, or with --steps its steps as CSV.

    Return 1 if a file could not be read, else 0.
    """
    folder = arguments.results
    loaded = store.load(folder, check_series=arguments.json)
    plugins = [p for p in read_environment(folder).get("plugins", []) if isinstance(p, str)]
    if arguments.steps:
        if arguments.run_name is None or arguments.json:
            raise UsageError("--steps prints the steps of one RUN as CSV: give it, and no --json")
        print_steps(folder, find_run(loaded.records, arguments.run_name, folder), load_plugins(arguments.plugin))
        return 0
    unreadable = dict(loaded.unreadable)
    chosen = _select_runs(loaded.records, arguments)
    if arguments.json:
        for record in chosen:
            plain = json.loads(records.format_record(record))
            print_json({**plain, "command": write_command(record, plugins)})
    elif arguments.run_name is not None:
        show_run(folder, chosen[0], write_command(chosen[0], plugins))
    else:
        key = arguments.sort and find_sort_column(arguments.sort)
        _print_runs(chosen, [_draw_energy(folder, r, unreadable) for r in chosen], key)
    print_unreadable(unreadable)
    return 1 if unreadable else 0


def _select_runs(found: Sequence[RunRecord], arguments: argparse.Namespace) -> list[RunRecord]:
    """Return the run that is named, or all runs filtered, sorted and limited as the options say.

    Runs are sorted by magnitude, the largest first and unknown numbers last. Raise UsageError for an unknown run or
    column, and for a word of a filter that matches no run.
    """
    if arguments.run_name is not None:
        return [find_run(found, arguments.run_name, arguments.results)]
    chosen = list(found)
    for name in FILTERS:
        given = getattr(arguments, name)
        if given is None:
            continue
        wanted, known = given.split(","), sorted({str(getattr(r, name)) for r in found})
        for word in wanted:
            if word not in known:
                raise UsageError(f"--{name}: no run has {name} {word!r}{suggest_name(word, known)}")
        chosen = [r for r in chosen if getattr(r, name) in wanted]
    if arguments.sort is not None:
        key, numeric = find_sort_column(arguments.sort), list_sort_columns()
        if key not in numeric and key not in ERRORS:
            raise UsageError(f"--sort: unknown column {key!r}{suggest_name(key, [*SORTS, *numeric])}")
        magnitude = {r.run_id: abs(_read_column(r, key)) for r in chosen}
        chosen.sort(key=lambda r: math.inf if math.isnan(magnitude[r.run_id]) else -magnitude[r.run_id])
    return chosen[: arguments.limit]


def list_sort_columns() -> list[str]:
    """Return the names of the columns of records that are numbers."""
    return [c.name for c in records.COLUMNS if c.type in (float, int)]


def find_sort_column(given: str) -> str:
    """Return the name of the column to sort by; ``given`` is that name, its key in tables, or a word of ``SORTS``.

    An unknown word is returned as it is.
    """
    # reversed: of several columns with the same key the first counts
    keys = {find_key(name, DECLARED[name]): name for name in reversed(list_sort_columns()) if DECLARED[name].head}
    return SORTS.get(given) or (given if given in (*list_sort_columns(), *ERRORS) else keys.get(given, given))


def find_run(found: Sequence[RunRecord], given: str, folder: Path) -> RunRecord:
    """Return the run of ``folder`` with that run_id, its first digits, or that case.

    Raise UsageError unless there is exactly one.
    """
    match = [r for r in found if given in (r.run_id, r.case)]
    match = match or [r for r in found if given and r.run_id.startswith(given)]
    if not match:
        raise UsageError(f"no run {given!r} in these results{_suggest_runs(found, given, folder)}")
    if len(match) > 1:
        raise UsageError(f"{given!r} is the start of {len(match)} runs: {', '.join(r.run_id for r in match[:5])}")
    return match[0]


def _suggest_runs(found: Sequence[RunRecord], given: str, folder: Path) -> str:
    """Return a hint for the end of a message that ``folder`` has no run ``given``.

    For a run_id, the hint names a results folder beside this one that has the run, else some runs of ``folder``; for a
    case, the most similar one.
    """
    if not RUN_ID.fullmatch(given):
        return suggest_name(given, [r.case for r in found][:500])[:200]
    beside = (p for p in folder.resolve().parent.iterdir() if p.resolve() != folder.resolve())
    if where := next((p for p in sorted(beside) if any((p / "runs").glob(f"{given}*.json"))), None):
        return f": it is of {where.name}"
    some = [f"{r.run_id[:PREFIX]} ({r.case})" for r in found[:NAMED]]
    more = f" and {len(found) - NAMED} more, which mbsbench show {folder} lists" if found[NAMED:] else ""
    return f", which has {', '.join(some) or 'none'}{more}"


def _draw_energy(folder: Path, record: RunRecord, unreadable: dict[Path, str]) -> str:
    """Draw the energy error of a run over time; empty without a series. A damaged file is added to ``unreadable``."""
    try:
        series = store.read_run_series(folder, record)
    except FileError as error:
        unreadable[folder / record.series] = str(error)
        return ""
    return "" if series is None else draw_timeline(*series.points("energy_error"), record.t_end_s, SPARK)


def _read_column(r: RunRecord, name: str) -> float:
    """Return a number by which runs are shown or sorted: an error as the reports judge it, or a field of the record."""
    return ERRORS[name](r) if name in ERRORS else float(getattr(r, name))


def _print_runs(chosen: Sequence[RunRecord], sparks: Sequence[str], key: str | None = None) -> None:
    """Print a row per run with its sparkline, a line per run that failed or has a qualified success, and the counts.

    A line on a failed run gives the reasons, one on a success the qualifiers of its status. ``sparks`` are the drawn
    energy errors over time, one per run; the column ``key`` that the runs are sorted by is added to the table.
    """
    shown = SHOWN if key is None or key in SHOWN or key == "steps" else {**SHOWN, key: Column(key)}
    columns = [
        Column("run", rank=1, right=False),
        Column("case", fold=True),
        Column("status", right=False),
        Column("steps", rank=7),
        next(iter(shown.values())),
        Column("dE over time", right=False),
        *list(shown.values())[1:],
    ]
    rows: list[tuple[Text | str, ...]] = []
    for r, spark in zip(chosen, sparks, strict=True):
        first, *rest = [number(_read_column(r, name)) for name in shown]
        status = Text(r.status, choose_status_style(r.status))
        rows.append((r.run_id[:PREFIX], r.case, status, str(r.steps), first, spark, *rest))
    failed = [r for r in chosen if r.status != Status.SUCCESS]
    below = [f"{r.run_id[:PREFIX]} {describe_status(r)}: {r.case}: {'; '.join(list_reasons(r))}" for r in failed]
    qualified = [r for r in chosen if r.status == Status.SUCCESS and qualify_status(r)]
    below += [f"{r.run_id[:PREFIX]} {describe_status(r)}: {r.case}" for r in qualified]
    counts = f"{plural(len(chosen), 'run')}, {len(chosen) - len(failed)} success"
    print_table(columns, rows, *below, f"{counts}; `mbsbench show RESULTS RUN` shows one")
