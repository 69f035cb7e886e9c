"""Select the series of a suite's runs that keep every step: those that are judged, and those magnified in figures."""

from collections.abc import Callable, Mapping
from typing import Any

from ..harness.catalogue.suites.spec import RunSpec
from ..harness.catalogue.suites.suite import Suite
from ..harness.judge.referee.claims.frame import find_default_duration
from ..harness.judge.referee.judge import list_tried_runs
from ..harness.judge.referee.reading import make_series_selector
from ..harness.judge.referee.registers import PLACES
from ..reports.paper.lines import find_magnified_series


def make_series_choice(suite: Suite) -> Callable[[RunSpec], tuple[str, ...]]:
    """Return a function that gives, for a run of the suite, the names or name patterns of series to keep in full.

    These are the series by which claims are judged, and those that the paper's figures magnify.
    """
    judged = [make_series_selector(place.read(), list_tried_runs(place)) for place in PLACES]
    magnified = find_magnified_series(suite.specs, _duration)
    return lambda spec: tuple(
        sorted(magnified.get(spec.settings_id, set()).union(*(select(spec) for select in judged)))
    )


def _duration(problem: str, parameters: Mapping[str, Any]) -> float:
    """Return the simulated time of a run [s]: that of its parameters, else the problem's default."""
    return float(parameters.get("t_end") or find_default_duration(problem))
