"""Small drawings inside a page, as SVG that takes its colours from the page: number lines, sparklines, zooms."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ..model.words import number

BADGE = {"good": "#1a7044", "wrong": "#b3123a", "failed": "#8f4500", "refused": "#4d5a8f"}
FLAT = 0.01  # relative: a smaller change is not drawn as one
LETTER = 7.0  # [px] width of a letter of a name, at most
TURNS = [math.copysign(k, s) * math.pi / 8.0 for k in range(9) for s in (1, -1)]  # from downwards on, either way
STEEP = 30.0  # values further apart than this factor are drawn on a logarithmic line


@dataclass(frozen=True)
class Scale:
    """Values to pixels, linear or logarithmic; what lies outside is put at the edge."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        low, high = (math.log10(self.low), math.log10(self.high)) if self.log else (self.low, self.high)
        if self.log:
            value = math.log10(value) if value > 0.0 else low
        span = high - low
        share = 0.5 if span <= 0.0 else min(max((value - low) / span, 0.0), 1.0)
        return self.start + share * (self.end - self.start)


def scale_for(values: Sequence[float], start: float, end: float, *, log: bool | None = None) -> Scale:
    """One that holds all values with some room; logarithmic where they lie far apart and none is negative."""
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


def number_line(measured: float, low: float, high: float, unit: str, kind: str, spread: Sequence[float] = ()) -> Markup:
    """The measured number against its band, with its spread over all settings; open ends reach the edge."""
    width, y = 240.0, 20.0
    around = [v for v in spread if math.isfinite(v)]
    scale = scale_for([v for v in (measured, low, high, *around) if math.isfinite(v)], 8.0, width - 8.0)
    if not scale.log and low == 0.0 and min((measured, *around)) >= 0.0:
        scale = Scale(0.0, scale.high, scale.start, scale.end)
    left, right = scale(low) if math.isfinite(low) else 8.0, scale(high) if math.isfinite(high) else width - 8.0
    parts = [_line("axis", 4.0, 236.0, y, y)]
    if not (math.isnan(low) and math.isnan(high)):
        parts.append(_tag("rect", "band", x=left, y=y - 6.0, width=max(right - left, 3.0), height=12.0, rx=2.0))
    for x, v in ((scale(v), v) for v in (low, high) if math.isfinite(v)):
        anchor = "start" if x < 30.0 else "end" if x > 210.0 else "middle"
        parts += [_line("edge", x, x, y - 8.0, y + 8.0), _text("tick", x, y + 21.0, number(v), anchor)]
    if len(around) == 2 and around[0] < around[1]:
        title = Markup("<title>from {} to {} over all settings</title>").format(*map(number, around))
        parts.append(_line("spread", scale(around[0]), scale(around[1]), y, y, title))
    if not math.isnan(measured):
        parts.append(_tag("path", f"dot {kind}", d=f"M{scale(measured):.1f} {y - 7.0:.1f}l6 7l-6 7l-6 -7z"))
    return _drawing("numberline", 240, 44, describe_bar(measured, low, high, unit), parts)


def describe_bar(measured: float, low: float, high: float, unit: str) -> str:
    """The same in words, for those who do not see it."""
    unit = f" {unit}" if unit else ""
    ends = [number(v) if math.isfinite(v) else "" for v in (low, high)]
    band = f"{ends[0]} to {ends[1]}{unit}" if all(ends) else (
        f"at most {ends[1]}{unit}" if ends[1] else f"at least {ends[0]}{unit}" if ends[0] else "none")  # fmt: skip
    value = "nothing" if math.isnan(measured) else f"{number(measured)}{unit}"
    return f"measured {value}; band {band}"


def sparkline(values: Sequence[float], words: str) -> Markup:
    """A line through values in their order, logarithmic where they span decades; flat where they hardly differ."""
    width, height = 110.0, 26.0
    scale = scale_for(values, height - 4.0, 4.0)
    known = [v for v in values if math.isfinite(v)]
    if known and max(known) - min(known) <= FLAT * max(map(abs, known)):
        middle, room = sum(known) / len(known), max(map(abs, known)) or 1.0
        scale = Scale(middle - room, middle + room, height - 4.0, 4.0)
    step = (width - 8.0) / max(len(values) - 1, 1)
    dots = [(4.0 + k * step, scale(v)) for k, v in enumerate(values) if math.isfinite(v)]
    parts = [_polyline(dots), *(_tag("circle", "", cx=x, cy=y, r=2.6) for x, y in dots[-1:])]
    return _drawing("spark", 110, 26, words, parts)


