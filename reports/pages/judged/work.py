"""The page of work against precision, with the profile over all targets, and that one's static twin for papers."""

import math
from functools import partial

from ....harness.results.judgements.files import WORK
from ...model.results import Results
from ...plots.printed import figure
from ...plots.spec import Plot
from ...plots.style import save
from ...plots.work import ERRORS, WORKS, Profile, named, profile_plot, work_plots
from ..base import Page, Site
from ..judgement import judged, links_of
from .work_points import Field, fields, profiles

FEW = ("index1", "evaluations", "cpu")  # works that energy and joints are drawn over, and profiles for papers


def write(results: Results, site: Site) -> Page | None:
    """``work.html``, and ``figures/work-profile-*.svg`` and ``.pdf``; those of a problem are in ``publication/``."""
    links = links_of(results.runs)
    work = judged(results.folder, WORK)
    profile = profiles(work.found.profile if work.found else ())
    default = profiles(work.found.profile_default if work.found else (), tuned=False)
    found = [(f, plots_of(f)) for f in fields(results, work.found.points if work.found else (), links)]
    works = list(dict.fromkeys(p.work for p in profile))
    kinds = [(w, *WORKS[w]) for w in WORKS if any(key.endswith(f"-{w}") for _, own in found for key in own)]
    profile_plots = [profile_plot((*profile, *default), w) for w in works]
    drawn = [_print(site, f"work-profile-{w}", [profile_plot(profile, w)], 3.2) for w in works if w in FEW]
    return site.write(
        Page("Work", "work.html", nav=True, order=25), "work.html", scripts=["assets/judgement.js"],
        plots=[*profile_plots, *(p for _, own in found for p in own.values())], why=work.why,
        errors=[(k, *e) for k, e in ERRORS.items()], works=kinds, fields=found, profiles=(*profile, *default),
        profile_plots=profile_plots, named=named, work_at=work_at,
        profile_figures=[name for names in drawn for name in names],
    )  # fmt: skip


def plots_of(f: Field) -> dict[str, Plot]:
    """By ``<error>-<work>``; energy and joints over fewer works, and of default and best settings alone."""
    errors = work_plots(f.slug, f.points, [("error", work) for work in WORKS], folded=True)
    laws = [(error, work) for error in ("energy", "phi") for work in WORKS if work in FEW]
    return errors | work_plots(f.slug, [p for p in f.points if p.default or p.best], laws, folded=True)


def work_at(p: Profile, share: float) -> float:
    """The work at which a share of all targets is reached; NaN if it never is."""
    needed = math.ceil(share * p.total)
    return p.at[needed - 1] if 0 < needed <= len(p.at) else math.nan


def _print(site: Site, name: str, plots: list[Plot], height: float = 2.3) -> list[str]:
    """Write a figure as SVG and PDF; the names of the files."""
    if not plots:
        return []
    draw = partial(figure, plots, site.looks, height=height)
    return [p.name for p in save(draw, site.figures, name, ("svg", "pdf"))]
