"""The report of results: a site in one folder that opens from disk, and its tables for papers."""

from pathlib import Path

from ..harness.places import Place
from .model.results import Results, read_results
from .model.tables import write_tables
from .pages.base import ASSETS, WRITTEN, Site, copy_assets, write_pages

OURS = ("assets", "runs", "data", "tables", "badges")  # folders that a new report replaces
KEPT = ("figures",)  # it may hold others' work


def build(results_folder: Path) -> Path:
    """Write ``report/`` in the results folder; returns the path of its first page."""
    results = read_results(Path(results_folder))
    return write_site(results, Place(Path(results_folder)) / "report")


def write_site(results: Results, folder: Place) -> Path:
    """All pages of the results into ``folder``; returns the path of the first."""
    _clear(folder)
    copy_assets(folder, sorted(path.name for path in ASSETS.iterdir()))
    site = Site(results, folder)
    write_pages(site)
    site.finish()
    write_tables(results.variants, folder / "tables")
    site.data(WRITTEN, len(results.runs))  # the last: an open page of an earlier report looks for it
    return folder.path / "index.html"


def _clear(folder: Place) -> None:
    """Remove what an earlier report left: pages of runs that no longer exist."""
    pages = [name for name in folder.names() if name.endswith(".html")]
    for name in (*OURS, *KEPT, *pages):
        (folder / name).is_there()  # NotOwn before anything is removed
    for name in OURS:
        (folder / name).remove_folder()
    for name in pages:
        (folder / name).remove_file()
