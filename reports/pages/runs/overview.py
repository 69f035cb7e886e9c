"""The first page: a picture of who stays within which limits, and the mechanism."""

from ...mechanism.glimpse import glimpse
from ...model.heat import heat
from ...model.margin import LEVELS
from ...model.results import Results
from ...model.scores import score, unpredictable
from ...model.variants import broadest, themselves
from ..base import Page, Site


def write(results: Results, site: Site) -> Page | None:
    """``index.html``."""
    label = broadest(results)
    main = {c.record.run_id for p in themselves(results, label) for c in p.runs}
    picture = heat(results)
    seen = picture.extremes() if picture else []
    moving = glimpse(results, [b.run for b in seen], site.looks)
    return site.write(
        Page("Overview", "index.html", nav=True, order=0), "overview.html",
        scripts=[site.bundle("glimpse", moving), "assets/glimpse.js"] if moving else [],
        heat=picture, seen=seen, moving=moving, levels=LEVELS, unpredictable=unpredictable(results), label=label,
        score=score(results.runs), problems=list(dict.fromkeys(p.problem for p in results.variants)),
        loud=sorted(results.runs, key=lambda c: (c.record.label != label, c.record.run_id not in main)),
    )  # fmt: skip
