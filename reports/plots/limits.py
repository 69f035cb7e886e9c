"""Limits of laws as lines in plots over time: only where what is drawn is what was judged."""

from collections.abc import Sequence

import numpy as np

from ...harness.catalogue import registry
from ...harness.files import FileError, parse_json
from ...harness.metrics.mechanisms import mechanisms
from ...harness.metrics.scales import stretched
from ...harness.results.records import BadRecord, RunRecord, is_literal
from ...harness.types import ALLOWED, Law, Problem, Status
from ..model.results import Run
from ..model.words import number
from .spec import Trace

UNITS = {Law.ENERGY: "J", Law.CONSTRAINT: "m", Law.CONSTRAINT_RATE: "m/s"}
ALIKE = 0.01  # limits of runs that differ by less are one line
JUDGED = (Status.SUCCESS, Status.INACCURATE, Status.WRONG)


def limit(runs: Sequence[Run], law: Law, end: float) -> list[Trace]:
    """The line from 0 to ``end`` that the errors of ``runs`` must not cross; none where what is judged is not drawn.

    Each run is judged by its own size: where these differ it is the least, and says so.
    """
    judged = [r.record for r in runs if r.status in JUDGED]
    problem = problem_of(judged[0]) if judged else None
    sizes = [s for r in judged if (s := _size(r, law, problem)) > 0.0]
    if not sizes:
        return []
    at, alike = ALLOWED[law] * min(sizes), max(sizes) <= (1.0 + ALIKE) * min(sizes)
    words = f"limit {number(at)} {UNITS[law]}" if alike else f"least limit {number(at)} {UNITS[law]}, each run its own"
    return [Trace(words, np.array([0.0, end]), np.full(2, at), dash=1, reach=(at, at))]


def problem_of(record: RunRecord) -> Problem | None:
    """As the catalogue has it; None for another's, or one that it no longer makes."""
    if not registry.is_own_problem(record.problem):
        return None
    try:
        given = parse_json(record.problem_parameters, "parameters", BadRecord)
        return registry.make_problem(record.problem, given)
    except (ValueError, FileError):
        return None


def _size(r: RunRecord, law: Law, problem: Problem | None) -> float:
    """What the judged error is compared with; 0 where that is not what is drawn.

    Mechanisms beside each other have limits of their own. Axis rows are judged by what they move, and drawn without
    a unit. The reach of a motion that goes on beyond its reference is not recorded.
    """
    several = problem is not None and len(mechanisms(problem.system)) > 1
    if law is Law.ENERGY:
        return 0.0 if several else r.energy_scale_J
    if problem is None or several or is_literal(r) or np.any(problem.system.joint_axes):
        return 0.0
    if law is Law.CONSTRAINT_RATE:
        return r.speed_scale_m_per_s
    beyond = r.reference_horizon_s < r.t_end_s * (1.0 - 1e-12)
    return 0.0 if beyond else min(r.length_scale_m, stretched(problem.system))
