"""The first page: who holds, who drifts, who breaks, and the matrix of solver against problem."""

from reports.findings import findings
from reports.overview import matrix
from reports.pages.base import Page, Site
from reports.reading import Run


def write(run: Run, site: Site) -> Page | None:
    """``index.html``."""
    page = Page("Overview", "index.html", nav=True, order=0)
    return site.write(page, "overview.html", findings=findings(run), matrix=matrix(run))
