"""The terminal: consoles of the right width, tables that fit, numbers and series in a few characters."""

import itertools
import math
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import rich.console
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from ..harness.files import to_json

if TYPE_CHECKING:
    import numpy as np

    from ..harness.results.store import Unreadable

PIPED = 200  # columns where no terminal gives a width: a case on one line, for grep
STYLE = {"success": "green", "refused": "cyan", "wrong": "bold red"}  # of a status; others are yellow
BARS = "▁▂▃▄▅▆▇█"
DECADES = 16.0  # shown at most
FEW = 8  # files that could not be read with a line each
GAP = 2  # columns of text between two columns of a table


class Console(rich.console.Console):
    """A console that leaves a closed pipe to its caller."""

    def on_broken_pipe(self) -> None:
        """Raise BrokenPipeError again: ``main`` ends with 141, Rich would end with 1."""
        raise BrokenPipeError


def table_console(*, stderr: bool = False) -> Console:
    """A console for tables: as wide as the terminal (or COLUMNS), else wide enough to fold nothing."""
    out = Console(highlight=False, stderr=stderr)
    return out if out.is_terminal or os.environ.get("COLUMNS") else Console(width=PIPED, highlight=False, stderr=stderr)


def console() -> Console:
    """A console for lines that are not folded: messages and JSON."""
    return Console(highlight=False, markup=False, soft_wrap=True)


def error_console() -> Console:
    """A console for lines on standard error."""
    return Console(stderr=True, highlight=False, markup=False, soft_wrap=True)


def print_json(plain: Any) -> None:
    """``plain`` on one line; null for a number that is not finite."""
    console().print(to_json(plain))


def status_style(status: str) -> str:
    """The colour of a status."""
    return STYLE.get(str(status), "yellow")


def print_unreadable(items: "Iterable[Unreadable]", out: Console | None = None) -> None:
    """Files that could not be read, and why; on standard error, unless ``out`` is given."""
    for line in list_unreadable("unreadable", [(str(item.path), item.why) for item in items]):
        (out or error_console()).print(line)


def list_unreadable(what: str, items: Sequence[tuple[str, str]]) -> list[str]:
    """A line for each name and why; of more than ``FEW`` how many there are, and the first."""
    if len(items) <= FEW:
        return [f"{what}: {name}: {why}" for name, why in items]
    return [f"{what}: {len(items)} files, the first is {items[0][0]}: {items[0][1]}"]


@dataclass(frozen=True)
class Column:
    """A column of a table; those of the largest ``rank`` are left out first where a terminal is too narrow."""

    name: str
    rank: int = 0
    right: bool = True
    fold: bool = False  # may be folded to ``least`` characters, and is never right
    least: int = 24


def fit_table(columns: Sequence[Column], rows: Sequence[Sequence[Text | str]], width: int) -> Table:
    """A table of at most ``width`` characters: first columns of large rank are left out, then text folds."""
    # unfolded
    needs = [max(cell_len(str(entry)) for entry in (c.name, *(row[k] for row in rows))) for k, c in enumerate(columns)]
    kept = list(range(len(columns)))

    def least() -> int:
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
    """The table, if it has rows, and the lines ``below`` it."""
    out = out or table_console()
    if rows:
        out.print(fit_table(columns, rows, out.width))
    for line in below:
        out.print(Text(line))


def _share_width(columns: Sequence[Column], kept: Sequence[int], needs: Sequence[int], width: int) -> dict[int, int]:
    """Characters for each column: what it needs, or for those that may be folded a share of the rest."""
    room = {k: needs[k] for k in kept if not columns[k].fold}
    left = width - sum(room.values()) - GAP * len(kept)
    folding = sorted((k for k in kept if columns[k].fold), key=lambda k: needs[k])
    for n, k in enumerate(folding):  # the shortest first: the others get what it does not need
        room[k] = max(1, min(needs[k], left // (len(folding) - n)))
        left -= room[k]
    return room


def _add_blanks(text: str, room: int) -> str:
    """Lists of options with blanks to fold at."""
    return text if cell_len(text) <= room else re.sub(r",(?! )", ", ", text).replace("[", " [")


def plural(n: int, word: str) -> str:
    """``1 run``, ``3 runs``."""
    return f"{n} {word}{'' if n == 1 else 's'}"


def number(value: float, digits: int = 3) -> str:
    """Significant digits, without an exponent from 1e-4 to 1e6, or a dash for NaN."""
    text = "-" if math.isnan(value) else f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def sparkline(values: Sequence[float], width: int, *, log: bool = True) -> str:
    """``values`` in ``width`` characters, the largest of each stretch; ``log``: a bar is a power of ten or more.

    A blank stands for missing values; zero is at the bottom.
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
    if log:  # a bar a decade at least, nothing below rounding
        low = max(min(low, high - (len(BARS) - 1)), high - DECADES)
    return "".join(_choose_bar(x, low, high) for x in tops)


def _choose_bar(x: float, low: float, high: float) -> str:
    if math.isnan(x):
        return " "
    share = (x - low) / (high - low) if high > low else 0.0
    return BARS[round(min(max(share, 0.0), 1.0) * (len(BARS) - 1))]


def timeline(t: "np.ndarray", values: "np.ndarray", t_end: float, width: int) -> str:
    """``values`` over the time from 0 to ``t_end``; a star marks where a run stopped early."""
    if not len(t) or not t_end > 0.0:
        return ""
    import numpy as np

    place = np.minimum((np.asarray(t) / t_end * width).astype(int), width - 1)
    size = np.abs(np.asarray(values, dtype=float))
    tops = np.full(width, np.nan)
    np.fmax.at(tops, place, np.where(np.isfinite(size), size, np.nan))
    last = int(place[-1])
    for k in range(1, last):  # a long step leaves stretches without a value of their own
        tops[k] = tops[k - 1] if math.isnan(tops[k]) else tops[k]
    line = sparkline(tops.tolist(), width)
    return line if t[-1] > t_end * (1.0 - 1e-6) else (line[: last + 1] + "*").ljust(width)[:width]
