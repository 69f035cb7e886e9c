"""Compute the numbers of a record from series, by the functions that its columns declare."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float

from ...columns.declaring import Declaration, find_series_name, read_declaration
from ...columns.measured import MeasuredMotion, MeasuredSeries
from ...columns.numbers import find_largest
from ...columns.record import Columns
from ...mechanics.types import Problem, Trajectory

DECLARED = {c.name: read_declaration(c) for c in dataclasses.fields(Columns)}


def make_columns(problem: Problem, trajectory: Trajectory, m: MeasuredSeries) -> dict[str, Any]:
    """Return the measured columns of a ``RunRecord`` by name, from a trajectory and its series ``m``.

    Columns that do not exist for this motion are left out.
    """
    run = MeasuredMotion(problem, trajectory, m)
    with np.errstate(all="ignore"):  # a motion may have blown up: its infinities are the result
        found = {name: _measure_column(declared, run) for name, declared in DECLARED.items()}
    return {name: value for name, value in found.items() if value is not None}


def list_values_along(run: MeasuredMotion) -> Iterator[tuple[str, str, Float[np.ndarray, " nt"]]]:
    """Yield the columns that summarise a series: name of the column, name of the series, and its values (nt,)."""
    with np.errstate(all="ignore"):
        for name, declared in DECLARED.items():
            if declared.along is not None and (values := declared.along(run)) is not None:
                yield name, find_series_name(name, declared), np.asarray(values, dtype=float)


def _measure_column(declared: Declaration, run: MeasuredMotion) -> Any:
    """Return the value of a column for a measured motion; None where it does not exist or is not measured.

    A column that is declared by its values along the motion is the largest of these.
    """
    if declared.of is not None:
        return declared.of(run)
    values = None if declared.along is None else declared.along(run)
    return None if values is None else find_largest(values)
