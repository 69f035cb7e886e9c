"""The report of results: a site in one folder that opens from disk, and its tables for papers."""

import shutil
from pathlib import Path

from .model.results import Results, read_results
from .model.tables import write_tables
from .pages.base import FOLDER, Site, writers

OURS = ("assets", "runs", "data", "tables")  # folders that a new report replaces; figures/ may hold others' work


def build(results_folder: Path) -> Path:
    """Write ``report/`` in the results folder; returns the path of its first page."""
    results = read_results(Path(results_folder))
    return write_site(results, Path(results_folder) / "report")


def write_site(results: Results, folder: Path) -> Path:
    """All pages of the results into ``folder``; returns the path of the first."""
    _clear(folder)
    shutil.copytree(FOLDER / "assets", folder / "assets")
    (folder / "data").mkdir()
    site = Site(results, folder)
    for _, write in writers():
        write(results, site)
    site.finish()
    write_tables(results.variants, folder / "tables")
    return folder / "index.html"


def _clear(folder: Path) -> None:
    """Remove what an earlier report left: pages of runs that no longer exist."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in OURS:
        shutil.rmtree(folder / name, ignore_errors=True)
    for page in folder.glob("*.html"):
        page.unlink()
