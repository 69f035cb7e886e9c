"""The share of all targets reached over work: the one picture of all problems and accuracies."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...model.results import slug
from ..drawing import Drawn, log_axis, new_figure, plain
from ..palette import Look
from .lines import Legend

Reached = tuple[str, int, Sequence[float]]  # solver, targets in all, work at each one reached


def profile_figure(found: Sequence[Reached], work: str, unit: str, looks: Mapping[str, Look]) -> Drawn:
    """One line a solver, up by one target where it is reached."""
    caption = (
        "A target is an accuracy on a problem; a line that ends low did not reach the others with any setting tried."
    )
    words = f"{work} [{unit}]" if unit else work
    name = slug(f"work-profile-{work}", set())
    return Drawn(name, f"Targets reached over {work}", caption, lambda: _draw(found, words, looks))


def _draw(found: Sequence[Reached], words: str, looks: Mapping[str, Look]) -> Figure:
    handles = []
    figure = new_figure(3.4)
    ax = figure.subplots()
    right = max((at[-1] for _, _, at in found if len(at)), default=1.0)
    log_axis(ax, "x")
    for solver, total, at in found:
        look = looks.get(solver, Look("#5b646e", "o"))
        if len(at):
            x = np.append(np.array(at), 2.0 * right)
            y = np.append(np.arange(1, len(at) + 1), len(at)) / max(total, 1)
            ax.step(x, y, where="post", color=look.colour, marker=look.marker, markevery=max(len(at) // 5, 1))
        handles.append(Line2D([], [], color=look.colour, marker=look.marker,
                              label=plain(f"{solver}: {len(at)} of {total}")))  # fmt: skip
    ax.set_ylim(0.0, 1.02)
    ax.set_xlabel(words)
    ax.set_ylabel("share of all targets reached")
    Legend(tuple(handles)).put(figure)
    return figure
