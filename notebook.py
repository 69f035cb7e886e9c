"""Show problems, runs, records and results as tables in a notebook: text alone, in the colours of the notebook."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from .harness.base.text import escape_text
from .harness.mechanics.types import Problem, Status
from .harness.results.records import COLUMNS, RunRecord
from .harness.results.words import describe_errors, describe_status, list_reasons

FEW = 30  # most runs of a folder with a row each: a screen; a page of the report or ``table()`` has all
LEFT = ' style="text-align: left"'  # Jupyter aligns cells to the right, which is for numbers


def show_problem(problem: Problem) -> str:
    """Return a problem as an HTML table: its system, its times, what is observed and where its numbers come from."""
    p, s = problem, problem.system
    given = ", ".join(f"{k} = {v}" for k, v in p.parameters.items())
    rows = {
        "parameters": given,
        "system": f"{_count(s.nb, 'body', 'bodies')}, {_count(s.nj, 'joint')}, {_count(s.nrows, 'row')} of constraints",
        "simulated time": f"{p.t_end:g} s",
        "step": f"{p.dt:g} s, unless another is given",
        "observables": ", ".join(o.name for o in p.observables),
        "invariants": ", ".join(i.name for i in p.invariants),
        "reference": "computed by two formulations" if p.reference_from is None else "given by the problem",
        "source": p.source if p.section in p.source else f"{p.section}: {p.source}",
    }
    return _show_rows(p.name, rows)


def show_run(record: RunRecord) -> str:
    """Return a run as an HTML table: how it ended and why, its errors and its cost."""
    r = record
    rows = {
        "status": describe_status(r) or "none",
        "because": "" if r.status == Status.SUCCESS else "; ".join(list_reasons(r)),
        "reached": f"{r.t_reached_s:g} of {r.t_end_s:g} s in {_count(r.steps, 'step')}",
        "energy drift": _number(r.energy_drift_max_J, "J"),
        "error": describe_errors(r),
        "CPU time": _number(r.cpu_median_s, "s"),
    }
    if math.isnan(r.t_reached_s):  # a refusal, or a crash before the first step
        del rows["reached"]
    return _show_rows(r.case, rows)


def show_record(record: RunRecord) -> str:
    """Return a record as HTML: the table of its run, and folded below it all columns with their meaning."""
    columns = [(c.name, _text(getattr(record, c.name)), str(c.metadata["doc"])) for c in COLUMNS]
    table = _show_table(("column", "value", "meaning"), columns)
    return f"{show_run(record)}<details><summary>all {len(columns)} columns</summary>{table}</details>"


def show_results(folder: str, records: Sequence[RunRecord], unreadable: Mapping[str, str]) -> str:
    """Return a results folder as HTML: runs by status, a row for each of the first ``FEW``, and unreadable files.

    ``unreadable`` maps the name of each file that could not be read to the reason.
    """
    counted = Counter(r.status for r in records)
    words = ", ".join(f"{n} {status}" for status, n in counted.most_common())
    title = f"{folder}: {_count(len(records), 'run')}{f' ({words})' if words else ''}"
    rows = [
        (
            r.case,
            describe_status(r),
            _number(r.energy_drift_max_J, "J"),
            describe_errors(r),
            _number(r.cpu_median_s, "s"),
        )
        for r in records[:FEW]
    ]
    table = _show_table(("run", "status", "energy drift", "error", "CPU time"), rows, title)
    if len(records) > FEW:
        table += f"<p>and {len(records) - FEW} more, which <code>.table()</code> has</p>"
    return table + (_show_rows("unreadable", unreadable) if unreadable else "")


def _show_rows(title: str, rows: Mapping[str, str]) -> str:
    """Return an HTML table of two columns, names and values; rows with an empty value are left out."""
    named = ((name, value) for name, value in rows.items() if value)
    cells = "".join(f"<tr><th{LEFT}>{_escape(name)}</th><td{LEFT}>{_escape(value)}</td></tr>" for name, value in named)
    return f"<table>{_show_title(title)}{cells}</table>"


def _show_table(head: Iterable[str], rows: Iterable[Iterable[str]], title: str = "") -> str:
    """Return an HTML table with column heads."""
    named = "".join(f"<th{LEFT}>{_escape(name)}</th>" for name in head)
    lines = "".join(f"<tr>{''.join(f'<td{LEFT}>{_escape(x)}</td>' for x in row)}</tr>" for row in rows)
    return f"<table>{_show_title(title)}<thead><tr>{named}</tr></thead><tbody>{lines}</tbody></table>"


def _show_title(title: str) -> str:
    """Return the caption element of an HTML table; empty without a title."""
    return f"<caption{LEFT}>{_escape(title)}</caption>" if title else ""


def _escape(text: str) -> str:
    """Return text with markup escaped: names and messages come from plug-ins and from files of others."""
    return escape(escape_text(text))


def _text(value: object) -> str:
    """Format the value of a record's column: a float with six digits, anything else as it is."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _number(value: float, unit: str) -> str:
    """Format a number with its unit; empty for NaN."""
    return "" if math.isnan(value) else f"{value:.3g} {unit}"


def _count(n: int, one: str, several: str = "") -> str:
    """Format a count with its noun, whose plural is ``several``, or ``one`` with an s."""
    return f"{n} {one if n == 1 else several or f'{one}s'}"


# here and not in the classes: a problem's file is part of the digest of every run, and both lie below this module
Problem._repr_html_ = show_problem  # type: ignore[attr-defined]
RunRecord._repr_html_ = show_record  # type: ignore[attr-defined]
