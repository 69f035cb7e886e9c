"""Slope triangles: of orders that the data show, with that slope, clear of everything drawn, legible in grey."""

import itertools
import json
import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.patches import Polygon
from matplotlib.text import Annotation
from msgspec.structs import replace

from mbsbench.reports import publication
from mbsbench.reports.model.results import read_results
from mbsbench.reports.pages.judged.orders import plot_ladders
from mbsbench.reports.plots import paper
from mbsbench.reports.plots.browser import shorten_plots
from mbsbench.reports.plots.convergence import make_convergence_plots
from mbsbench.reports.plots.slopes import add_triangles, find_order
from mbsbench.reports.plots.spec import Axis, LineStyle, Plot, Trace, choose_styles
from mbsbench.reports.trial import QUANTITIES, _plot_orders
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.factories import make_measured_record

from .conftest import put
from .pages import synthetic

STEPS = 0.1 / 2.0 ** np.arange(6)
LOOK = LineStyle("#3D62C7", "o")


def plot_of(*ladders: tuple[np.ndarray, np.ndarray]) -> Plot:
    traces = [Trace(f"s{k}", x, y, solver=f"s{k}", mode="lines+markers") for k, (x, y) in enumerate(ladders)]
    plot = Plot("p", "P", "", Axis("step", "s", log=True), Axis("error", "m", log=True), traces)
    return add_triangles(plot, [(find_order(t.x, t.y), t) for t in traces])


@pytest.mark.parametrize("order", range(1, 9))
def test_the_order_of_a_power_law_is_found(order):
    """Whatever its constant; its first steps may be too long and its last ones lie on a floor."""
    assert find_order(STEPS, 3.0 * STEPS**order) == order
    bent = 3.0 * STEPS**order
    bent[0], bent[-2:] = 50.0 * bent[0], bent[-3]
    assert find_order(STEPS, bent) == order


@pytest.mark.parametrize("error", [STEPS**1.5, STEPS**0.0, STEPS**-1.0, 0.0 * STEPS, STEPS**np.nan])
def test_what_is_no_whole_order_has_none(error):
    assert find_order(STEPS, error) == 0
    assert find_order(STEPS[:2], STEPS[:2] ** 2) == 0  # two runs make no order
    assert find_order(np.full(6, 0.1), STEPS) == 0  # nor does one step


