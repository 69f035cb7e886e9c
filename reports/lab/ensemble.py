"""Write the page of ``mbsbench ensemble``: scores, clouds over time, members at score times and rank histograms."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...harness.lab.ensemble.clouds import Cloud, Ensemble
from ...harness.lab.ensemble.verdict import CloudComparison
from ...harness.results import environment
from ..model.words import number
from ..plots.spec import Axis, Plot, Trace, choose_styles
from ..rendering import write_file
from ..trial import draw_chart

TRUE = "truth"
SHARES = ((0.05, 0.95), (0.25, 0.75))  # quantiles of the bands, one over the other
DOTS = 250  # members drawn in one scatter panel
DRAWN = 2  # observables drawn


def write_page(
    path: Path,
    title: str,
    e: Ensemble,
    true: tuple[Cloud, Cloud],
    scored: Sequence[tuple[Cloud, Sequence[CloudComparison], str]],
    perfect: Sequence[CloudComparison],
) -> None:
    """Write the page on an ensemble to ``path``: the table of scores, and for each solver its clouds and histograms.

    ``true`` holds the reference clouds from the same starts and from other starts. ``scored`` has the cloud of each
    solver, its comparisons with the true one at each time and quantity, and the verdict on them in words; ``perfect``
    are the comparisons of one reference cloud with the other: the scores of a solver without errors.
    """
    spread = np.nan_to_num(np.nanstd(true[1].values[:, :, -1], axis=0))
    moving = [i for i in range(len(e.observables)) if spread[i] > 1e-9 * (1.0 + spread.max())][:DRAWN]
    own = choose_styles(cloud.code.name for cloud, _, _ in scored)
    charts = [
        draw_chart(caption, plots, own)
        for cloud, found, _ in scored
        for caption, plots in _plot_solver(e, true[1], cloud, found, moving)
    ]
    rows = sorted([*perfect, *(c for _, found, _ in scored for c in found)], key=lambda c: (c.t_s, c.quantity))
    stamp = f"Commit {environment.read_commit()[:12] or 'not recorded'}."
    write_file(path, "ensemble.html", title=title, scored=scored, rows=rows, charts=charts, number=number, stamp=stamp)


def _plot_solver(
    e: Ensemble, true: Cloud, own: Cloud, found: Sequence[CloudComparison], moving: Sequence[int]
) -> Iterator[tuple[str, list[Plot]]]:
    """Yield caption and panels of the charts of one solver: its cloud with the true one, and rank histograms if any.

    ``moving`` are the indices of the observables to draw; histograms are those of the ``DRAWN`` quantities that are
    least likely to come from a perfect solver.
    """
    clouds = [_plot_bands(e, true, own, i) for i in moving] + (
        [_plot_members(e, true, own, moving, k) for k in range(len(e.at))] if len(moving) > 1 else []
    )
    yield f"{own.label}: bands of 50 and 90 % of the members with their median, and members; truth is black.", clouds
    ranked = sorted((c for c in found if c.ranks), key=lambda c: c.ranks.p if c.ranks else 1.0)
    least_likely = list(dict.fromkeys(c.quantity for c in ranked))[:DRAWN]
    histograms = [_plot_ranks(own.label, c) for c in found if c.ranks and c.quantity in least_likely]
    if histograms:
        words = "ranks of true draws, of what differs most; between the black lines 95 % of a perfect solver's bars."
        yield f"{own.label}: {words}", histograms


def _plot_bands(e: Ensemble, true: Cloud, own: Cloud, i: int) -> Plot:
    """Plot observable ``i`` over time: bands of both clouds with medians, marked at all score times but the last."""
    o, traces = e.observables[i], list[Trace]()
    for cloud, solver in ((true, ""), (own, own.code.name)):
        drawn = cloud.drawn[:, i]
        drawn = drawn[np.isfinite(drawn).all(axis=1)]
        if len(drawn):
            median = np.median(drawn, axis=0)
            for share in SHARES:
                low, high = np.quantile(drawn, share, axis=0)
                traces.append(Trace(own.label if solver else TRUE, e.times, median, solver, low=low, high=high))
    marks = {"scores": e.at[:-1]}
    return Plot(f"fan-{i}", o.name, "", Axis("t", "s", symbol="t"), _axis(e, i), traces, marks=marks)


def _plot_members(e: Ensemble, true: Cloud, own: Cloud, moving: Sequence[int], k: int) -> Plot:
    """Plot the members of both clouds at score time ``k`` in the plane of the first two observables that spread."""
    a, b = moving[:2]
    traces = [
        Trace(name, cloud.values[:DOTS, a, k], cloud.values[:DOTS, b, k], solver, mode="markers")
        for cloud, name, solver in ((true, TRUE, ""), (own, own.label, own.code.name))
    ]
    x, y = (replace(_axis(e, i), link=f"{e.at[k]:g}") for i in (a, b))  # panels of two times share no range
    return Plot(f"dots-{k}", f"members at {e.at[k]:g} s", "", x, y, traces)


def _plot_ranks(label: str, c: CloudComparison) -> Plot:
    """Plot the rank histogram of one comparison, with lines that enclose 95 % of a perfect solver's bars."""
    assert c.ranks is not None
    counts = c.ranks.counts
    bins, drawn = len(counts), float(np.sum(counts))
    edges = np.repeat(np.linspace(0.0, 1.0, bins + 1), 2)[1:-1]
    level = drawn / bins  # expected count of each bin
    # 1.96 standard deviations of a Dirichlet-multinomial count: all draws are ranked in the same members
    wide = 1.96 * np.sqrt(level * (1.0 - 1.0 / bins) * (c.members + drawn + 1.0) / (c.members + 2.0))
    bars = np.repeat(counts, 2)
    ends = np.array([0.0, 1.0])
    traces = [
        Trace(label, edges, bars, c.solver, low=np.zeros_like(bars), high=bars, marked=False),
        *(Trace("95 % of a perfect solver's bars", ends, np.full(2, level + d)) for d in (-wide, wide)),
    ]
    title = f"{c.quantity} at {c.t_s:g} s, p = {number(c.ranks.p, 2)}"
    return Plot(f"ranks-{c.quantity}-{c.t_s:g}", title, "", Axis("rank"), Axis("draws", low=0.0), traces)


def _axis(e: Ensemble, i: int) -> Axis:
    """Return the axis of observable ``i``."""
    o = e.observables[i]
    return Axis(o.name, o.unit, symbol=o.symbol)
