"""Columns of an integration back to the start (``retrace``): the difference from the start, worst body."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...mechanics import so3
from ...mechanics.state import State
from ..declaring import column
from ..measured import MeasuredMotion

NOT_KEPT = "not kept"  # the states of the way back, in a bundle


def where_returned(number: Callable[[State, State], float]) -> Callable[[MeasuredMotion], float | None]:
    """Return the function of a column: ``number`` of the state after integrating back, and of the start.

    None for a motion that was not integrated back.
    """

    def find(run: MeasuredMotion) -> float | None:
        """Return the number; None if the motion was not integrated back."""
        back = run.trajectory.returned
        return None if back is None else number(back, run.problem.initial)

    return find


@dataclass(frozen=True, repr=False)
class WayBackColumns:
    """The distance of a run from its start after it was integrated back to it."""

    return_error_m: float = column(
        "distance of C from its start after integrating back; NaN if that failed, see notes",
        of=where_returned(lambda back, start: float(np.max(np.linalg.norm(back.r - start.r, axis=1)))),
        unchecked=NOT_KEPT,
    )
    return_error_rad: float = column(
        "angle of R to its start",
        of=where_returned(lambda back, start: float(np.max(so3.angle_between(back.R, start.R)))),
        unchecked=NOT_KEPT,
    )
    return_error_m_per_s: float = column(
        "difference of v, turned again, to its start",
        of=where_returned(lambda back, start: float(np.max(np.linalg.norm(back.v - start.v, axis=1)))),
        unchecked=NOT_KEPT,
    )
    return_error_rad_per_s: float = column(
        "difference of Omega, turned again, to its start",
        of=where_returned(lambda back, start: float(np.max(np.linalg.norm(back.Omega - start.Omega, axis=1)))),
        unchecked=NOT_KEPT,
    )
