"""Read and write the file of thresholds: TOML with a line per run, grouped by problem.

Bounds that follow a rule are not stored.

HEAD explains the cells of a line. A bound with a reason of its own has a line with the fields of ``QuantityBound``.
"""

import json
import math
import re
from contextlib import suppress
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import field
from msgspec.structs import asdict, fields

from ...base.files import FileError, parse_toml, read_text
from ...base.shapes import Finite, Shape, convert_shape
from ...results.environment import ROOT
from . import thresholds as rules
from .thresholds import BoundWidth, ExpectedStatus, QuantityBound, Spread, Threshold, Thresholds

FOLDER = ROOT / "results" / "baselines"
HEAD = """\
# Cells, v being the measured value: v (from v / width to v width; steps: v itself), l<v<u (from l to u),
# v<u (at most u: rounding, or 5 v, left over by a stop test), - (no bound, or one under `bounds`)
schema = 2"""
HEADINGS = {  # columns of the table: metric, and its padded name without unit
    m: re.sub(r"(_error)?(_max)?(_J|_m|_rad|_N)?$", "", m).ljust(19 if "phi" in m else 10)
    for m in (*rules.BOUNDED, "steps")
}
# widths of a line, by the factor that stands in its first cell
WIDTHS = {f"{w.factor:g}": w for w in (rules.FIXED_STEP, rules.ERROR_CONTROL)}


class _Problem(Shape, frozen=True):
    """The table of a problem in the file: a line of cells for each run, and bounds that fit no cell."""

    problem_fingerprint: Finite | None = None
    runs: dict[str, str] = field(default_factory=dict)
    bounds: dict[str, dict[str, QuantityBound]] = field(default_factory=dict)


class _File(Shape, frozen=True):
    """The content of the file of thresholds."""

    schema: Literal[2]
    suite: str
    columns: str = ""
    spread: Spread | None = None
    status: tuple[ExpectedStatus, ...] = ()
    problem: dict[str, _Problem] = field(default_factory=dict)


def read_thresholds(path: Path, suite: str = "", *, is_new: bool = False) -> Thresholds:
    """Read a file of thresholds and check every entry; raise FileError if it is invalid, or of another ``suite``.

    An empty ``suite`` accepts any. If the file ``is_new``, it is not read, and there are no thresholds.
    """
    found = Thresholds(suite) if is_new else parse_thresholds(read_text(path, "thresholds"), path)
    if suite and found.suite != suite:
        raise FileError(f"{path} holds thresholds of the suite {found.suite!r}, not of {suite!r}")
    return found


def parse_thresholds(text: str, path: Path) -> Thresholds:
    """Parse the text of a thresholds file, with the bounds that follow a rule and are not stored.

    ``path`` names the file in messages. Raise FileError if the text is invalid.
    """
    file = convert_shape(parse_toml(text, str(path)), _File, str(path))
    bounds: list[Threshold] = []
    case = "bounds"
    try:
        for name, problem in file.problem.items():
            for run in {**problem.runs, **problem.bounds}:
                case, special = f"{name} {run}" if run else name, problem.bounds.get(run, {})
                bounds += [Threshold(case=case, metric=metric, **asdict(b)) for metric, b in special.items()]
                if run in problem.runs:
                    bounds += _read_row(case, file.columns.split(), problem.runs[run].split())
                if problem.problem_fingerprint is not None and rules.FINGERPRINT not in special:
                    bounds.append(rules.require_same_problem(case, problem.problem_fingerprint))
        return Thresholds(file.suite, tuple(sorted(bounds, key=lambda b: (b.case, b.metric))), file.status, file.spread)
    except ValueError as e:
        raise FileError(f"{path}: {case}: {e}") from None


def _read_row(case: str, columns: list[str], cells: list[str]) -> list[Threshold]:
    """Return the thresholds in the line of a run, split into ``cells``.

    ``columns`` are the headings of the cells: ``width``, then metrics. Raise ValueError if they do not fit the cells,
    or if the width is none of ``WIDTHS``.
    """
    if len(cells) != len(columns) or columns[:1] != ["width"]:
        raise ValueError(f"{len(cells)} cells for {len(columns)} columns, of which the first must be width")
    rule = WIDTHS.get(cells[0])
    if rule is None:
        raise ValueError(f"width must be {' or '.join(WIDTHS)} (got {cells[0]!r})")
    row = zip(columns[1:], cells[1:], strict=True)
    return [_read_cell(case, metric, cell, rule) for metric, cell in row if cell != "-"]