def ladder(seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Up to nine ladders of several orders, with floors and noise."""
    draw = np.random.default_rng(seed)
    out = []
    for _ in range(draw.integers(1, 10)):
        x = 10.0 ** draw.uniform(-3.0, 0.0) / 2.0 ** np.arange(draw.integers(3, 9))
        y = 10.0 ** draw.uniform(-4.0, 1.0) * x ** draw.integers(1, 7) * np.exp(draw.normal(0.0, 0.05, len(x)))
        out.append((x, np.maximum(y, 10.0 ** draw.uniform(-15.0, -9.0))))
    return out


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(12))
def test_a_triangle_has_its_slope_and_covers_nothing(seed):
    """As drawn, in pixels: lines and points lie outside it and its digits, and no two triangles meet."""
    plot = plot_of(*ladder(seed))
    found = {find_order(t.x, t.y) for t in plot.traces} - {0}
    assert [t.order for t in plot.triangles] == sorted(found)
    for t in plot.triangles:
        assert math.log(t.y[1] / t.y[0]) / math.log(t.x[1] / t.x[0]) == pytest.approx(t.order)
    with paper.apply_style():
        figure = paper.draw_plots([plot], dict.fromkeys((t.solver for t in plot.traces), LOOK), columns=2, height=2.3)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        (ax,) = figure.axes
        shapes = [p for p in ax.patches if isinstance(p, Polygon)]
        digits = [t.get_window_extent(canvas.get_renderer()) for t in ax.texts if isinstance(t, Annotation)]
        lines = [ax.transData.transform(line.get_xydata()) for line in ax.lines if len(line.get_xdata()) > 1]
    assert len(shapes) == len(found) and len(digits) == 2 * len(found)
    dense = np.concatenate([np.linspace(a, b, 200) for line in lines for a, b in itertools.pairwise(line)])
    radius = 4.5 / 2.0 / 72.0 * figure.dpi  # of a marker [px]
    for shape in shapes:
        corners = shape.get_path().transformed(shape.get_transform())
        assert not corners.contains_points(dense, radius=radius).any()
        assert not corners.contains_points(dense, radius=-radius).any()
        assert ax.bbox.contains(*corners.get_extents().min) and ax.bbox.contains(*corners.get_extents().max)
    assert not any(box.contains(*at) for box in digits for at in dense[::5])
    boxes = [*digits, *(s.get_window_extent(canvas.get_renderer()) for s in shapes)]
    parts = itertools.combinations(boxes[: len(digits)], 2)
    assert not any(a.overlaps(b) for a, b in parts)
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes[len(digits) :], 2))


def test_where_data_leave_no_room_a_triangle_stands_below_them():
    """Level lines fill the panel."""
    full = [(STEPS, np.full(6, 10.0**k)) for k in np.arange(-4.0, 0.0, 0.1)]
    (triangle,) = plot_of((STEPS, STEPS**2), *full).triangles
    assert triangle.y[1] < min(y.min() for _, y in full) and triangle.order == 2


def luminance(colour: str) -> float:
    """Relative luminance (WCAG 2.2), as a print in grey shows it."""
    c = np.array(to_rgb(colour))
    return float(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722))


def test_triangles_are_legible_in_grey():
    """Edges at 3:1 at least, digits at 7:1, on white and on the triangle's own shade (WCAG 1.4.11, 1.4.6)."""
    with paper.apply_style():
        (ax,) = paper.draw_plots([plot_of((STEPS, STEPS**2))], {"s0": LOOK}).axes
    (shape,), digits = [p for p in ax.patches if isinstance(p, Polygon)], ax.texts
    for ground in (paper.PAPER, shape.get_facecolor()):
        assert (luminance(ground) + 0.05) / (luminance(shape.get_edgecolor()) + 0.05) >= 3.0
        contrasts = [(luminance(ground) + 0.05) / (luminance(t.get_color()) + 0.05) for t in digits]
        assert_each(contrasts, ">=", 7.0, "contrasts of digits")
    assert sorted(t.get_text() for t in digits) == ["1", "2"] and shape.get_gid() == "order 2"


def put_ladder(folder, solver: str, order: int, runs: int = 4) -> None:
    for k in range(runs):
        h = 0.1 / 2**k
        put(
            folder,
            make_measured_record(
                f"{solver[:2]}{k:02}", solver, dt_s=h, position_error_max_m=h**order, energy_drift_max_J=h
            ),
        )


def test_figures_have_error_against_step_with_a_triangle_for_each_order(tmp_path):
    """Position: 2 and 4 as made; energy: 1. Work against error has none: its axis is no step."""
    put_ladder(tmp_path, "alpha", 2)
    put_ladder(tmp_path, "beta", 4)
    results = read_results(tmp_path)
    made = {name: (caption, draw) for name, caption, _, draw in publication.list_figures(results, results.variants[0])}
    caption, draw = made["pendulum-convergence"]
    assert publication.TRIANGLES in caption
    with paper.apply_style():
        figure, work = draw(), made["pendulum-work"][1]()
    assert [[p.get_gid() for p in ax.patches] for ax in figure.axes] == [["order 2", "order 4"], ["order 1"]]
    assert [ax.get_xlabel() for ax in figure.axes] == ["step, or mean step under error control [s]"] * 2
    assert not any(ax.patches for ax in work.axes)


def test_two_runs_are_no_convergence(tmp_path):
    put_ladder(tmp_path, "alpha", 2, runs=2)
    (variant,) = read_results(tmp_path).variants
    assert make_convergence_plots(variant) == []


def test_a_step_under_error_control_is_the_mean_of_those_taken(tmp_path):
    nan = float("nan")
    for k in range(3):
        put(
            tmp_path,
            make_measured_record(
                f"aa{k:02}",
                control="rtol",
                dt_s=nan,
                rtol=10.0**-k,
                steps=10 * 2**k,
                position_error_max_m=0.2 / 32.0**k,
            ),
        )
    (variant,) = read_results(tmp_path).variants
    plot = make_convergence_plots(variant)[0]
    assert plot.traces[0].x == pytest.approx(2.0 / np.array([10, 20, 40]))
    assert [t.order for t in plot.triangles] == [5]


def test_ladders_of_pages_and_certificates_have_triangles():
    """A fit of a whole order has one, any other none; on the certificate it is clear of the declared line, too."""
    dt = tuple(STEPS)
    made = replace(
        synthetic.ORDER,
        dt=dt,
        error=tuple(STEPS**2),
        used=(True,) * 6,
        fit="power",
        order=2.0,
        low=1.9,
        high=2.1,
        declared=2.0,
        verdict="certified",
    )
    (plot,) = plot_ladders([made])
    assert [t.order for t in plot.triangles] == [2]
    (shown,) = shorten_plots([plot], choose_styles(["alpha"]))["plots"].values()
    assert json.loads(json.dumps(shown["triangles"]))[0]["order"] == 2
    assert plot_ladders([replace(made, error=tuple(STEPS**1.5), order=1.5)])[0].triangles == ()
    (certificate,) = _plot_orders([replace(made, quantity=QUANTITIES[0])])
    assert [t.order for t in certificate.triangles] == [2] and len(certificate.traces) > len(plot.traces)
