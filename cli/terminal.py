"""Print to the terminal: consoles of the right width, tables that fit, numbers and series in few characters."""

import itertools
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import rich.console
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from ..harness.base.files import to_json

if TYPE_CHECKING:
    import numpy as np

PIPED = 200  # width without a terminal: keeps a case on one line, for grep
STYLE = {"success": "green", "refused": "cyan", "wrong": "bold red"}  # colours of statuses; others are yellow
BARS = "▁▂▃▄▅▆▇█"
DECADES = 16.0  # most decades shown
FEW = 8  # most unreadable files with a line each
GAP = 2  # characters between two columns of a table


class Console(rich.console.Console):
    """A console that leaves the handling of a closed pipe to its caller."""

    def on_broken_pipe(self) -> None:
        """Raise BrokenPipeError again, so that ``main`` ends with 141; Rich would end with 1."""
        raise BrokenPipeError


def make_table_console(*, stderr: bool = False) -> Console:
    """Return a console for tables: as wide as the terminal (or COLUMNS), else wide enough to fold nothing."""
    out = Console(highlight=False, stderr=stderr)
    return out if out.is_terminal or os.environ.get("COLUMNS") else Console(width=PIPED, highlight=False, stderr=stderr)


def make_console() -> Console:
    """Return a console for messages and JSON, whose lines are not folded."""
    return Console(highlight=False, markup=False, soft_wrap=True)


def make_error_console() -> Console:
    """Return a console for lines on standard error."""
    return Console(stderr=True, highlight=False, markup=False, soft_wrap=True)


def print_json(plain: Any) -> None:
    """Print ``plain`` data as JSON on one line of standard output, with null for a number that is not finite."""
    make_console().print(to_json(plain))


def choose_status_style(status: str) -> str:
    """Return the Rich style in which a status is printed."""
    return STYLE.get(str(status), "yellow")


def print_unreadable(items: Mapping[Path, str], out: Console | None = None) -> None:
    """Print files that could not be read, and why; on standard error unless ``out`` is given."""
    for line in list_unreadable("unreadable", [(str(path), why) for path, why in items.items()]):
        (out or make_error_console()).print(line)


def list_unreadable(what: str, items: Sequence[tuple[str, str]]) -> list[str]:
    """Return a line ``what: name: reason`` for each pair of ``items``, or for more than ``FEW`` of them a single line.

    That states their number and the first pair.
    """
    if len(items) <= FEW:
        return [f"{what}: {name}: {why}" for name, why in items]
    return [f"{what}: {len(items)} files, the first is {items[0][0]}: {items[0][1]}"]


@dataclass(frozen=True)
class Column:
    """A column of a table; the largest ``rank`` is dropped first if a terminal is too narrow, rank 0 never."""

    name: str
    rank: int = 0
    right: bool = True  # aligned to the right
    fold: bool = False  # may be folded to ``least`` characters, and is never right
    least: int = 24  # [characters]


def fit_table(columns: Sequence[Column], rows: Sequence[Sequence[Text | str]], width: int) -> Table:
    """Return a table that fits into ``width`` characters: columns of large rank are dropped until folding suffices.

    The table is wider only if columns of rank 0, which are never dropped, do not fit when folded.
    """
    # width of each column without folding
    needs = [max(cell_len(str(entry)) for entry in (c.name, *(row[k] for row in rows))) for k, c in enumerate(columns)]
    kept = list(range(len(columns)))

    def least() -> int:
        """Return the width of the table with the columns ``kept`` [characters], when all that may fold are folded."""
        return sum(min(needs[k], columns[k].least) if columns[k].fold else needs[k] for k in kept) + GAP * len(kept)

    while least() > width and any(columns[k].rank for k in kept):
        kept.remove(max(kept, key=lambda k: columns[k].rank))
    room = _share_width(columns, kept, needs, width)
    table = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False)
    for k in kept:
        c = columns[k]
        justify: Literal["left", "right"] = "right" if c.right and not c.fold else "left"
        table.add_column(Text(c.name), justify=justify, overflow="fold", no_wrap=not c.fold, width=room[k])
    for row in rows:
        entries = [row[k] if isinstance(row[k], Text) else Text(_add_blanks(str(row[k]), room[k])) for k in kept]
        table.add_row(*entries)
    return table


