"""Which series of a suite's runs keep every step: those that judgements read, and those that figures magnify."""

from collections.abc import Callable

from ..harness.referee.claims.maps import own_duration
from ..harness.referee.claims.register import read_register
from ..harness.referee.judge import list_tried
from ..harness.referee.reading import series_judged
from ..harness.suites.spec import RunSpec
from ..harness.suites.suite import Suite
from ..reports.paper.lines import Asked, series_magnified


def series_to_keep(suite: Suite) -> Callable[[RunSpec], tuple[str, ...]]:
    """Return a function of a run: the names, or patterns, of its series of which nothing may be left out."""
    judged, magnified = series_judged(read_register(), list_tried()), series_magnified(suite.specs, _duration)
    return lambda spec: tuple(sorted(judged(spec) | magnified.get(spec.settings_id, set())))


def _duration(asked: Asked) -> float:
    return float(asked.parameters.get("t_end") or own_duration(asked.problem))
