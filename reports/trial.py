"""Write the page of ``mbsbench try``: one file with all findings and the charts behind them."""

import base64
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..harness.base.confined_paths import ConfinedPath
from ..harness.results.findings import Finding
from ..harness.results.judgements.runs import Order
from .model.frontier import find_frontiers, select_at_shared_target
from .model.results import StoredResults, format_stamp, group_by, read_results
from .model.tracking import list_tracking_times
from .pages.judged.orders import find_fit_ends, plot_ladders, put_triangles, sort_by_case
from .pages.runs.solvers import describe_solver
from .plots.laws import draw_runs, plot_laws
from .plots.paper import draw_plots, save_figure
from .plots.spec import LineStyle, Plot, Trace, choose_styles
from .plots.work import make_work_plots
from .rendering import write_file

ORDERS = (
    "observed order: error against step with the fitted line; dashed, the declared order; a triangle has the whole "
    "order that is within 0.2 of the fit."
)
QUANTITIES = ("position", "orientation", "energy", "reaction")


def write_page(
    path: Path, folder: Path, solver: str, summary: str, findings: Sequence[Finding], orders: Sequence[Order]
) -> None:
    """Write the page on a solver's trial: certificate card, findings, orders, energy over the long run, work.

    ``folder`` holds the results of its runs; ``summary`` states how many of the findings are met.
    """
    results = read_results(folder, check_series=False)
    follow = [f for variant in results.variants for f in list_tracking_times(variant)]
    card = describe_solver(solver, orders, (), follow, select_at_shared_target(find_frontiers(results)))
    write_file(
        path,
        "trial.html",
        title=solver,
        summary=summary,
        findings=findings,
        card=card,
        charts=list(_draw_charts(results, orders)),
        stamp=format_stamp(results),
    )


def _draw_charts(results: StoredResults, orders: Sequence[Order]) -> Iterator[dict[str, str]]:
    """Yield the charts of the page: ladders of steps by problem, the laws over the long run, work against error."""
    chart = partial(draw_chart, looks=choose_styles(results.solvers))
    for title, ladder in group_by(orders, lambda o: o.variant).items():
        if plots := _plot_orders(ladder):
            yield chart(f"{title}: {ORDERS}", plots)
    for run in (r for r in results.runs if r.record.label == "long"):
        if found := plot_laws(draw_runs(results, [run], [run])):
            yield chart(f"Over {run.record.t_reached_s:g} s of {run.variant}.", found.plots)
    for variant in results.variants:
        if (runs := variant.labels().get("ladder", ())) and (plots := make_work_plots(replace(variant, runs=runs))):
            yield chart(f"{variant.title}: work against error. Lower and further left is better.", plots)


def _plot_orders(orders: Sequence[Order]) -> list[Plot]:
    """Plot the ladders of ``QUANTITIES``, each with a line of the declared order through the finest end of its fit."""
    plots = []
    for o in sort_by_case([o for o in orders if o.quantity in QUANTITIES]):
        for plot in plot_ladders([o]):
            declared = []
            if (fit := find_fit_ends(o)) and math.isfinite(o.declared):
                x, y = fit
                line = y[0] * (x / x[0]) ** o.declared
                declared.append(Trace(f"declared: order {o.declared:g}", x, line, dash=1))
            whole = replace(plot, title=o.quantity, traces=(*plot.traces, *declared))
            plots.append(put_triangles(whole, [o]))  # the triangle avoids the declared line, too
    return plots


def draw_chart(caption: str, plots: Sequence[Plot], looks: Mapping[str, LineStyle], columns: int = 2) -> dict[str, str]:
    """Draw plots as one image; return its ``caption``, and the ``image`` as a data URL."""
    with tempfile.TemporaryDirectory() as place:
        draw = partial(draw_plots, plots, looks, columns=columns)
        (file,) = save_figure(draw, ConfinedPath(Path(place)), "chart", ("svg",))
        image = "data:image/svg+xml;base64," + base64.b64encode(file.read_bytes()).decode()
        return {"caption": caption, "image": image}
