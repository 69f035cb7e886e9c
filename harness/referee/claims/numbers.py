"""The numbers of all claims, each run's series read once however many claims ask for it."""

import json
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from ...results.judgements.claims import Ending
from ...results.records import RunRecord
from ...results.series import Series
from .endings import by_budget, classify_ending
from .evidence import MEASURES, evaluate, evaluate_pair
from .register import Test

SeriesOf = Callable[[RunRecord], Series | None]
Key = tuple[str, str, str]  # settings, metric, arguments
KEPT = 8  # series kept in memory for distances between runs


class Numbers:
    """Numbers of runs by the tests that want them, and how these runs ended; distances are measured when asked for."""

    def __init__(
        self, records: Mapping[str, RunRecord], series_of: SeriesOf, wanted: Iterable[tuple[str, Test]]
    ) -> None:
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
            reads = by_budget(record) or any(MEASURES[t.metric].needs_series for t in own.values())
            series = self._series_of(settings) if reads else None
            self.endings[settings] = classify_ending(record, series)
            self._found |= {k: evaluate(t.metric, record, series, t.arguments) for k, t in own.items()}

    def of(self, settings: str, test: Test) -> float:
        """The number of one run."""
        return self._found[_key(settings, test)]

    def of_pair(self, one: str, other: str, test: Test) -> float:
        """The number of two runs."""
        key = (*_key(one, test), other)
        if key not in self._between:
            runs = [(self.records[s], self._series_of(s)) for s in (one, other)]
            self._between[key] = evaluate_pair(test.metric, runs[0], runs[1], test.arguments)
        return self._between[key]


def _key(settings: str, test: Test) -> Key:
    return settings, test.metric, json.dumps(dict(test.arguments), sort_keys=True)


def shorten(value: float) -> float:
    """Six digits, the same on machines that differ in the last bits; NaN for what is not a finite number."""
    return float(f"{value:.6g}") if abs(value) < float("inf") else float("nan")
