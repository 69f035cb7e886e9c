"""List the columns of every table of a report.

Columns of the record are declared in ``harness/columns/declared/``. Here are those that pages derive from several.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from ...harness.columns.declaring import Declaration, find_key
from ...harness.results.records import DECLARED, find_cpu_range, find_limit
from ...harness.results.shadows import SYMPLECTIC
from ...harness.results.words import select_judged_error
from . import words
from .accuracy import ErrorMeasure, energy_kind
from .results import StoredRun
from .words import NONE, format_cpu_time, mark_status, number

Value = float | str


@dataclass(frozen=True)
class PageColumn:
    """A column of tables; ``of`` is its unformatted value for a run: NaN or an empty text if it has none."""

    key: str  # in CSV
    head: str
    doc: str  # meaning, without its capital and full stop
    of: Callable[[StoredRun], Value]
    order: int
    unit: str = ""
    show: str = "number"  # name of the function of ``words`` that formats it; empty for a text
    latex: str = ""  # head in LaTeX; empty to leave the column out
    better: str = ""  # "less" or "more"
    tables: Mapping[str, str] = field(default_factory=dict)  # tables of pages that have it: its head there
    name: str = ""  # of the record's column, if it is one

    @property
    def is_text(self) -> bool:
        """True for words instead of numbers."""
        return not self.show

    @property
    def format(self) -> Callable[[float], str]:
        """The function that formats a number of the column."""
        found: Callable[[float], str] = getattr(words, self.show)
        return found

    def text(self, run: StoredRun) -> str:
        """Format the value as the table shows it."""
        value = self.of(run)
        return (value or NONE) if isinstance(value, str) else self.format(value)

    def limit(self, run: StoredRun) -> str:
        """Format the limit of the value for a run; empty if it has none."""
        limit = find_limit(run.record, self.name) if self.name else math.nan
        return f"{number(limit)} {self.unit}".strip() if 0.0 < limit < math.inf else ""

    @property
    def heading(self) -> str:
        """The head with the unit."""
        return f"{self.head} [{self.unit}]" if self.unit else self.head

    @property
    def marked_heading(self) -> str:
        """The heading with the mark of ``marks.table`` for numbers."""
        return self.heading if self.is_text else f"#{self.heading}"

    @property
    def meaning(self) -> str:
        """The meaning as sentences, with whether less or more is better."""
        return f"{self.doc[0].upper()}{self.doc[1:]}.{f' {self.better.capitalize()} is better.' if self.better else ''}"


def _make_declared_column(name: str, d: Declaration) -> PageColumn:
    """Return the column of tables for the record's column ``name``, as its declaration ``d`` says."""
    return PageColumn(
        find_key(name, d),
        d.head,
        d.doc,
        lambda run: getattr(run.record, name),
        d.order,
        d.unit,
        d.show,
        d.latex,
        d.better,
        d.tables,
        name,
    )


def _judge(name: str, unit: str) -> Callable[[StoredRun], Value]:
    """Return the function of a column that is an error up to the time to which errors are judged."""
    return lambda run: select_judged_error(run.record, name, unit)


def _show_spread(run: StoredRun) -> Value:
    """Format the quartiles of the CPU times [s] and the number of repeats; a dash for a single timing."""
    low, high = map(format_cpu_time, find_cpu_range(run.record))
    return f"{low} to {high} ({run.record.repeats})" if run.record.repeats > 1 else NONE


def _read_nearest(name: str) -> Callable[[StoredRun], Value]:
    """Return a function that reads the field ``name`` of the true motion near a run; it gives NaN without one."""

    def read(run: StoredRun) -> Value:
        """Return the field ``name`` of the true motion near the run."""
        value: float | None = getattr(run.nearest, name, None)
        return math.nan if value is None else value

    return read


UNTIL = "up to the time that errors are judged to"
ERROR = PageColumn(  # of the tables of pages alone: that of the problem's measure
    "error",
    "Error",
    "the error that judges the problem's runs",
    lambda run: math.nan,
    85,
    "m",
    tables={"problem": "", "runs": ""},
)
DERIVED = (  # columns that are no field of a record
    PageColumn(
        "settings",
        "Settings",
        "step or tolerance, and options that differ from the defaults",
        lambda run: run.settings(),
        20,
        latex="Settings",
    ),
    PageColumn(
        "status",
        "Status",
        "how the run ended; wrong: success was claimed, but a law is broken; inaccurate: all laws hold, but the motion "
        "is off the reference",
        lambda run: mark_status(run.status).word,
        30,
        latex="Status",
    ),
    PageColumn(
        "energy_kind",
        "Energy error",
        "drifts if its mean shifts from the first to the last quarter of the run by over a third of its largest value, "
        "else bounded; this says nothing of its size",
        energy_kind,
        80,
        show="",
        tables={"problem": "Energy", "runs": "Energy"},
    ),
    PageColumn(
        "position_error",
        "Position error",
        f"largest distance of a centre of mass from its exact position, {UNTIL}",
        _judge("position_error", "m"),
        90,
        "m",
        latex="Error [m]",
        better="less",
    ),
    PageColumn(
        "orientation_error",
        "Orientation error",
        "largest angle between a body and its exact orientation, up to there",
        _judge("orientation_error", "rad"),
        100,
        "rad",
        latex="Error [rad]",
        better="less",
    ),
    PageColumn(
        "motion_error",
        "Motion error",
        "largest distance of a body from its exact pose, root mean square over its matter: position and orientation in "
        "one number; up to there",
        _judge("motion_error", "m"),
        110,
        "m",
        better="less",
    ),
    PageColumn(
        "true_motion",
        "True motion within",
        "largest distance of a centre of mass from some true motion, as mbsbench shadow finds it: what counts once "
        "chaos has made the error meaningless",
        _read_nearest("largest_m"),
        190,
        "m",
    ),
    PageColumn("true_motion_until", "over", "up to this time", _read_nearest("until_s"), 200, "s", "time"),
    PageColumn(
        "symplectic",
        "Symplectic",
        f"whether the modified energy of a fixed step swings by less than {SYMPLECTIC:g} of the scale; coarse steps "
        "may hide it",
        lambda run: run.nearest.symplectic if run.nearest else "",
        210,
    ),
    PageColumn(
        "cpu_spread",
        "CPU spread",
        "quartiles of the repeated timings, and how many; a dash for a single one",
        _show_spread,
        390,
        "s",
    ),
)
COLUMNS = tuple(
    sorted(
        (*DERIVED, *(_make_declared_column(name, d) for name, d in DECLARED.items() if d.head)), key=lambda c: c.order
    )
)


def list_page_columns(table: str, measure: ErrorMeasure | None = None, unit: str = "") -> list[PageColumn]:
    """Return the columns of a page's ``table``, "problem" or "runs", beside the run's name, with their heads there.

    The column of errors is that of ``measure``, the error that judges the runs; ``unit`` replaces its unit in a table
    of several problems.
    """
    error = ERROR if measure is None else replace(ERROR, of=measure.of, unit=measure.unit)
    error = replace(error, unit=unit or error.unit)
    shown = sorted((*COLUMNS, error), key=lambda c: c.order)
    return [replace(c, head=c.tables[table] or c.head) for c in shown if table in c.tables]
