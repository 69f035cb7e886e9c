"""Small drawings inside a page, as SVG that takes its colours from the page: number lines, sparklines, zooms."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from ..model.words import number

FLAT = 0.01  # relative: a smaller change is not drawn as one
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
    ends = [8.0 if not math.isfinite(low) else scale(low), width - 8.0 if not math.isfinite(high) else scale(high)]
    parts = [Markup('<line class="axis" x1="4" x2="236" y1="{y}" y2="{y}"/>').format(y=y)]
    if not (math.isnan(low) and math.isnan(high)):
        parts.append(Markup('<rect class="band" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="12" rx="2"/>').format(
            ends[0], y - 6.0, max(ends[1] - ends[0], 3.0)))  # fmt: skip
    parts += [_tick(scale(v), y, number(v)) for v in (low, high) if math.isfinite(v)]
    if len(around) == 2 and around[0] < around[1]:
        parts.append(Markup('<line class="spread" x1="{:.1f}" x2="{:.1f}" y1="{y}" y2="{y}"><title>{}</title></line>')
                     .format(scale(around[0]), scale(around[1]),
                             f"from {number(around[0])} to {number(around[1])} over all settings", y=y))  # fmt: skip
    if not math.isnan(measured):
        parts.append(_diamond(scale(measured), y, kind))
    words = said(measured, low, high, unit)
    return Markup('<svg class="numberline" viewBox="0 0 240 44" role="img" aria-label="{}">{}</svg>').format(
        words, Markup("").join(parts)
    )


def said(measured: float, low: float, high: float, unit: str) -> str:
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
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in dots)
    last = Markup('<circle cx="{:.1f}" cy="{:.1f}" r="2.6"/>').format(*dots[-1]) if dots else ""
    return Markup('<svg class="spark" viewBox="0 0 110 26" role="img" aria-label="{}"><polyline points="{}"/>{}</svg>'
                  ).format(words, line, last)  # fmt: skip


@dataclass(frozen=True)
class Zoom:
    """One panel of a zoom: values of the last steps, the last one with a star if the run stopped there."""

    title: str
    unit: str
    values: tuple[float, ...]
    star: bool
    colour: str
    first: int  # steps before the last one


def panel(zoom: Zoom) -> Markup:
    """Values on a logarithmic axis over steps counted from the last one."""
    width, height, left, top, bottom = 260.0, 112.0, 46.0, 18.0, 20.0
    sizes = [abs(v) for v in zoom.values]
    y = scale_for(sizes, height - bottom, top, log=True)
    x = Scale(-float(zoom.first), 0.0, left, width - 12.0)
    count = max(len(sizes) - 1, 1)
    places = [x(-zoom.first * (1.0 - k / count)) for k in range(len(sizes))]
    dots = [(px, y(v)) for px, v in zip(places, sizes, strict=True) if math.isfinite(v)]
    line = " ".join(f"{px:.1f},{py:.1f}" for px, py in dots)
    parts = [_grid(y, left, width)]
    parts.append(Markup('<polyline points="{}" style="stroke: {}"/>').format(line, zoom.colour))
    if dots:
        parts.append(_star(*dots[-1], zoom.colour) if zoom.star else _cross(*dots[-1], zoom.colour))
    parts.append(Markup('<text x="4" y="11" class="head">{} {}</text>').format(
        zoom.title, f"[{zoom.unit}]" if zoom.unit else ""))  # fmt: skip
    for value, anchor in ((-zoom.first, "start"), (0, "end")):
        text = "the last step" if value == 0 else f"{-value} steps before"
        parts.append(Markup('<text class="tick" x="{:.0f}" y="{:.0f}" text-anchor="{}">{}</text>').format(
            x(value), height - 6.0, anchor, text))  # fmt: skip
    finite = [v for v in sizes if math.isfinite(v)]
    words = (f"{zoom.title} over the last {zoom.first} steps: from {number(finite[0])} to {number(finite[-1])} "
             f"{zoom.unit}" if finite else f"{zoom.title}: no number")  # fmt: skip
    return Markup('<svg class="zoom" viewBox="0 0 260 112" role="img" aria-label="{}">{}</svg>').format(
        words, Markup("").join(parts)
    )


def _grid(y: Scale, left: float, width: float) -> Markup:
    return Markup("").join(
        Markup('<line class="rule" x1="{:.0f}" x2="{:.0f}" y1="{:.1f}" y2="{:.1f}"/>'
               '<text class="tick" x="{:.0f}" y="{:.1f}" text-anchor="end">{}</text>').format(
            left, width - 12.0, y(v), y(v), left - 4.0, y(v) + 3.0, number(v, 1).removeprefix("1×"))
        for v in ticks(y.low, y.high)
    )  # fmt: skip


def ticks(low: float, high: float) -> list[float]:
    """At most four round values of a logarithmic axis: decades, or 1-2-5 where there are few of them."""
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    if last - first >= 1:
        every = max(math.ceil((last - first + 1) / 4), 1)
        return [10.0**d for d in range(first, last + 1, every)]
    fine = [m * 10.0**d for d in range(first - 1, last + 2) for m in (1.0, 2.0, 5.0)]
    return [v for v in fine if low <= v <= high][:4]


def _tick(x: float, y: float, text: str) -> Markup:
    anchor = "start" if x < 30.0 else "end" if x > 210.0 else "middle"
    return Markup('<line class="edge" x1="{:.1f}" x2="{:.1f}" y1="{:.1f}" y2="{:.1f}"/>'
                  '<text class="tick" x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(
        x, x, y - 8.0, y + 8.0, x, y + 21.0, anchor, text)  # fmt: skip


def _diamond(x: float, y: float, kind: str) -> Markup:
    return Markup('<path class="dot {}" d="M{:.1f} {:.1f}l6 7l-6 7l-6 -7z"/>').format(kind, x, y - 7.0)


def _star(x: float, y: float, colour: str) -> Markup:
    points = []
    for k in range(10):
        radius, angle = (7.0 if k % 2 == 0 else 3.0), math.pi * (k / 5.0 - 0.5)
        points.append(f"{x + radius * math.cos(angle):.1f},{y + radius * math.sin(angle):.1f}")
    return Markup('<polygon class="star" points="{}" style="fill: {}"/>').format(" ".join(points), colour)


def _cross(x: float, y: float, colour: str) -> Markup:
    return Markup('<path class="cross" d="M{:.1f} {:.1f}l8 8m0 -8l-8 8" style="stroke: {}"/>').format(
        x - 4.0, y - 4.0, escape(colour))  # fmt: skip


def strip(parts: Sequence[tuple[str, float, float, float, bool]], scale: Scale, words: str) -> Markup:
    """Sizes with their intervals on one line: circle, triangle, square; filled where distinct from zero."""
    shapes = ("M{x:.1f} 9a5 5 0 1 0 .01 0z", "M{x:.1f} 7.5l6 11h-12z", "M{x0:.1f} 9h10v10h-10z")
    drawn = [Markup('<line class="rule" x1="{:.1f}" x2="{:.1f}" y1="14" y2="14"/>').format(scale.start, scale.end)]
    for (name, size, low, high, sure), shape in zip(parts, shapes, strict=False):
        if not size > 0.0:
            continue
        x = scale(size)
        if high > low and math.isfinite(high):
            drawn.append(Markup('<line class="range" x1="{:.1f}" x2="{:.1f}" y1="14" y2="14"/>').format(
                scale(low), scale(high)))  # fmt: skip
        place = shape.format(x=x, x0=x - 5.0)
        drawn.append(Markup('<path class="part {}" d="{}"><title>{}</title></path>').format(
            "sure" if sure else "unsure", place, f"{name} {number(size)} J"))  # fmt: skip
    return Markup('<svg class="strip" viewBox="0 0 300 28" role="img" aria-label="{}">{}</svg>').format(
        words, Markup("").join(drawn)
    )
