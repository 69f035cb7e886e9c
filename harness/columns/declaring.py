"""Declare a column of a run's record: its number, unit and meaning, and where it is shown.

A column is a field of a class in ``harness/columns/declared/``, and this is all that is needed::

    path_longest_m: float = column(
        "length of the path of a centre of mass over all steps, of the body with the longest",
        of=measure_longest_path,
        head="Longest path",
        unit="m",
    )

The record, ``runs.parquet``, ``mbsbench show``, ``diff`` and ``--sort`` take every column. One with a ``head`` is also
in tables as CSV, on the page of each run and among the meanings of the page *Method*. Records that are older than a
column have its default; tables show a dash.
"""

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .measured import MeasuredMotion

NAN = float("nan")
KEY = "column"  # key of the declaration in the metadata of its field
LAST = 1000  # place in tables of a column that asks for none: after those that do
TABLES = ("problem", "runs", "show")  # tables of a problem's page, of the page of all runs, and of the terminal
UNIT = re.compile(r"_(?:[a-zA-Z]+_per_[a-z]+|sqrtJ|MB|rad|Nm|J|W|N|m|s)$")  # at the end of a column's name
Number = Callable[[MeasuredMotion], Any]
Along = Callable[[MeasuredMotion], "np.ndarray | None"]


@dataclass(frozen=True)
class Declaration:
    """The declaration of a column; ``of`` and ``along`` make its number, all else says what it is and where it stands.

    ``of`` is the number of a measured motion, None where it does not exist there; ``along`` its value at each step
    (nt,), of which the largest magnitude is the number unless ``of`` is given.
    """

    doc: str  # meaning: a sentence without its capital and full stop
    of: Number | None = None
    along: Along | None = None
    series: str = ""  # name of ``along`` in series files, if it is stored
    head: str = ""  # in tables; empty for a column of the record alone
    unit: str = ""
    key: str = ""  # in CSV
    order: int = LAST  # place in tables
    show: str = "number"  # the function of ``reports/model/words.py`` that formats it
    latex: str = ""  # head in LaTeX; empty to leave it out
    tables: Mapping[str, str] = dataclasses.field(default_factory=dict)  # of ``TABLES`` that have it: head in each
    rank: int = 9  # in the terminal's table: the largest is dropped first where it is narrow
    better: str = ""  # "less" or "more"; empty where neither is
    limit: Callable[[Any], float] | None = None  # limit of a record's number; it is shown, and decides no status
    scale: str | None = None  # column that its changes are compared with, "" for 1; None: changes are not ranked
    figure: str = ""  # caption of its plot over time; empty for none
    unchecked: str = ""  # reason why the checker of bundles does not recompute it


def column(doc: str, default: Any = NAN, *, tables: Sequence[str] | Mapping[str, str] = (), **given: Any) -> Any:
    """Return the field of a record for a column with the meaning ``doc``; raise ValueError if its parts contradict.

    Records without the column get ``default``. ``tables`` are names of ``TABLES``, or such names with heads of their
    own; ``given`` are further fields of ``Declaration``.
    """
    heads = dict(tables) if isinstance(tables, Mapping) else dict.fromkeys(tables, "")
    declared = Declaration(doc, tables=heads, **given)
    _check_declaration(declared)
    return dataclasses.field(default=default, metadata={KEY: declared, "doc": doc})


def _check_declaration(d: Declaration) -> None:
    """Raise ValueError for a declaration that contradicts itself."""
    if unknown := d.tables.keys() - set(TABLES):
        raise ValueError(f"tables must be of {', '.join(TABLES)} (got {', '.join(sorted(unknown))})")
    if d.better not in ("", "less", "more"):
        raise ValueError(f'better must be "less", "more" or empty (got {d.better!r})')
    if (d.figure or d.series) and d.along is None:
        raise ValueError("a figure or a series needs along, the value at each step")
    if not d.head and (d.latex or any(not head for head in d.tables.values())):
        raise ValueError("a column in tables needs a head")


def read_declaration(field: "dataclasses.Field[Any]") -> Declaration:
    """Return the declaration of a field of a record."""
    found: Declaration = field.metadata[KEY]
    return found


def find_key(name: str, declared: Declaration) -> str:
    """Return the key of a column in CSV: its own, or its name without the unit."""
    return declared.key or UNIT.sub("", name)


def find_unit(name: str, declared: Declaration) -> str:
    """Return the unit of a column, which ends its name unless it is declared: ``m/s``; empty if it has none."""
    ends = UNIT.search(name)
    return ends[0][1:].replace("_per_", "/") if ends else declared.unit


def find_series_name(name: str, declared: Declaration) -> str:
    """Return the name of a column's value at each step in series files: the column's own unless another is given."""
    return declared.series or name
