"""One run on the terminal: settings, numbers, series over time, standard error, and the command that repeats it."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from ..results import store
from ..results.records import COLUMNS, RunRecord, reasons_of
from ..results.series import BadSeries
from ..results.words import words_of, words_of_ending
from .screen import Column, fitted, lines, screen, status_style, timeline

SERIES = {  # name in the series file: label
    "energy_error": "|dE| [J]", "position_error": "error [m]", "orientation_error": "error [rad]",
    "phi_norm": "|phi| [m]", "phi_dot_norm": "|phi'| [m/s]", "dt": "step [s]",
}  # fmt: skip
SETTINGS = ("label", "section", "suite", "dt_s", "rtol", "max_step_s", "max_steps", "t_end_s", "wall_limit_s")
NOT_NUMBERS = {*SETTINGS, "schema", "exit_code", "signal", "memory_limit_MB"}
LAST = 5  # lines of standard error


def show_run(folder: Path, record: RunRecord, command: str) -> None:
    """Print all of it."""
    out = screen()
    ending = words_of_ending(record)
    out.print(Text(record.case, "bold"))
    out.print(Text.assemble((record.status, status_style(record.status)), f": {ending}" if ending else ""))
    for reason in reasons_of(record.wrong_because):
        out.print(Text(f"  because: {words_of(reason)}"))
    for words in json.loads(record.notes):
        out.print(Text(f"  note: {words}"))
    _heading(out, "Settings")
    for name, value in _settings(record).items():
        out.print(Text(f"  {name:<18} {value}"))
    _series(out, folder, record)
    _heading(out, "Measured")
    _numbers(out, record)
    native = folder / record.stderr if record.stderr else None
    if native is not None and native.is_file():
        _heading(out, f"Standard error (last lines of {record.stderr})")
        for line in native.read_text(encoding="utf-8", errors="replace").splitlines()[-LAST:]:
            out.print(Text("  " + _printable(line)))
    _heading(out, "Command that repeats this run")
    lines().print(f"  {command}")


def _settings(r: RunRecord) -> dict[str, str]:
    out = {"problem": _assigned(r.problem, r.problem_parameters), "solver": _assigned(r.solver, r.solver_options)}
    for name in SETTINGS:
        value = getattr(r, name)
        if value not in ("", 0) and not (isinstance(value, float) and math.isnan(value)):
            out[name] = f"{value:.12g}" if isinstance(value, float) else str(value)
    return {**out, "run_id": r.run_id, "code, commit": f"{r.code}, {r.commit or 'none'}", "finished": r.finished}


def _assigned(name: str, text: str) -> str:
    return " ".join([name, *(f"{k}={json.dumps(v)}" for k, v in json.loads(text).items())])


def _series(out: Console, folder: Path, record: RunRecord) -> None:
    _heading(out, f"Over time, 0 to {record.t_end_s:g} s (one bar is a factor of ten; * marks where it stopped)")
    try:
        series = store.series_of(folder, record)
    except BadSeries as error:
        out.print(Text(f"  unreadable: {error}"))
        return
    if series is None:
        out.print("  no steps were kept")
        return
    width = max(10, min(60, out.width - 46))
    for name, words in SERIES.items():
        if name in series:
            finite = np.abs(series[name][np.isfinite(series[name])])
            ends = f"{finite.min():.2e} to {finite.max():.2e}" if len(finite) else "-"
            line = timeline(series["t"], series[name], record.t_end_s, width)
            out.print(Text(f"  {words:<12} {line}  {ends}"))


def _numbers(out: Console, record: RunRecord) -> None:
    rows = []
    for c in COLUMNS:
        value = getattr(record, c.name)
        if c.type in (float, int) and c.name not in NOT_NUMBERS and not math.isnan(value):
            rows.append((f"  {c.name}", f"{value:.6g}", str(c.metadata["doc"])))
    for name in ("invariant_drifts", "observable_errors"):
        for key, entry in json.loads(getattr(record, name)).items():
            rows.append((f"  {name[:-1]}: {key}", f"{_of(entry, 'max'):.6g}", f"{entry.get('unit', '')}, max"))
    columns = (Column("  column", fold=True), Column("value"), Column("meaning", fold=True, least=20))
    out.print(fitted(columns, rows, out.width))


def _of(entry: Any, key: str) -> float:
    try:
        return float(entry[key])
    except (TypeError, KeyError, ValueError):
        return math.nan


def _heading(out: Console, words: str) -> None:
    out.print(Text(f"\n{words}", "bold"))


def _printable(line: str) -> str:
    """Without control characters: a process may have written what moves the cursor."""
    return "".join(c if c.isprintable() or c == "\t" else "?" for c in line)
