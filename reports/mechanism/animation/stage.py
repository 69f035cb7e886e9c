"""The pictures: mechanisms as lines on a fixed background, their energy errors below, one time for all."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ....harness.results import store
from ...model.curves import Curve, log_limits, upper
from ...model.results import Run
from ...plots import printed
from ...plots.lines import ended
from ...plots.palette import Look, looks
from ...plots.spec import Axis, Plot, Trace
from ...plots.style import GRID, INK, MUTED, plain, style
from ..paths import PointPath, longest, path_of
from ..segments import Mechanism, mechanism_of
from .files import Picture

DPI = 100
TRAIL, POINTS = 0.12, 120  # of the time shown, the path of a point: its own in colour, the exact one in ink
WIDTH, STRIP, ABREAST = 7.2, 1.35, 3  # [in], [in], panels in a row
FLAT = 0.02  # of the mechanism's size: motion this thin is seen from the front
TILT = np.deg2rad(20.0), np.deg2rad(35.0)  # elevation and turn of the view of a spatial motion


@dataclass(frozen=True)
class Actor:
    """A run with its mechanism and its energy error."""

    run: Run
    mechanism: Mechanism
    t: Float[np.ndarray, " nt"]
    energy_error: Float[np.ndarray, " nt"]
    look: Look
    path: PointPath | None = None  # of a point with a known exact motion

    @property
    def end(self) -> float:
        return float(self.mechanism.t[-1])

    def energy(self, first: float, last: float) -> Curve:
        """Its largest error in spans of that time."""
        inside = (self.t >= first) & (self.t <= last)
        found = upper(self.t[inside] - first, self.energy_error[inside], last - first)
        return Curve(found.t + first, found.y)

    @property
    def name(self) -> str:
        return f"{self.run.record.solver}, {self.run.step_words}{ended(self.run)}"


def actors_of(folder: Path, runs: Sequence[Run]) -> list[Actor]:
    """Those of ``runs`` that have poses; ValueError when one has none."""
    own = looks({r.solver for r in store.load(folder, check_series=False).records})
    out = []
    for run in runs:
        series = store.series_of(folder, run.record)
        mechanism = mechanism_of(series)
        if series is None or mechanism is None:
            raise ValueError(f"run {run.record.run_id} ({run.record.case}) kept no poses")
        out.append(Actor(run, mechanism, series["t"], series["energy_error"], own[run.record.solver],
                         path_of(series)))  # fmt: skip
    return out


class Stage:
    """Draws the background once and what moves for every picture."""

    def __init__(
        self, actors: Sequence[Actor], *, ghosts: bool, frames: int,
        window: tuple[float | None, float | None] = (None, None),
    ) -> None:  # fmt: skip
        self.actors = list(actors)
        self.t = _times(self.actors, frames, window)
        self.view = view_of(self.actors[0].mechanism)
        with style():
            self._build(ghosts)

    def pictures(self) -> Iterator[Picture]:
        """One a time of ``t``."""
        with style():
            self.canvas.draw()
            background = self.canvas.copy_from_bbox(self.figure.bbox)
            for now in self.t:
                self.canvas.restore_region(background)
                self._move(float(now))
                yield np.asarray(self.canvas.buffer_rgba())[..., :3].copy()

    def _build(self, ghosts: bool) -> None:
        panels = 1 if ghosts else len(self.actors)
        abreast = min(panels, ABREAST)
        rows = -(-panels // abreast)
        low, high = _extent(self.actors, self.view)
        shape = (high[1] - low[1]) / (high[0] - low[0])
        tall = float(np.clip(WIDTH / abreast * shape + 0.25, 1.3, 4.2 if rows == 1 else 2.6))
        strip, looks_ = self._strip(), {a.run.record.solver: a.look for a in self.actors}
        legend = printed.Legend.of(strip.traces if ghosts else [], looks_, wide=True)
        self.figure = Figure(figsize=(WIDTH, tall * rows + STRIP + legend.height), dpi=DPI, layout="constrained")
        self.canvas = FigureCanvasAgg(self.figure)
        places = self.figure.add_gridspec(rows + 1, abreast, height_ratios=[tall] * rows + [STRIP])
        axes = [self.figure.add_subplot(places[k // abreast, k % abreast]) for k in range(panels)]
        for ax in axes:
            ax.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=[], yticks=[])
            ax.spines[:].set(visible=True, color=GRID)
        self.bodies: list[tuple[Axes, LineCollection, Line2D]] = []
        self.trails: list[tuple[Axes, Line2D, Callable[[np.ndarray], np.ndarray]]] = []
        exact = longest(a.path for a in self.actors)
        for k, actor in enumerate(self.actors):
            ax = axes[0] if ghosts else axes[k]
            self.bodies.append(_body(ax, actor, self.view, ghost=ghosts and k > 0))
            if actor.path:
                self.trails.append((ax, _trail(ax, actor.look.colour), actor.path.own_at))
            if exact and (k == 0 or not ghosts):
                self.trails.append((ax, _trail(ax, INK), exact.exact_at))
            if not ghosts:
                ax.set_title(plain(actor.name), color=actor.look.colour, fontsize=7.0)
        self.strip = ax = self.figure.add_subplot(places[rows, :])
        printed.panel(ax, strip, looks_)
        ax.set(xlabel=printed.label(strip.x), ylabel=printed.label(strip.y), title=" ")  # room for the clock
        legend.put(self.figure)
        self.cursor = ax.axvline(self.t[0], color=INK, linewidth=0.8, animated=True)
        self.clock = ax.text(1.0, 1.03, "", transform=ax.transAxes, ha="right", animated=True)

    def _strip(self) -> Plot:
        """Energy errors of all; what blew up runs along the upper edge."""
        curves = [a.energy(self.t[0], self.t[-1]) for a in self.actors]
        scale = max((s for a in self.actors if (s := a.run.record.energy_scale_J) > 0.0), default=1.0)
        low, high = log_limits(curves, scale)
        traces = [
            Trace(a.name, c.t, np.minimum(c.y, high), solver=a.run.record.solver)
            for a, c in zip(self.actors, curves, strict=True)
        ]
        x = Axis("t", "s", low=float(self.t[0]), high=float(self.t[-1]), symbol="t")
        return Plot("energy", "", "", x, Axis("", "J", log=True, low=low, high=high, symbol="|E-E_0|"), traces)

    def _move(self, now: float) -> None:
        back = np.linspace(max(self.t[0], now - TRAIL * (self.t[-1] - self.t[0])), now, POINTS)
        for ax, line, points in self.trails:
            line.set_data(*flat(points(back), self.view).T)
            ax.draw_artist(line)
        for actor, (ax, lines, joints) in zip(self.actors, self.bodies, strict=True):
            k = actor.mechanism.frame(now)
            gone = now > actor.end + 1e-9
            lines.set_segments(list(flat(actor.mechanism.segments(k), self.view)))
            lines.set_color(MUTED if gone else actor.look.colour)
            joints.set_data(*flat(actor.mechanism.joints(k), self.view).T)
            ax.draw_artist(lines)
            ax.draw_artist(joints)
        self.cursor.set_xdata([now, now])
        self.clock.set_text(f"t = {now:.2f} s")
        self.strip.draw_artist(self.cursor)
        self.strip.draw_artist(self.clock)


def view_of(mechanism: Mechanism) -> Float[np.ndarray, "2 3"]:
    """Directions of space that are right and up: against gravity is up, a planar motion is seen from the front."""
    g = mechanism.gravity
    up = -g / np.linalg.norm(g) if np.any(g) else np.array([0.0, 0.0, 1.0])
    seen = _some(len(mechanism.t))
    points = np.concatenate([mechanism.r[seen].reshape(-1, 3), *(mechanism.joints(k) for k in seen)])
    if np.ptp(points, axis=0).max() <= FLAT * mechanism.size:  # it turns about one point: then by its segments
        points = np.concatenate([mechanism.segments(k).reshape(-1, 3) for k in seen])
    level = points - np.outer(points @ up, up)
    level -= level.mean(axis=0)
    _, sizes, axes = np.linalg.svd(level, full_matrices=False)
    right = axes[0] - up * (axes[0] @ up)
    right /= np.linalg.norm(right)
    right *= 1.0 if right[int(np.argmax(np.abs(right)))] > 0.0 else -1.0
    depth = np.ptp(level @ np.cross(right, up))
    if depth <= FLAT * mechanism.size or sizes[0] == 0.0:
        return np.stack((right, up))
    elevation, turn = TILT
    front = np.cross(right, up)
    towards = np.cos(turn) * front + np.sin(turn) * right
    across = np.cos(turn) * right - np.sin(turn) * front
    return np.stack((across, np.cos(elevation) * up - np.sin(elevation) * towards))


def flat(points: Float[np.ndarray, "*n 3"], view: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "*n 2"]:
    """Points on paper."""
    return points @ view.T


def _times(
    actors: Sequence[Actor], frames: int, window: tuple[float | None, float | None]
) -> Float[np.ndarray, " frames"]:
    end = max(a.end for a in actors)
    first, last = window[0] or 0.0, end if window[1] is None else min(window[1], end)
    if not 0.0 <= first < last:
        raise ValueError(f"the motion is kept from 0 to {end:g} s: {first:g} to {last:g} s is nothing to show")
    return np.linspace(first, last, frames)


def _extent(actors: Sequence[Actor], view: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right of everything; of a motion that blew up, what the first actor needs threefold."""
    boxes = []
    for a in actors:
        points = np.concatenate([flat(a.mechanism.segments(k), view).reshape(-1, 2) for k in _some(len(a.mechanism.t))])
        boxes.append((points.min(axis=0), points.max(axis=0)))
    size = min(float(np.max(high - low)) for low, high in boxes)
    middle = 0.5 * (boxes[0][0] + boxes[0][1])
    low = np.maximum(np.min([b[0] for b in boxes], axis=0), middle - 1.5 * size)
    high = np.minimum(np.max([b[1] for b in boxes], axis=0), middle + 1.5 * size)
    margin = 0.06 * float(np.max(high - low))
    wide = np.maximum(0.5 * (high - low) + margin, 0.12 * float(np.max(high - low)))
    return 0.5 * (low + high) - wide, 0.5 * (low + high) + wide


def _some(n: int) -> np.ndarray:
    """At most 200 of ``n`` frames, first and last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, 200)).astype(int))


def _trail(ax: Axes, colour: str) -> Line2D:
    """What a point leaves behind."""
    return ax.add_line(Line2D([], [], color=colour, linewidth=0.9, zorder=5, animated=True))


def _body(ax: Axes, actor: Actor, view: np.ndarray, *, ghost: bool) -> tuple[Axes, LineCollection, Line2D]:
    m = actor.mechanism
    many = len(m.body) > 30
    lines = LineCollection([], linewidths=1.3 if many else 2.2, alpha=0.45 if ghost else 1.0, capstyle="round",
                           zorder=2 if ghost else 3, animated=True)  # fmt: skip
    ax.add_collection(lines, autolim=False)
    joints = Line2D([], [], linestyle="", marker="o", markersize=1.6 if many else 3.0, color="white",
                    markeredgecolor=MUTED if ghost else INK, markeredgewidth=0.5, zorder=4, animated=True)  # fmt: skip
    ax.add_line(joints)
    ground = flat(m.ground, view)
    ax.plot(ground[:, 0], ground[:, 1], linestyle="", marker=7, color=MUTED, markersize=5, zorder=1)
    return ax, lines, joints
