"""Judgements as pages see them: of these results, else as published, or why there is none; and the runs behind them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from ...harness.files import FileError
from ...harness.places import Place
from ...harness.results.judgements.files import FOLDER, PUBLISHED, File, read_judgement
from ..model.results import Run

JUDGE = "mbsbench judge"
T = TypeVar("T")


@dataclass(frozen=True)
class Judged(Generic[T]):
    """The content of one file, or why there is none; ``published``: why it is that of other results."""

    found: T | None = None
    why: str = ""
    published: str = ""


def read_judged_or_published(results: Path, file: File[T], published: Place = PUBLISHED) -> Judged[T]:
    """The same; where these results have no judgement, or allow none, that of the published ones."""
    own = read_judged(results, file)
    broken = own.found is None and (Place(results) / FOLDER / f"{file.name}.json").is_there()
    if own.found or broken:
        return own
    kept = read_or_why(published, file, f"{JUDGE} --publish")
    why = own.why or "These results hold no runs to judge it from."
    return Judged(kept.found, published=why) if kept.found else own


def read_judged(results: Path, file: File[T]) -> Judged[T]:
    """``judgement/<name>.json`` of a results folder."""
    return read_or_why(Place(results) / FOLDER, file, f"{JUDGE} {results.name}")


def read_or_why(folder: Place, file: File[T], command: str) -> Judged[T]:
    """The judgement in ``folder``; ``command`` makes it."""
    try:
        return Judged(read_judgement(file, folder))
    except FileNotFoundError:
        return Judged(why=f"There is no {folder.name}/{file.name}.json yet. To make it: {command}")
    except FileError as error:
        return Judged(why=f"{error}. To make it anew: {command}")


@dataclass(frozen=True)
class Links:
    """Runs by their settings_id."""

    runs: Mapping[str, Run]

    def words(self, key: str) -> str:
        """The settings in words; a run that is not here keeps the head of its settings_id."""
        run = self.runs.get(key)
        return run.record.case if run else f"{key[:12]} (not in these results)"

    def page(self, key: str) -> str:
        """The address of its page, as seen from a page of the report; empty for a run that is not here."""
        run = self.runs.get(key)
        return page_of(run) if run else ""


def links_of(runs: Sequence[Run]) -> Links:
    """Links to the runs of these results."""
    return Links({c.record.settings_id: c for c in runs})


def page_of(run: Run) -> str:
    """The address of a run's page."""
    return f"runs/{run.record.run_id}.html"
