"""A run of every ending with judgements made by hand, and its pages."""

import shutil
from pathlib import Path

import pytest

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.reports.model.results import StoredResults, read_results
from mbsbench.reports.pages.base import FOLDER, Site
from mbsbench.reports.pages.judged import claims, cost
from mbsbench.reports.pages.runs import atlas, runs, solvers

from ..conftest import every_kind, write_modules
from .synthetic import judge

PAGES = {"claims.html": claims, "cost.html": cost, "atlas.html": atlas, "solver-alpha.html": solvers}


def render(results: StoredResults, modules) -> dict[str, str]:
    """The pages of ``modules`` by file name, as they stand in the report folder."""
    folder = results.folder / "report"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(FOLDER / "assets", folder / "assets")
    (folder / "data").mkdir()
    site = Site(results, ConfinedPath(folder))
    write_modules(site, dict.fromkeys(modules))
    site.finish()
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.html"))}


@pytest.fixture(scope="session")
def judged_run(tmp_path_factory) -> StoredResults:
    folder: Path = tmp_path_factory.mktemp("judged") / "run"
    runs = [r.settings_id for r in every_kind(folder)]
    judge(folder, runs)
    return read_results(folder)


@pytest.fixture(scope="session")
def judged_pages(judged_run) -> dict[str, str]:
    return render(judged_run, [*PAGES.values(), runs])
