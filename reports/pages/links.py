"""From the settings_ids in judgements to runs of these results: their words, their solver, their page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..model.results import Run


@dataclass(frozen=True)
class Links:
    """Runs by their settings_id."""

    runs: Mapping[str, Run]

    def run(self, key: str) -> Run | None:
        return self.runs.get(key)

    def words(self, key: str) -> str:
        """The settings in words; a run that is not here keeps the head of its settings_id."""
        run = self.runs.get(key)
        return run.record.case if run else f"{key[:12]} (not in these results)"

    def solver(self, key: str) -> str:
        run = self.runs.get(key)
        return run.record.solver if run else ""

    def page(self, key: str) -> str:
        """The address of its page, as seen from a page of the report; empty for a run that is not here."""
        run = self.runs.get(key)
        return page_of(run) if run else ""

    def all(self, keys: Sequence[str]) -> tuple[tuple[str, str], ...]:
        """Words and page of each."""
        return tuple((self.words(k), self.page(k)) for k in keys)


def links_of(runs: Sequence[Run]) -> Links:
    """Of the runs of these results."""
    return Links({c.record.settings_id: c for c in runs})


def page_of(run: Run) -> str:
    """The address of a run's page."""
    return f"runs/{run.record.run_id}.html"
