"""Draw a mechanism at its start for print, as on the page of its problem."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from ..mechanism.segments import Picture
from ..plots.paper import INK, MUTED, strip_math

BODY = "#c9d3dd"
LENGTH = 0.16  # fraction of the picture: length of the axes of space and of gravity
SUPPORT = 0.045  # fraction of the picture: size of a support
WIDTHS = 5.0, 2.4  # [pt] width of a body, for few and for many bodies


def draw_sketch(ax: Axes, p: Picture) -> None:
    """Draw a mechanism into ``ax``: bodies, joints, hatched supports, axes of space, gravity, and bodies' names.

    The names are those of the first and the last body, if there are two or more.
    """
    ax.set_axis_off()
    ax.set_aspect("equal")
    points = np.concatenate((p.lines.reshape(-1, 2), p.ground))
    low, high = points.min(axis=0), points.max(axis=0)
    size, width = float(np.max(high - low)), WIDTHS[len(p.lines) > 6]
    for a, b in p.lines:  # the outline, then the body inside it
        for wide, colour, layer in ((width, INK, 2.0), (width - 1.4, BODY, 2.1)):
            ax.plot(*np.array([a, b]).T, color=colour, linewidth=wide, solid_capstyle="round", zorder=layer)
    for x, y in p.ground:
        corners = np.array([[0.0, 0.0], [-0.6, 1.0], [0.6, 1.0]]) * SUPPORT * size + [x, y]
        ax.add_patch(Polygon(corners, facecolor="none", edgecolor=INK, linewidth=0.7, hatch="/////", zorder=0.5))
    ax.plot(*p.joints.T, "o", color="white", markersize=width, markeredgecolor=INK, markeredgewidth=0.7, zorder=4)
    for name, direction in p.arrows:
        start = [high[0] + 0.32 * size, high[1]] if name == "g" else low - 0.3 * size
        ends = np.array([start, start + LENGTH * size * direction])
        ax.update_datalim(ends)
        ax.annotate(
            "",
            ends[1],
            ends[0],
            annotation_clip=False,
            arrowprops={"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "color": MUTED},
        )
        _write_words(ax, f"${name}$", ends[1], 8.0 * direction, MUTED)
    for name, at in p.names if len(p.names) > 1 else ():  # outwards, where bars are few
        _write_words(ax, strip_math(name), at, np.array([np.copysign(24.0, at[0] - 0.5 * (low + high)[0]), -6.0]), INK)


def _write_words(ax: Axes, words: str, at: np.ndarray, offset: np.ndarray, colour: str) -> None:
    """Write ``words`` into the drawing, at an offset ``offset`` [pt] from the point ``at``."""
    ax.annotate(
        words,
        at,
        xytext=tuple(offset),
        textcoords="offset points",
        ha="center",
        va="center",
        color=colour,
        zorder=6,
        annotation_clip=False,
    )
