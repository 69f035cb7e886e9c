"""Limits of laws as lines in plots over time: only where what is drawn is what was judged."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...harness.results.records import RunRecord
from ...harness.types import ALLOWED, Law, Status
from ..model.results import Run
from ..model.words import number
from .spec import Trace

LIMITS: Mapping[Law, tuple[str, Callable[[RunRecord], float]]] = {
    Law.ENERGY: ("J", lambda r: ALLOWED[Law.ENERGY] * r.energy_scale_J),
    Law.CONSTRAINT: ("m", lambda r: r.phi_limit_m),
    Law.CONSTRAINT_RATE: ("m/s", lambda r: r.phi_dot_limit_m_per_s),
}
ALIKE = 0.01  # limits of runs that differ by less are one line
JUDGED = (Status.SUCCESS, Status.INACCURATE, Status.WRONG)


def limit(runs: Sequence[Run], law: Law, end: float) -> list[Trace]:
    """The line from 0 to ``end`` that the errors of ``runs`` must not cross; none where what is judged is not drawn.

    Each run is judged by its own size: where these differ it is the least, and says so.
    """
    unit, of = LIMITS[law]
    found = [at for r in runs if r.status in JUDGED and (at := of(r.record)) > 0.0]
    if not found:
        return []
    at, alike = min(found), max(found) <= (1.0 + ALIKE) * min(found)
    words = f"limit {number(at)} {unit}" if alike else f"least limit {number(at)} {unit}, each run its own"
    return [Trace(words, np.array([0.0, end]), np.full(2, at), dash=1, reach=(at, at))]
