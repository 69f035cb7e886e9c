"""From the digests in judgement files to runs of this run: their words, their solver, their page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..model.results import Run


@dataclass(frozen=True)
class Links:
    """Runs by what judgements call them: the digest of their settings, or their own."""

    runs: Mapping[str, Run]

    def run(self, key: str) -> Run | None:
        return self.runs.get(key)

    def words(self, key: str) -> str:
        """The settings in words; a run that is not here keeps the head of its digest."""
        run = self.runs.get(key)
        return run.record.case if run else f"{key[:12]} (not in this run)"

    def solver(self, key: str) -> str:
        run = self.runs.get(key)
        return run.record.solver if run else ""

    def page(self, key: str) -> str:
        """The address of its page, as seen from a page of the report; empty for a run that is not here."""
        run = self.runs.get(key)
        return page_of(run) if run else ""


def links_of(runs: Sequence[Run]) -> Links:
    """Of a run."""
    return Links({**{c.record.run_id: c for c in runs}, **{c.record.settings_id: c for c in runs}})


def page_of(run: Run) -> str:
    """The address of a run's page."""
    return f"runs/{run.record.run_id}.html"
