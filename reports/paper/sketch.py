"""The mechanisms as the paper draws them, from their stored poses: bodies, supports, axes, letters."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from ...harness.results.series import Series
from ..mechanism.segments import Mechanism, mechanism_of
from ..plots.printed import INK, MUTED

BODY = "#c9d3dd"
Point = Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class Board:
    """Axes that take points in space."""

    ax: Axes
    mechanism: Mechanism
    series: Series
    right: Float[np.ndarray, " 3"]
    up: Float[np.ndarray, " 3"]

    def flat(self, points: np.ndarray) -> Float[np.ndarray, "*n 2"]:
        """On paper."""
        return np.stack((np.asarray(points) @ self.right, np.asarray(points) @ self.up), axis=-1)

    def line(self, points: np.ndarray, **how: object) -> None:
        self.ax.plot(*self.flat(points).T, **{"color": INK, "linewidth": 0.8, "solid_capstyle": "round", **how})

    def rod(self, a: np.ndarray, b: np.ndarray, width: float) -> None:
        """A bar with an outline, ``width`` points thick."""
        self.line(np.array([a, b]), linewidth=width, zorder=2)
        self.line(np.array([a, b]), linewidth=width - 1.4, color=BODY, zorder=2.1)

    def dot(self, points: np.ndarray, size: float = 3.2, colour: str = "white") -> None:
        self.ax.plot(*self.flat(np.atleast_2d(points)).T, "o", color=colour, markersize=size, markeredgecolor=INK,
                     markeredgewidth=0.7, zorder=4)  # fmt: skip

    def arrow(self, a: np.ndarray, b: np.ndarray, label: str = "", colour: str = INK) -> None:
        ends = self.tips(a, b, "-|>", zorder=5, color=colour, linewidth=0.9, mutation_scale=7)
        if label:
            away = ends[1] - ends[0]
            self.write(b, label, tuple(7.0 * away / (np.linalg.norm(away) or 1.0)), colour)

    def tips(self, a: np.ndarray, b: np.ndarray, style: str, zorder: float | None = None, **how: object) -> np.ndarray:
        """A line from a to b with arrow heads; returns its ends on paper."""
        ends = self.flat(np.array([a, b]))
        self.ax.update_datalim(ends)
        self.ax.annotate("", tuple(ends[1]), tuple(ends[0]), annotation_clip=False, zorder=zorder,
                         arrowprops={"arrowstyle": style, "shrinkA": 0, "shrinkB": 0, **how})  # fmt: skip
        return ends

    def write(self, at: np.ndarray, label: str, away: tuple[float, ...] = (0.0, 0.0), colour: str = INK) -> None:
        """``label`` so many points from ``at``."""
        self.ax.update_datalim([tuple(self.flat(at))])
        self.ax.annotate(label, tuple(self.flat(at)), xytext=away, textcoords="offset points", ha="center",
                         va="center", color=colour, zorder=6, annotation_clip=False)  # fmt: skip

    def span(self, a: np.ndarray, b: np.ndarray, label: str, away: tuple[float, float]) -> None:
        """A length with arrows at both ends."""
        self.tips(a, b, "<|-|>", color=MUTED, linewidth=0.7, mutation_scale=6)
        self.write(0.5 * (np.asarray(a) + np.asarray(b)), label, away, MUTED)

    def support(self, at: np.ndarray, size: float) -> None:
        """A hatched triangle: the ground."""
        x, y = self.flat(at)
        corners = np.array([[x, y], [x - 0.6 * size, y + size], [x + 0.6 * size, y + size]])
        self.ax.add_patch(Polygon(corners, facecolor="none", edgecolor=INK, linewidth=0.7, hatch="/////", zorder=0.5))

    def gravity(self, at: np.ndarray, length: float) -> None:
        g = self.mechanism.gravity
        if np.any(g):
            self.arrow(at, np.asarray(at) + length * g / np.linalg.norm(g), "$g$", MUTED)

    def frame(self, at: np.ndarray, length: float, names: str = "XYZ", R: np.ndarray | None = None, origin: str = "O",
              away: tuple[float, float] = (-6.0, -6.0), colour: str = MUTED) -> None:  # fmt: skip
        """Those of three axes that are not seen end on."""
        for name, e in zip(names, np.eye(3) if R is None else R.T, strict=True):
            if np.hypot(e @ self.right, e @ self.up) > 0.2:
                self.arrow(at, np.asarray(at) + length * e, f"${name}$", colour)
        if origin:
            self.write(at, f"${origin}$", away, colour)


def draw_sketch(ax: Axes, view: str, series: Series | None) -> bool:
    """Draw the mechanism at its first frame; False where the series holds no poses."""
    mechanism = mechanism_of(series)
    ax.set_axis_off()
    ax.set_aspect("equal")
    if mechanism is None or series is None:
        return False
    directions, draw = VIEWS[view]
    right, up = (np.asarray(e) / np.linalg.norm(e) for e in directions)
    draw(Board(ax, mechanism, series, right, up))
    ax.margins(0.1)
    ax.autoscale_view()
    return True


def _rods(b: Board) -> None:
    """Fig. 1a: three rods along the body axes, and the axis about which it turns."""
    m, half = b.mechanism, 0.5  # [m] rods of 1 m, Sect. 5.1
    C, R = m.r[0, 0], m.R[0, 0]
    for k in np.argsort(R.T @ np.cross(b.right, b.up)):  # the one pointing at the reader last
        b.rod(C - half * R[:, k], C + half * R[:, k], 6.0)
    b.frame(C, 0.85, "xyz", R, origin="", colour=INK)
    Omega = np.array([b.series[f"obs_Omega_{a}"][0] for a in "xyz"])
    b.arrow(C, C + 0.8 * R @ Omega / np.linalg.norm(Omega), r"$\Omega_0$", "#D55E00")
    b.dot(C)
    b.write(C, "$O$", (-8, 5))
    b.frame(C - 0.95 * b.right - 0.55 * b.up, 0.3, origin="")


def _pendulum(b: Board) -> None:
    """Fig. 4: the cylinder held at O, C in its middle."""
    m, radius = b.mechanism, 0.1  # [m] Sect. 5.2
    O, C, R = m.ground[0], m.r[0, 0], m.R[0, 0]
    along = C - O
    across = radius * np.cross(np.cross(b.right, b.up), along) / np.linalg.norm(along)
    far = O + 2.0 * along
    outline = b.flat(np.array([O - across, far - across, far + across, O + across]))
    b.ax.add_patch(Polygon(outline, facecolor=BODY, edgecolor=INK, linewidth=0.9))
    b.support(O, 0.13)
    b.frame(O - 0.4 * b.right - 0.12 * b.up, 0.26, origin="")
    b.write(O, "$O$", (-8, -5))
    b.dot(np.array([O, C]))
    b.arrow(C, C + 0.34 * R[:, 0], "$x$")
    b.write(C, "$C$", (0, -9))
    below = -0.19 * b.up
    b.span(O + below, C + below, r"$\ell$", (0, -7))
    b.span(C + below, far + below, r"$\ell$", (0, -7))
    b.span(far + 0.1 * b.right - across, far + 0.1 * b.right + across, "$2r$", (11, 0))
    b.gravity(far + 0.35 * b.right + 0.12 * b.up, 0.24)


def _chain(b: Board) -> None:
    """Fig. 8: fifteen bars on A, B, C, D; B and C vanish at t = 0."""
    m = b.mechanism
    ends, joints = m.segments(0), m.joints(0)
    for a, c in ends:
        b.rod(a, c, 3.2)
    A, D = m.ground[0], m.ground[-1]
    n = len(ends) // 3
    named = {"A": A, "B": joints[n], "C": joints[2 * n], "D": D}
    for name, at in named.items():
        b.support(at, 0.09)
        b.write(at, f"${name}$", (-9, 3))
    b.dot(joints, 2.4)
    E = 0.5 * (ends[len(ends) // 2][0] + ends[len(ends) // 2][1])
    b.dot(E, 3.4, "#D55E00")
    b.write(E, "$E$", (0, 9))
    top = 0.16 * b.up
    for left, right in zip((A, named["B"], named["C"]), (named["B"], named["C"], D), strict=True):
        b.span(left + top, right + top, "$b$", (0, 6))
    b.frame(A - 0.45 * b.right - 0.45 * b.up, 0.3, origin="")
    b.gravity(D + 0.22 * b.right - 0.1 * b.up, 0.28)


def _top(b: Board) -> None:
    """Fig. 10: the axis Oz leans by theta to OZ."""
    m, wide = b.mechanism, 0.036  # [m] of the disk drawn for it: its shape is not given
    O, C, R = m.ground[0], m.r[0, 0], m.R[0, 0]
    turn = np.linspace(0.0, 2.0 * np.pi, 80)
    z = R[:, 2]
    arm = float(np.linalg.norm(C - O))
    rim = C + 0.015 * z + wide * (np.cos(turn)[:, None] * R[:, 0] + np.sin(turn)[:, None] * R[:, 1])
    cone = b.flat(np.vstack((rim, O)))
    outline = cone[ConvexHull(cone).vertices]  # of the disk and the tip below it
    b.ax.add_patch(Polygon(outline, facecolor=BODY, edgecolor=INK, linewidth=0.8))
    b.ax.add_patch(Polygon(b.flat(rim), facecolor="#e2e8ee", edgecolor=INK, linewidth=0.8, zorder=2))
    b.line(np.array([O, C]), linestyle=(0, (3, 2)), zorder=3)
    b.arrow(C, O + 1.75 * arm * z, "$z$")
    b.dot(C, 3.0, "#D55E00")
    b.write(C, "$C$", (-9, -3))
    b.frame(O, 1.45 * arm, away=(5.0, -9.0))
    Z, lean = np.array([0.0, 0.0, 1.0]), np.linspace(0.0, np.arccos(np.clip(z[2], -1.0, 1.0)), 30)
    side = z - z[2] * Z
    if np.linalg.norm(side) > 1e-9:
        side /= np.linalg.norm(side)
        b.line(O + 0.78 * arm * (np.cos(lean)[:, None] * Z + np.sin(lean)[:, None] * side), color=MUTED)
        b.write(O + 0.78 * arm * (np.cos(lean[15]) * Z + np.sin(lean[15]) * side), r"$\theta$", (1, 7), MUTED)
    b.line(np.array([O - 0.5 * arm * b.right, O + 0.5 * arm * b.right]), color=MUTED, linewidth=0.7, zorder=0)
    b.gravity(O + 0.8 * arm * b.right + 1.3 * arm * b.up, 0.45 * arm)


def _grid(b: Board) -> None:
    """Fig. 12a: the bars hanging from the ground."""
    m = b.mechanism
    for a, c in m.segments(0):
        b.rod(a, c, 2.6)
    size = m.size
    for at in m.ground:
        b.support(at, 0.05 * size)
    b.dot(m.joints(0), 2.2)
    flat = b.flat(m.joints(0))
    A = m.joints(0)[int(np.argmin(flat @ np.array([1.0, 1.0])))]
    b.dot(A, 3.4, "#D55E00")
    b.write(A, "$A$", (-8, 0))
    b.frame(m.ground[0] - 0.45 * size * b.right - 0.55 * size * b.up, 0.16 * size, origin="")
    b.gravity(m.ground[-1] + 0.16 * size * b.right - 0.1 * size * b.up, 0.2 * size)


OBLIQUE = ((-0.45, 0.9, 0.0), (-0.33, -0.165, 0.93))  # X towards the reader's left, Y to the right, Z up

FRONT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
VIEWS = {  # two directions of space that are right and up on paper, and what is drawn
    "rods": (OBLIQUE, _rods), "pendulum": (FRONT, _pendulum), "chain": (FRONT, _chain), "top": (OBLIQUE, _top),
    "grid": (((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), _grid),
}  # fmt: skip