def print_table(
    columns: Sequence[Column], rows: Sequence[Sequence[Text | str]], *below: str, out: Console | None = None
) -> None:
    """Print the table, if it has rows, and the lines ``below`` it."""
    out = out or make_table_console()
    if rows:
        out.print(fit_table(columns, rows, out.width))
    for line in below:
        out.print(Text(line))


def _share_width(columns: Sequence[Column], kept: Sequence[int], needs: Sequence[int], width: int) -> dict[int, int]:
    """Return the width of each kept column by index: the width it needs, or if it may fold, a share of the rest.

    ``needs`` are the widths without folding, ``width`` is that of the table, all in characters.
    """
    room = {k: needs[k] for k in kept if not columns[k].fold}
    left = width - sum(room.values()) - GAP * len(kept)
    folding = sorted((k for k in kept if columns[k].fold), key=lambda k: needs[k])
    for n, k in enumerate(folding):  # the shortest first, which leaves its spare width to the others
        room[k] = max(1, min(needs[k], left // (len(folding) - n)))
        left -= room[k]
    return room


def _add_blanks(text: str, room: int) -> str:
    """Add blanks to a list of options wider than ``room``, so that it can fold."""
    return text if cell_len(text) <= room else re.sub(r",(?! )", ", ", text).replace("[", " [")


def plural(n: int, word: str) -> str:
    """Format a count with its noun: ``1 run``, ``3 runs``."""
    return f"{n} {word}{'' if n == 1 else 's'}"


def number(value: float, digits: int = 3) -> str:
    """Format significant digits, without an exponent from 1e-4 to 1e6; a dash for NaN."""
    text = "-" if math.isnan(value) else f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def draw_sparkline(values: Sequence[float], width: int, *, log: bool = True) -> str:
    """Draw ``values`` as ``width`` block characters, each for the largest magnitude in an equal part of the values.

    With ``log`` one step of a bar's height is a power of ten or more, and zero is at the bottom. A blank stands for
    missing values.
    """
    if not values:
        return ""
    width = min(width, len(values))
    edges = [round(k * len(values) / width) for k in range(width + 1)]
    parts = [[x for x in values[a:b] if math.isfinite(x)] for a, b in itertools.pairwise(edges)]
    tops = [max(part, key=abs) if part else math.nan for part in parts]
    if log:
        tops = [math.log10(abs(x)) if x else -math.inf for x in tops]  # NaN stays NaN
    seen = [x for x in tops if math.isfinite(x)]
    high, low = max(seen, default=0.0), min(seen, default=0.0)
    if log:  # at least a decade per bar, and nothing below rounding
        low = max(min(low, high - (len(BARS) - 1)), high - DECADES)
    return "".join(_choose_bar(x, low, high) for x in tops)


def _choose_bar(x: float, low: float, high: float) -> str:
    """Return the block character for ``x`` between ``low`` and ``high``; a blank for NaN."""
    if math.isnan(x):
        return " "
    share = (0.5 * x - 0.5 * low) / (0.5 * high - 0.5 * low) if high > low else 0.0  # halves: a span may overflow
    return BARS[round(min(max(share, 0.0), 1.0) * (len(BARS) - 1))]


def draw_timeline(t: "np.ndarray", values: "np.ndarray", t_end: float, width: int) -> str:
    """Draw the magnitudes of ``values`` at times ``t`` [s] on a scale from 0 to ``t_end``, in ``width`` characters.

    A star marks where a run stopped early. Without values, or for an end time of 0, the line is empty.
    """
    if not len(t) or not t_end > 0.0:
        return ""
    import numpy as np

    place = np.minimum((np.asarray(t) / t_end * width).astype(int), width - 1)
    size = np.abs(np.asarray(values, dtype=float))
    tops = np.full(width, np.nan)
    np.fmax.at(tops, place, np.where(np.isfinite(size), size, np.nan))
    last = int(place[-1])
    for k in range(1, last):  # a long step spans several characters
        tops[k] = tops[k - 1] if math.isnan(tops[k]) else tops[k]
    line = draw_sparkline(tops.tolist(), width)
    return line if t[-1] > t_end * (1.0 - 1e-6) else (line[: last + 1] + "*").ljust(width)[:width]
