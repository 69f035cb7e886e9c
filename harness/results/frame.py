"""Tabulate runs with their settings as columns of their own: parameters, options and counts by name, typed."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from .records import RunRecord
from .store import table

if TYPE_CHECKING:
    import pandas as pd  # imported late, as in ``store``

UNPACKED = {  # columns that are JSON in files: what the columns made of them begin with
    "problem_parameters": "parameter",
    "solver_options": "option",
    "counters": "count",
    "observable_errors": "observable",
    "invariant_drifts": "invariant",
}


def make_frame(records: Iterable[RunRecord]) -> "pd.DataFrame":
    """Return a data frame with a row per record, in which no column holds JSON but notes and reasons.

    Beside the columns of ``RunRecord`` it has ``parameter.links``, ``option.gauge``, ``count.steps``, and the largest
    deviation of each observable and invariant, ``observable.theta``. Where a run does not have a parameter, option or
    count there is None, and the default of problem or solver holds; NaN where it does not have the deviation.
    """
    import pandas as pd

    runs = list(records)
    unpacked = [_unpack(r) for r in runs]
    names = sorted({name for row in unpacked for name in row}, key=_sort_key)
    numeric = ("observable.", "invariant.")
    columns = {
        name: pd.Series(
            [row.get(name, float("nan") if name.startswith(numeric) else None) for row in unpacked],
            dtype="float64" if name.startswith(numeric) else "object",
        )
        for name in names
    }
    return pd.concat([table(runs).drop(columns=list(UNPACKED)), pd.DataFrame(columns, index=range(len(runs)))], axis=1)


def _unpack(record: RunRecord) -> dict[str, Any]:
    """Return parameters, options, counts and largest deviations of a record by the names of their columns."""
    deviations = ({name: d.max for name, d in found.items()} for found in (record.observables, record.invariants))
    found: tuple[Mapping[str, Any], ...] = (record.parameters, record.options, record.counts, *deviations)
    return {f"{kind}.{k}": v for kind, of in zip(UNPACKED.values(), found, strict=True) for k, v in of.items()}


def _sort_key(name: str) -> tuple[int, str]:
    """Return the sort key of an unpacked column: by its kind, then by name."""
    return list(UNPACKED.values()).index(name.partition(".")[0]), name