def panel(title: str, unit: str, values: Sequence[float], colour: str, *, star: bool) -> Markup:
    """Values on a logarithmic axis over steps counted from the last one, which has a star if the run stopped there."""
    width, height, left, first = 260.0, 112.0, 46.0, len(values) - 1
    sizes = [abs(v) for v in values]
    y = scale_for(sizes, height - 20.0, 18.0, log=True)
    x = Scale(-float(first), 0.0, left, width - 12.0)
    dots = [(x(k - first), y(v)) for k, v in enumerate(sizes) if math.isfinite(v)]
    parts = []
    for v in ticks(y.low, y.high):
        parts += [_line("rule", left, width - 12.0, y(v), y(v)),
                  _text("tick", left - 4.0, y(v) + 3.0, number(v, 1).removeprefix("1×"), "end")]  # fmt: skip
    parts.append(_polyline(dots, style=f"stroke: {colour}"))
    for px, py in dots[-1:]:
        parts.append(_star(px, py, colour) if star else _tag(
            "path", "cross", d=f"M{px - 4.0:.1f} {py - 4.0:.1f}l8 8m0 -8l-8 8", style=f"stroke: {colour}"))  # fmt: skip
    parts += [_text("head", 4.0, 11.0, f"{title} [{unit}]" if unit else title),
              _text("tick", x(-first), height - 6.0, f"{first} steps before", "start"),
              _text("tick", x(0.0), height - 6.0, "the last step", "end")]  # fmt: skip
    finite = [number(v) for v in sizes if math.isfinite(v)]
    change = f" over the last {first} steps: from {finite[0]} to {finite[-1]} {unit}" if finite else ": no number"
    return _drawing("zoom", 260, 112, title + change, parts)


def ticks(low: float, high: float) -> list[float]:
    """At most four round values of a logarithmic axis: decades, or 1-2-5 where there are few of them."""
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    if last - first >= 1:
        every = max(math.ceil((last - first + 1) / 4), 1)
        return [10.0**d for d in range(first, last + 1, every)]
    fine = [m * 10.0**d for d in range(first - 1, last + 2) for m in (1.0, 2.0, 5.0)]
    return [v for v in fine if low <= v <= high][:4]


def badge(name: str, facts: Sequence[tuple[str, str, str]]) -> Markup:
    """A file of its own for a README: the name, then what is known of it, in colours that need no page."""
    width = [LETTER * len(name) + 20.0, *(LETTER * (len(a) + len(b) + 1) + 16.0 for a, b, _ in facts)]
    x, parts = 0.0, [_tag("rect", "", x=0.0, y=0.0, width=sum(width), height=22.0, fill="#24292f", rx=4.0)]
    for k, wide in enumerate(width):
        words, colour = (name, "#24292f") if k == 0 else (" ".join(facts[k - 1][:2]), BADGE[facts[k - 1][2]])
        inside = [_tag("rect", "", x=x, y=0.0, width=wide, height=22.0, fill=colour)] if k else []
        parts += [*inside, _tag("text", "", words, x=x + wide / 2.0, y=15.0, text_anchor="middle", fill="#ffffff")]
        x += wide
    words = "; ".join([name, *(f"{a} {b}" for a, b, _ in facts)])
    return _tag("svg", "", Markup("").join(parts), xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {x:.1f} 22",
                width=x, height=22.0, role="img", aria_label=words, font_family="DejaVu Sans, Verdana, sans-serif",
                font_size="11")  # fmt: skip


def sketch(lines: np.ndarray, joints: np.ndarray, ground: np.ndarray, arrows: Sequence[tuple[str, np.ndarray]],
           names: Sequence[tuple[str, np.ndarray]], words: str) -> Markup:  # fmt: skip
    """A mechanism on paper (x right, y up, any unit): bodies, joints, supports, arrows of unit length, names."""
    width, height, room = 420, 300, 46.0
    at = _fit_to_page(np.concatenate([lines.reshape(-1, 2), ground.reshape(-1, 2)]), width, height, room)
    parts = [_line("body", a[0], b[0], a[1], b[1]) for a, b in ((at(p), at(q)) for p, q in lines)]
    parts += [_tag("circle", "joint", cx=x, cy=y, r=3.0) for x, y in map(at, joints)]
    parts += [_tag("path", "support", d=f"M{x:.1f} {y:.1f}l-8 -13h16z") for x, y in map(at, ground)]
    for k, (name, way) in enumerate(arrows):
        x, y = (width - 30.0, 16.0) if name == "g" else (30.0, height - 30.0)
        dx, dy = 26.0 * float(way[0]), -26.0 * float(way[1])
        parts += [_line(f"arrow a{k}", x, x + dx, y, y + dy), _tag("circle", "tip", cx=x + dx, cy=y + dy, r=2.2),
                  _text("letter", x + 1.45 * dx, y + 1.45 * dy + 4.0, name, "middle")]  # fmt: skip
    ink = np.array([at(p + u * (q - p)) for p, q in lines for u in np.linspace(0.0, 1.0, 50)]).reshape(-1, 2)
    for name, p in names:
        x, y = _beside(np.array(at(p)), name, ink)
        parts.append(_text("name", x, y + 4.0, name, "middle"))
    return _drawing("sketch", width, height, words, parts)


