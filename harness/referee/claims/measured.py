"""The numbers of all claims, each run's series read once however many claims ask for it."""

import json
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from ...results.judgements.claims import Ending
from ...results.records import RunRecord
from ...results.series import Series
from .endings import by_budget, ending
from .evidence import MEASURES, evaluate, evaluate_pair
from .register import Test

SeriesOf = Callable[[RunRecord], Series | None]
Key = tuple[str, str, str]  # settings, metric, arguments
KEPT = 8  # series kept in memory for distances between runs


class Numbers:
    """Numbers by run and test, filled by ``gather``; distances of two runs are measured when asked for."""

    def __init__(self, records: Mapping[str, RunRecord], series_of: SeriesOf) -> None:
        self.records = records
        self._series_of = lru_cache(maxsize=KEPT)(lambda settings: series_of(records[settings]))
        self._found: dict[Key, float] = {}
        self._between: dict[tuple[str, ...], float] = {}
        self._ending: dict[str, Ending] = {}

    def gather(self, wanted: Iterable[tuple[str, Test]]) -> None:
        """Measure what is asked of each run, run by run."""
        by_run: dict[str, dict[Key, Test]] = {}
        for settings, test in wanted:
            if settings in self.records and not MEASURES[test.metric].of_pair:
                by_run.setdefault(settings, {})[_key(settings, test)] = test
        for settings, tests in by_run.items():
            self.ending(settings)  # while the series that it may need is at hand
            series = self._series_of(settings) if any(MEASURES[t.metric].needs_series for t in tests.values()) else None
            for key, test in tests.items():
                self._found[key] = evaluate(test.metric, self.records[settings], series, test.arguments)

    def of(self, settings: str, test: Test) -> float:
        """The number of one run."""
        key = _key(settings, test)
        if key not in self._found:
            self.gather([(settings, test)])
        return self._found[key]

    def between(self, one: str, other: str, test: Test) -> float:
        """The number of two runs."""
        key = (*_key(one, test), other)
        if key not in self._between:
            runs = [(self.records[s], self._series_of(s)) for s in (one, other)]
            self._between[key] = evaluate_pair(test.metric, runs[0], runs[1], test.arguments)
        return self._between[key]

    def ending(self, settings: str) -> Ending:
        """How a run ended."""
        if settings not in self._ending:
            record = self.records[settings]
            self._ending[settings] = ending(record, self._series_of(settings) if by_budget(record) else None)
        return self._ending[settings]


def _key(settings: str, test: Test) -> Key:
    return settings, test.metric, json.dumps(dict(test.arguments), sort_keys=True)


def shortened(value: float) -> float:
    """Six digits, the same on machines that differ in the last bits; NaN for what is not a finite number."""
    return float(f"{value:.6g}") if abs(value) < float("inf") else float("nan")
