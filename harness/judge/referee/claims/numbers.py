"""Compute the numbers of all claims, reading each run's series once for all of them."""

import json
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from ....results.judgements.claims import Ending
from ....results.records import RunRecord
from ....results.series import EnvelopedSeries, Series
from .endings import classify_ending, ended_by_budget
from .evidence import MEASURES, evaluate, evaluate_pair
from .register import Test

SeriesOf = Callable[[RunRecord], Series | None]
Key = tuple[str, str, str]  # settings, metric, arguments
KEPT = 8  # series kept in memory for distances between runs


class RunNumbers:
    """The numbers of runs by test, and how these runs ended.

    ``wanted`` are pairs of settings_id and test, measured at once; distances between runs are measured on demand.
    """

    def __init__(
        self, records: Mapping[str, RunRecord], series_of: SeriesOf, wanted: Iterable[tuple[str, Test]]
    ) -> None:
        """Measure all ``wanted`` tests of single runs, reading each run's series once."""
        self.records = records
        self.endings: dict[str, Ending] = {}
        self._series_of = lru_cache(maxsize=KEPT)(lambda settings: series_of(records[settings]))
        self._found: dict[Key, float] = {}
        self._between: dict[tuple[str, ...], float] = {}
        by_run: dict[str, dict[Key, Test]] = {}
        for settings, test in wanted:
            if settings in records:
                by_run.setdefault(settings, {})[_key(settings, test)] = test
        for settings, tests in by_run.items():
            record, own = records[settings], {k: t for k, t in tests.items() if not MEASURES[t.metric].of_pair}
            reads = ended_by_budget(record) or any(MEASURES[t.metric].needs_series for t in own.values())
            series = self._series_of(settings) if reads else None
            self.endings[settings] = classify_ending(record, series)
            self._found |= {k: _evaluate(t, record, series) for k, t in own.items()}

    def evaluate_run(self, settings: str, test: Test) -> float:
        """Return the number of a test on the run with the settings_id ``settings``; it must have been ``wanted``."""
        return self._found[_key(settings, test)]

    def of_pair(self, one: str, other: str, test: Test) -> float:
        """Return the number of a test on two runs together, such as their distance, measured when first asked for."""
        key = (*_key(one, test), other)
        if key not in self._between:
            runs = [(self.records[s], self._series_of(s)) for s in (one, other)]
            self._between[key] = evaluate_pair(test.metric, runs[0], runs[1], test.arguments)
        return self._between[key]


def _evaluate(test: Test, record: RunRecord, series: Series | None) -> float:
    """Return the number of a test on one run; an EnvelopedSeries that this raises names the test and the run."""
    try:
        return evaluate(test.metric, record, series, test.arguments)
    except EnvelopedSeries as error:
        raise EnvelopedSeries(f"{record.case}: a claim's test {test.metric!r} reads every step: {error}") from error


def _key(settings: str, test: Test) -> Key:
    """Return the key under which a run's number is kept; tests that differ in their bands alone share it."""
    return settings, test.metric, json.dumps(dict(test.arguments), sort_keys=True)


def shorten(value: float) -> float:
    """Round to six significant digits, so that machines that differ in the last bits agree; NaN if not finite."""
    return float(f"{value:.6g}") if abs(value) < float("inf") else float("nan")