def snapshot(lines: np.ndarray, exact: np.ndarray | None, ground: np.ndarray, words: str) -> Markup:
    """A mechanism at one time (x right, y up, any unit), over the exact one in ink."""
    width, height, room = 260.0, 150.0, 14.0
    known = lines if exact is None else exact
    seen = np.concatenate([known.reshape(-1, 2), ground.reshape(-1, 2)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide = 0.5 * float(np.max(high - low)) or 1.0
    own = np.clip(lines.reshape(-1, 2), low - wide, high + wide)  # what flies apart stays near
    at = _fit_to_page(np.concatenate([seen, own]), width, height, room)

    def path(kind: str, pairs: np.ndarray) -> Markup:
        ends = "".join(f"M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}" for (a, b), (c, d) in at(pairs))
        return _tag("path", kind, d=ends)

    parts = [path("exact", exact)] if exact is not None else []
    return _drawing("snapshot", int(width), int(height), words, [*parts, path("run", own.reshape(lines.shape))])


def ticks_on(dots: Sequence[tuple[float, str, str, str]], whole: int, words: str) -> Markup:
    """A dot for each share of a line, with its name where there is room; how many reach the end is written there."""
    y, left, right = 26.0, 6.0, 352.0
    parts = [_line("axis", left, right, y, y), _text("count", right + 8.0, y + 5.0, f"{whole} →")]
    taken = -math.inf
    for share, colour, said, name in sorted(dots):
        x = left + share * (right - left)
        title = Markup("<title>{}</title>").format(said)
        parts.append(_tag("circle", "", title, cx=x, cy=y, r=5.0, fill=colour, data_solver=name))
        wide, start = LETTER * len(name) * 0.86, max(min(x - 4.0, right - LETTER * len(name) * 0.86), left)
        if start > taken:
            parts.append(_text("tick", start, y - 11.0, name))
            taken = start + wide + 8.0
    return _drawing("follow", 400, 36, words, parts)


def _fit_to_page(seen: np.ndarray, width: float, height: float, room: float) -> Callable[[np.ndarray], np.ndarray]:
    """From points on paper (y up) to pixels (y down): all of ``seen`` in the middle, as large as ``room`` allows."""
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = float(np.min((np.array([width, height]) - 2.0 * room) / np.maximum(high - low, 1e-9)))
    return lambda p: np.array([width, height]) / 2.0 + scale * (p - (low + high) / 2.0) * [1.0, -1.0]


def _beside(at: np.ndarray, name: str, ink: np.ndarray) -> tuple[float, float]:
    """The place nearest to ``at`` where a name hides nothing of ``ink``, below if it can be; below if there is none."""
    half = np.array([LETTER * len(name) / 2.0 + 5.0, 11.0])
    places = [at + r * np.array([math.sin(a), math.cos(a)]) for r in range(16, 80, 4) for a in TURNS]
    free = (x for x in places if not np.any(np.all(np.abs(ink - x) < half, axis=1)))
    x, y = next(free, places[0])
    return float(x), float(y)


def _star(x: float, y: float, colour: str) -> Markup:
    turns = ((7.0 if k % 2 == 0 else 3.0, math.pi * (k / 5.0 - 0.5)) for k in range(10))
    points = " ".join(f"{x + r * math.cos(a):.1f},{y + r * math.sin(a):.1f}" for r, a in turns)
    return _tag("polygon", "star", points=points, style=f"fill: {colour}")


def _tag(name: str, kind: str, inside: str = "", /, **attributes: float | str) -> Markup:
    """An element of class ``kind``; numbers to a tenth of a pixel, ``_`` in a name for ``-``."""
    own = {"class": kind} if kind else {}
    pairs = {k.replace("_", "-"): v if isinstance(v, str) else f"{v:.1f}" for k, v in (own | attributes).items()}
    words = Markup("").join(Markup(' {}="{}"').format(k, v) for k, v in pairs.items())
    return Markup("<{0}{1}>{2}</{0}>" if inside else "<{0}{1}/>").format(name, words, inside)


def _line(kind: str, x1: float, x2: float, y1: float, y2: float, inside: str = "") -> Markup:
    return _tag("line", kind, inside, x1=x1, x2=x2, y1=y1, y2=y2)


def _text(kind: str, x: float, y: float, words: str, anchor: str = "start") -> Markup:
    return _tag("text", kind, words, x=x, y=y, text_anchor=anchor)


def _polyline(dots: Sequence[tuple[float, float]], **attributes: str) -> Markup:
    return _tag("polyline", "", points=" ".join(f"{x:.1f},{y:.1f}" for x, y in dots), **attributes)


def _drawing(kind: str, width: int, height: int, words: str, parts: Sequence[Markup]) -> Markup:
    """A whole drawing, with ``words`` for those who do not see it."""
    inside = Markup("").join(parts)
    return _tag("svg", kind, inside, viewBox=f"0 0 {width} {height}", role="img", aria_label=words)
