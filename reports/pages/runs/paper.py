"""Show the paper's figures drawn from these results with the claims on them, if ``figures --paper`` drew them."""

from pathlib import Path

from ....harness.base.confined_paths import ConfinedPath
from ....harness.base.files import LARGEST
from ...model.results import StoredResults
from ...paper import captions
from ..base import Page, Site
from ..judged.claims import VERDICTS

SUFFIXES = (".svg", ".pdf")


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``paper.html`` to the site and return the page; None if no figure was drawn."""
    made = [(c, _copy_figure(results, site, c.name)) for c in captions.read_captions(results.folder)]
    figures = [(c, files) for c, files in made if ".svg" in files]
    if not figures:
        return None
    page = Page("The paper's figures", "paper.html", about="claims")
    runs = {r.record.run_id: r for r in results.runs}
    return site.write(page, "paper.html", figures=figures, runs=runs, verdicts=VERDICTS)


def _copy_figure(results: StoredResults, site: Site, figure: str) -> dict[str, str]:
    """Copy the files of a figure into the report folder; return their paths from the page, by suffix."""
    name, out = Path(figure).name, {}  # only the name: a path could lead out of the folder
    for suffix in SUFFIXES:
        source = ConfinedPath(results.folder) / captions.FOLDER / f"{name}{suffix}"
        if source.is_own_file():
            (site.folder / "figures" / f"paper-{name}{suffix}").write(source.read(LARGEST), durable=False)
            out[suffix] = f"figures/paper-{name}{suffix}"
    return out
