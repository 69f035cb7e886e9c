"""Build the report of results: a site in one folder that opens from disk, and its tables for papers."""

from collections.abc import Callable
from pathlib import Path

from ..harness.base.confined_paths import ConfinedPath
from .model.results import StoredResults, read_results
from .model.tables import write_tables
from .pages.base import ASSETS, WRITTEN, Site, copy_assets, write_pages

OURS = ("assets", "runs", "data", "tables", "badges")  # folders that a new report replaces
KEPT = ("figures",)  # may hold files of other commands


def build_report(results_folder: Path) -> Path:
    """Write ``report/`` in the results folder; return the path of its first page."""
    results = read_results(Path(results_folder))
    return write_site(results, ConfinedPath(Path(results_folder)) / "report")


def write_site(
    results: StoredResults, folder: ConfinedPath, await_judgement: Callable[[], None] = lambda: None
) -> Path:
    """Write all pages and tables of the results into ``folder``, in place of an earlier report; return the first page.

    ``await_judgement`` is called before the judgement is read; it returns when another process has written it.
    """
    _clear_folder(folder)
    copy_assets(folder, sorted(path.name for path in ASSETS.iterdir()))
    site = Site(results, folder)
    write_pages(site, await_judgement)
    site.finish()
    write_tables(results.variants, folder / "tables")
    site.write_data(WRITTEN, len(results.runs))  # written last: an open page of an earlier report waits for it
    return folder.path / "index.html"


def _clear_folder(folder: ConfinedPath) -> None:
    """Remove the files of an earlier report, such as pages of runs that no longer exist.

    Raise UnsafeFile, before anything is removed, if a folder or page is a link to elsewhere.
    """
    pages = [name for name in folder.names() if name.endswith(".html")]
    for name in (*OURS, *KEPT, *pages):
        (folder / name).is_there()  # raises UnsafeFile before anything is removed
    for name in OURS:
        (folder / name).remove_folder()
    for name in pages:
        (folder / name).remove_file()
