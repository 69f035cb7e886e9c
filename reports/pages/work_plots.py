"""The plots of the work page: a plot for each pair of work and error of a variant."""

from ..plots.spec import Plot
from ..plots.work import WORKS, work_plots
from .work_points import Field

BESIDE = ("operations", "evaluations", "cpu")  # works that energy and joints are drawn over


def plots_of(f: Field) -> dict[str, Plot]:
    """By ``<error>-<work>``; energy and joints over fewer works, and of default and best settings alone."""
    errors = work_plots(f.slug, f.points, [("error", work) for work in WORKS], folded=True)
    laws = [(error, work) for error in ("energy", "phi") for work in WORKS if work in BESIDE]
    return errors | work_plots(f.slug, [p for p in f.points if p.default or p.best], laws, folded=True)
