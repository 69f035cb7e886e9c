"""The page of work against precision, with the profile over all targets, and its static twins for papers."""

import io
import math
from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG

from ..model.motion import Motion
from ..model.results import Results
from ..model.variants import broadest, themselves
from ..plots.drawing import Drawn, style
from ..plots.printed.lines import Group
from ..plots.printed.profile import profile_figure
from ..plots.printed.work import work as work_figure
from .base import Page, Site
from .judgement import judged
from .links import links_of, page_of
from .work_plots import named, plots_of, profile_plot
from .work_points import ERRORS, WORKS, Field, Profile, fields, profiles

PAPER = ("operations", "evaluations", "cpu")  # works whose profile is drawn for papers
COMPARED = 4  # solvers on a problem, for a figure of its own; of variants, plots can be saved from the page


def write(results: Results, site: Site) -> Page | None:
    """``work.html``, and ``figures/work-*.svg`` and ``.pdf``."""
    links = links_of(results.runs)
    points, profile = judged(results.folder, "work", "points"), profiles(judged(results.folder, "work", "profile").rows)
    default = profiles(judged(results.folder, "work", "profile_default").rows, tuned=False)
    found = [(f, plots_of(f)) for f in fields(results, points.rows, links)]
    works = list(dict.fromkeys(p.work for p in profile))
    kinds = [w for w in WORKS if any(key.endswith(f"-{w[0]}") for _, own in found for key in own)]
    profile_plots = [profile_plot((*profile, *default), w) for w in works]
    plain = {p.slug for p in themselves(results, broadest(results))}
    figures = {
        f.slug: files(site, d) for f, _ in found if f.slug in plain and (d := _figure(results, site, f)) is not None
    }
    drawn = [profile_figure([(p.solver, p.total, p.at) for p in profile if p.work == w], *named(w), site.looks)
             for w in works if w in PAPER]  # fmt: skip
    return site.write(
        Page("Work", "work.html", nav=True, order=25), "work.html", scripts=["assets/judgement.js"],
        plots=[*profile_plots, *(p for _, own in found for p in own.values())], why=points.why, errors=ERRORS,
        works=kinds, fields=found, profiles=(*profile, *default), profile_plots=profile_plots, named=named,
        work_at=work_at,
        figures={f.slug: figures.get(f.slug, []) for f, _ in found},
        profile_figures=[name for d in drawn for name in files(site, d)],
    )  # fmt: skip


def work_at(p: Profile, share: float) -> float:
    """The work at which a share of all targets is reached; NaN if it never is."""
    needed = math.ceil(share * p.total)
    return p.at[needed - 1] if 0 < needed <= len(p.at) else math.nan


def files(site: Site, drawn: Drawn) -> Sequence[str]:
    """Write a figure as SVG and PDF, laid out once; the names of the files."""
    site.figures.mkdir(parents=True, exist_ok=True)
    svg, pdf = io.BytesIO(), io.BytesIO()
    with style(), mpl.rc_context({"svg.hashsalt": drawn.name}):
        figure = drawn.draw()
        figure.set_dpi(72)
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": None})
        figure.set_layout_engine("none")
        FigureCanvasPdf(figure).print_pdf(pdf, metadata={"CreationDate": None, "Producer": None, "Creator": None})
    for suffix, out in (("svg", svg), ("pdf", pdf)):
        (site.figures / f"{drawn.name}.{suffix}").write_bytes(out.getvalue())
    return [f"{drawn.name}.svg", f"{drawn.name}.pdf"]


def _figure(results: Results, site: Site, f: Field) -> Drawn | None:
    """The static twin of a problem's plots, default and best settings; None where there is little to compare."""
    wanted = {p.page for p in f.points if p.default or p.best}
    runs = [c for p in results.variants if p.slug == f.slug for c in p.runs if page_of(c) in wanted]
    if len({c.record.solver for c in runs}) < COMPARED:
        return None
    return work_figure(
        f"work-{f.slug}", f"{f.variant}: work against error", Group(tuple(map(Motion, runs)), site.looks)
    )
