"""The paper's figures from these results with the claims on them, where ``figures --paper`` has made them."""

from pathlib import Path

from ....harness.files import LARGEST
from ....harness.places import Place
from ...model.results import Results
from ...paper import captions
from ..base import Page, Site
from ..judged.claims import VERDICTS

SUFFIXES = (".svg", ".pdf")


def write(results: Results, site: Site) -> Page | None:
    """``paper.html``."""
    made = [(c, _files(results, site, c.name)) for c in captions.read(results.folder)]
    figures = [(c, files) for c, files in made if ".svg" in files]
    if not figures:
        return None
    page = Page("The paper's figures", "paper.html", about="claims")
    runs = {r.record.run_id: r for r in results.runs}
    return site.write(page, "paper.html", figures=figures, runs=runs, verdicts=VERDICTS)


def _files(results: Results, site: Site, figure: str) -> dict[str, str]:
    """Copies of a figure in the report folder: from their suffix to their path from the page."""
    name, out = Path(figure).name, {}  # a name, never a path out of the folder
    for suffix in SUFFIXES:
        source = Place(results.folder) / captions.FOLDER / f"{name}{suffix}"
        if source.is_own_file():
            (site.folder / "figures" / f"paper-{name}{suffix}").write(source.read(LARGEST), durable=False)
            out[suffix] = f"figures/paper-{name}{suffix}"
    return out