def _read_cell(case: str, metric: str, cell: str, rule: BoundWidth) -> Threshold:
    """Return the threshold that a cell means; raise ValueError unless the cell has one of the forms in ``HEAD``.

    A cell with one number has the bounds that follow from it by the ``rule`` of its line, or the exact number of steps.
    """
    try:
        numbers = [msgspec.convert(x, Finite, strict=False) for x in cell.split("<")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2, 3):
        raise ValueError(f"{metric} must be v, v<u, l<v<u or - (got {cell!r})")
    if len(numbers) == 1 and metric == "steps":
        return rules.require_same_steps(case, numbers[0])
    if len(numbers) == 1:
        return rules.bound_by_rule(case, metric, numbers[0], rule)
    lower, value, upper = [-math.inf, *numbers][-3:]
    if len(numbers) == 2:
        rule = (
            rules.LEFT_OVER if upper == rules.round_to_four_digits(rules.LEFT_OVER.factor * value) else rules.ROUNDING
        )
    return Threshold(case=case, metric=metric, value=value, upper=upper, lower=lower, reason=rule.reason)


def format_thresholds(thresholds: Thresholds) -> str:
    """Return thresholds as the TOML text of their file, with a table per problem; nothing is written."""
    out = [
        HEAD,
        f"suite = {_format_toml(thresholds.suite)}",
        f"columns = {_format_toml(' '.join(['width', *HEADINGS]))}",
    ]
    if thresholds.spread:
        out += ["", "[spread]", *(f"{key} = {_format_toml(value)}" for key, value in asdict(thresholds.spread).items())]
    for e in thresholds.statuses:
        out += ["", "[[status]]", *(f"{key} = {_format_toml(value)}" for key, value in asdict(e).items())]
    bounds = sorted(thresholds.bounds, key=lambda b: (*_split_case(b.case), b.metric))
    for name, group in groupby(bounds, lambda b: _split_case(b.case)[0]):
        runs = {case: {b.metric: b for b in of_run} for case, of_run in groupby(group, lambda b: b.case)}
        out += _format_problem(f"problem.{_format_toml(name)}", runs)
    return "\n".join(out) + "\n"


def _split_case(case: str) -> tuple[str, str]:
    """Split a case at its first space into the names of its problem and its run."""
    name, _, run = case.partition(" ")
    return name, run


def _format_problem(table: str, runs: dict[str, dict[str, Threshold]]) -> list[str]:
    """Return the lines of the TOML table named ``table``: a line of cells per run, then the bounds that fit no cell.

    ``runs`` has the thresholds by case and metric; from it, the fingerprint that all runs share is removed. A line has
    the width by which most of its cells can be written.
    """
    prints = [bounds.get(rules.FINGERPRINT) for bounds in runs.values()]
    common = prints[0].value if prints[0] and all(b and b.tolerance is not None for b in prints) else None
    rows, special = [f"#{'width':>54}  {'  '.join(HEADINGS.values())}"], []
    for case, bounds in runs.items():
        if common is not None and bounds[rules.FINGERPRINT] == rules.require_same_problem(case, common):
            del bounds[rules.FINGERPRINT]
        run = _format_toml(_split_case(case)[1])
        fitting = [
            (w, {m: cell for m, b in bounds.items() if (cell := _format_cell(b, rule))}) for w, rule in WIDTHS.items()
        ]
        width, cells = max(fitting, key=lambda x: len(x[1]))
        own = [b for metric, b in bounds.items() if metric not in cells]
        if cells or not own:
            texts = "  ".join(cells.get(m, "-").ljust(len(heading)) for m, heading in HEADINGS.items())
            rows.append(f'{run:<46} = "{width:<5}  {texts.rstrip()}"')
        if own:
            special += ["", f"[{table}.bounds.{run}]", *map(_format_bound, own)]
    shared = [f"{rules.FINGERPRINT} = {common!r}"] if common is not None else []
    return ["", f"[{table}]", *shared, f"[{table}.runs]", *rows, *special]


def _format_cell(b: Threshold, width: BoundWidth) -> str:
    """Return the shortest cell that is read as the threshold ``b`` in a line with this ``width``; empty if none is."""
    value, lower, upper = (f"{x:.7g}" for x in (b.value, b.lower, b.upper))
    for cell in (value, f"{value}<{upper}", f"{lower}<{value}<{upper}") if b.metric in HEADINGS else ():
        with suppress(ValueError):
            if _read_cell(b.case, b.metric, cell, width) == b:
                return cell
    return ""


def _format_bound(b: Threshold) -> str:
    """Return a bound that fits no cell as a line of TOML, without fields that have their default."""
    told = {f.name: v for f in fields(QuantityBound) if (v := getattr(b, f.name)) != f.default and v == v}
    return f"{b.metric} = {{ {', '.join(f'{k} = {_format_toml(v)}' for k, v in told.items())} }}"


def _format_toml(value: Any) -> str:
    """Format a number or a text for TOML: as in JSON, but without surrogate pairs and with DEL escaped."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
