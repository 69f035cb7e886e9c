"""Draw small pictures inside a page: number lines, zooms, sketches; their SVG is in ``drawings.html``."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup

from ..mechanism.segments import Picture
from ..model.words import format_decade, number
from ..rendering import make_environment

BADGE = {"good": "#1a7044", "wrong": "#b3123a", "failed": "#8f4500", "refused": "#4d5a8f"}
LETTER = 7.0  # [px] largest width of a letter
TURNS = [math.copysign(k, s) * math.pi / 8.0 for k in range(9) for s in (1, -1)]  # from downwards to both sides
STEEP = 30.0  # ratio of values beyond which the line is logarithmic
# [px, rad] corners in polar coordinates
STAR = [((7.0 if k % 2 == 0 else 3.0), math.pi * (k / 5.0 - 0.5)) for k in range(10)]


@dataclass(frozen=True)
class Scale:
    """A map from values to pixels, linear or logarithmic; values outside are put at the edge."""

    low: float
    high: float
    start: float  # [px] position of ``low``, and below of ``high``
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Return the position of ``value`` [px]; the middle if the scale has no length."""
        low, high = (math.log10(self.low), math.log10(self.high)) if self.log else (self.low, self.high)
        if self.log:
            value = math.log10(value) if value > 0.0 else low
        span = high - low
        share = 0.5 if span <= 0.0 else min(max((value - low) / span, 0.0), 1.0)
        return self.start + share * (self.end - self.start)


def choose_scale(values: Sequence[float], start: float, end: float, *, log: bool | None = None) -> Scale:
    """Return a scale from ``start`` to ``end`` [px] for all values with a margin.

    It is logarithmic if the values are far apart and none is negative, unless ``log`` decides.
    """
    finite = [v for v in values if math.isfinite(v)]
    above = [v for v in finite if v > 0.0]
    if log is None:
        log = bool(above) and min(finite) >= 0.0 and max(above) > STEEP * min(above)
    if log:
        low, high = (min(above), max(above)) if above else (1e-16, 1.0)
        return Scale(low / 2.0, high * 2.0, start, end, log=True)
    low, high = (min(finite), max(finite)) if finite else (0.0, 1.0)
    room = 0.12 * (high - low) or 0.5 * abs(high) or 1.0
    return Scale(low - room, high + room, start, end)


def draw_number_line(
    measured: float, low: float, high: float, unit: str, kind: str, spread: Sequence[float] = ()
) -> Markup:
    """Draw the ``measured`` number against its band from ``low`` to ``high``; infinite ends extend to the edge.

    ``spread`` has the numbers measured in all settings; ``kind`` is that of the mark that colours the number.
    """
    around = [v for v in spread if math.isfinite(v)]
    at = choose_scale([measured, low, high, *around], 8.0, 232.0)
    if not at.log and low == 0.0 and min((measured, *around)) >= 0.0:
        at = replace(at, low=0.0)
    return _draw("number_line", describe_number_line(measured, low, high, unit), at, measured, low, high, around, kind)


def describe_number_line(measured: float, low: float, high: float, unit: str) -> str:
    """Return the ``measured`` number and its band in words, for screen readers; an infinite end is left out."""
    unit = f" {unit}" if unit else ""
    ends = [number(v) if math.isfinite(v) else "" for v in (low, high)]
    band = (
        f"{ends[0]} to {ends[1]}{unit}"
        if all(ends)
        else (f"at most {ends[1]}{unit}" if ends[1] else f"at least {ends[0]}{unit}" if ends[0] else "none")
    )
    value = "nothing" if math.isnan(measured) else f"{number(measured)}{unit}"
    return f"measured {value}; band {band}"


def draw_panel(title: str, unit: str, values: Sequence[float], colour: str, *, star: bool) -> Markup:
    """Draw magnitudes on a logarithmic axis over steps counted back from the last, which ``star`` marks as a stop."""
    first, sizes = len(values) - 1, [abs(v) for v in values]
    x, y = Scale(-float(first), 0.0, 46.0, 248.0), choose_scale(sizes, 92.0, 18.0, log=True)
    dots = [(x(k - first), y(v)) for k, v in enumerate(sizes) if math.isfinite(v)]
    finite = [number(v) for v in sizes if math.isfinite(v)]
    change = f" over the last {first} steps: from {finite[0]} to {finite[-1]} {unit}" if finite else ": no number"
    head = f"{title} [{unit}]" if unit else title
    corners = [(r * math.cos(a), r * math.sin(a)) for r, a in STAR] if star else []
    rules = [(y(v), format_decade(v)) for v in choose_ticks(y.low, y.high)]
    return _draw("zoom", title + change, head, rules, dots, first, colour, corners)


