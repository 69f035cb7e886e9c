"""Plot error against step for print: the ladders of every method, with slope triangles of their orders."""

from ..model.accuracy import choose_measure
from ..model.results import Variant
from .slopes import add_triangles, find_order
from .spec import Axis, Plot
from .work import ERRORS, LADDER, join_ladders, list_points

SHOWN = ("error", "energy")
STEP = Axis("step, or mean step under error control", "s", log=True)


def make_convergence_plots(variant: Variant) -> list[Plot]:
    """Return a plot against step for each error of ``SHOWN`` in which some method has enough steps for an order."""
    measure, points, out = choose_measure(variant.runs), list_points(variant), list[Plot]()
    for error in SHOWN:
        own = [p for p in points if p.is_drawable(error, "step") and p.works["step"] > 0.0]
        traces = join_ladders(own, "step", error)
        ladders = [t for t in traces if t.mode != "markers"]  # runs that stopped are drawn as markers only
        if not any(len({*t.x}) >= LADDER for t in ladders):
            continue
        what, unit = (measure.what, measure.unit) if error == "error" and measure else ERRORS[error]
        title = f"{what[0].upper()}{what[1:]} over step"
        plot = Plot(f"convergence-{error}", title, "", STEP, Axis(what, unit, log=True), traces)
        out.append(add_triangles(plot, ((find_order(t.x, t.y), t) for t in ladders)))
    return out