def choose_ticks(low: float, high: float) -> list[float]:
    """Return at most four round values of a logarithmic axis: decades, or 1-2-5 within few decades."""
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    if last - first >= 1:
        every = max(math.ceil((last - first + 1) / 4), 1)
        return [10.0**d for d in range(first, last + 1, every)]
    fine = [m * 10.0**d for d in range(first - 1, last + 2) for m in (1.0, 2.0, 5.0)]
    return [v for v in fine if low <= v <= high][:4]


def draw_badge(name: str, facts: Sequence[tuple[str, str, str]]) -> Markup:
    """Draw a stand-alone badge for a README: the name and its facts, with colours that need no style sheet.

    A fact is its name, its value and the kind of mark that colours it.
    """
    x, parts = LETTER * len(name) + 20.0, [(0.0, LETTER * len(name) + 20.0, "", name)]
    for a, b, kind in facts:
        wide = LETTER * (len(a) + len(b) + 1) + 16.0
        parts.append((x, wide, BADGE[kind], f"{a} {b}"))
        x += wide
    return _draw("badge", "; ".join(said for *_, said in parts), x, parts)


def draw_sketch(p: Picture, words: str) -> Markup:
    """Draw a mechanism at its start: bodies, joints, supports, arrows for the axes and gravity, and names."""
    at = _fit_to_page(np.concatenate([p.lines.reshape(-1, 2), p.ground.reshape(-1, 2)]), 420.0, 300.0, 46.0)
    arrows = [(name, 26.0 * float(unit[0]), -26.0 * float(unit[1])) for name, unit in p.arrows]
    a, b = p.lines[:, None, 0], p.lines[:, None, 1]
    ink = at(a + np.linspace(0.0, 1.0, 50)[:, None] * (b - a)).reshape(-1, 2)
    placed = [(name, *_place_name(np.array(at(c)), name, ink)) for name, c in p.names]
    return _draw("sketch", words, at(p.lines), at(p.joints), at(p.ground), arrows, placed)


def draw_snapshot(lines: np.ndarray, exact: np.ndarray | None, ground: np.ndarray, words: str) -> Markup:
    """Draw a mechanism at one time (x right, y up, any unit) over the exact one in black."""
    known = lines if exact is None else exact
    seen = np.concatenate([known.reshape(-1, 2), ground.reshape(-1, 2)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide = 0.5 * float(np.max(high - low)) or 1.0
    own = np.clip(lines, low - wide, high + wide)  # a diverging mechanism stays within the picture
    at = _fit_to_page(np.concatenate([seen, own.reshape(-1, 2)]), 260.0, 150.0, 14.0)
    layers = [("exact", at(exact))] if exact is not None else []
    return _draw("snapshot", words, [*layers, ("run", at(own))])


def draw_tracking(dots: Sequence[tuple[float, str, str, str]], whole: int, words: str) -> Markup:
    """Draw a line with a dot for each solver that tracks a part of the motion, and the number that track all of it.

    ``dots`` hold the fraction of the line, colour, words and name, which is written where there is room; ``whole`` is
    the number, ``words`` describe the picture.
    """
    left, right, taken, placed = 6.0, 352.0, -math.inf, []
    for share, colour, said, name in sorted(dots):
        x, wide = left + share * (right - left), LETTER * len(name) * 0.86
        start = max(min(x - 4.0, right - wide), left)
        placed.append((x, colour, said, name, start if start > taken else None))
        taken = start + wide + 8.0 if start > taken else taken
    return _draw("follow", words, placed, whole)


def _fit_to_page(seen: np.ndarray, width: float, height: float, room: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the map from drawing points (y up) to pixels (y down) that centres the points ``seen`` on the picture.

    The picture has ``width`` and ``height`` with a margin ``room`` [px].
    """
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = float(np.min((np.array([width, height]) - 2.0 * room) / np.maximum(high - low, 1e-9)))
    return lambda p: np.array([width, height]) / 2.0 + scale * (p - (low + high) / 2.0) * [1.0, -1.0]


def _place_name(at: np.ndarray, name: str, ink: np.ndarray) -> tuple[float, float]:
    """Return the place [px] nearest to ``at`` where a name covers no point of ``ink``, else the place below ``at``."""
    half = np.array([LETTER * len(name) / 2.0 + 5.0, 11.0])
    places = [at + r * np.array([math.sin(a), math.cos(a)]) for r in range(16, 80, 4) for a in TURNS]
    free = (x for x in places if not np.any(np.all(np.abs(ink - x) < half, axis=1)))
    x, y = next(free, places[0])
    return float(x), float(y)


def _draw(macro: str, *values: object) -> Markup:
    """Render a macro of the template ``drawings.html``, with numbers to a tenth of a pixel."""
    return getattr(make_environment().get_template("drawings.html").module, macro)(*values)
