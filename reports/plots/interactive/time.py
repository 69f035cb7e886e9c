"""Curves over time: the laws that the exact motion keeps, the step, errors, observables, invariants."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...model.accuracy import judged_until
from ...model.curves import SPANS_UPPER, Curve
from ...model.limits import log_limits
from ...model.motion import Motion
from ...model.results import Variant
from ...model.words import number, time, unit
from ..spec import Axis, Plot, Trace
from .group import Line, traces

BLOWN_UP = 1e-9  # a reference smaller than this part of what is shown is zero: it gives no scale


@dataclass(frozen=True)
class Chapter:
    """Plots under one heading."""

    title: str
    note: str
    plots: tuple[Plot, ...]


@dataclass(frozen=True)
class Drawing:
    """What all plots over time of a problem share."""

    variant: Variant
    lines: Sequence[Line]
    motions: Mapping[str, Motion]
    spans: int = SPANS_UPPER

    @property
    def largest(self) -> str:
        """What a point of a magnitude is."""
        return f"largest in each of {self.spans} spans of time"

    def curves(self, of: Callable[[Motion], Curve | None]) -> list[Curve | None]:
        return [of(self.motions[line.run.record.run_id]) for line in self.lines]

    @property
    def axis(self) -> Axis:
        ends = [r.t_end_s for c in self.variant.runs if (r := c.record).t_end_s == r.t_end_s]
        return Axis("t", "s", low=0.0, high=1.02 * max(ends, default=1.0), link="time")

    def scale(self, column: str) -> float:
        values = [getattr(c.record, column) for c in self.variant.runs]
        return max((v for v in values if v == v), default=1.0)

    def log(self, name: str, title: str, caption: str, symbol: str, in_unit: str, of: Callable[[Motion], Curve | None],
            scale: float, extra: Sequence[Trace] = ()) -> Plot | None:  # fmt: skip
        """A quantity of one sign over time; None when no run has it."""
        curves = self.curves(of)
        if not any(c is not None and len(c) for c in curves):
            return None
        low, high = log_limits(curves, scale)
        own = traces(self.lines, self.motions, of, (0.0, high))
        if not any(t.y.any() for t in own):
            caption = f"Exactly zero throughout. {caption}"
        return Plot(
            name, title, caption, self.axis, Axis(symbol, in_unit, log=True, low=low, high=high), [*own, *extra]
        )


def laws(d: Drawing) -> Chapter | None:
    """Energy error, |phi|, |phi_dot| and step."""
    energy, length = d.scale("energy_scale_J"), d.scale("length_scale_m")
    plots = [
        d.log("energy", "Energy error", f"Magnitude, {d.largest}; the work of dampers is taken off.", "|E − E₀|", "J",
              _norm("energy_error"), energy),
        d.log("phi", "Constraints",
              f"How far joints come apart, {d.largest}; axis rows have no unit and count as metres.",
              "|φ|", "m", _norm("phi_norm"), length),
        d.log("phi-dot", "Constraint rates", f"How fast they do, {d.largest}.", "|φ̇|", "m/s",
              _norm("phi_dot_norm"), length),
        d.log("step", "Step", "Median of each span, in a band from smallest to largest.", "Δt", "s",
              lambda m: m.step, d.axis.high),
    ]  # fmt: skip
    return _chapter("Laws and step", "What the exact motion keeps, and with which steps it was tried.", plots)


def errors(d: Drawing) -> Chapter | None:
    """Distance from the exact motion."""
    length = d.scale("length_scale_m")
    until = judged_until(d.variant.runs)
    own = max(
        (m for m in d.motions.values() if m.own_error is not None), key=lambda m: len(m.own_error or ()), default=None
    )
    floor = [] if own is None or own.own_error is None else [
        Trace("the reference's own error", own.own_error.t, own.own_error.y, dash=2)]  # fmt: skip
    plots = [
        d.log("position", "Position error", f"Worst body, {d.largest}, up to the reference's horizon.", "|r − r exact|",
              "m", _norm("position_error"), length, floor),
        d.log("orientation", "Orientation error", f"Worst body, {d.largest}, up to the reference's horizon.",
              "∠(R, R exact)", "rad", _norm("orientation_error"), 1.0),
        d.log("plane", "Out of the plane", "Worst body's distance from the plane that the exact motion stays in.",
              "distance", "m", _norm("out_of_plane"), length),
    ]  # fmt: skip
    note = "How far from the exact motion."
    if until is not None:
        note += (
            f" Errors are judged up to {time(until)} s (dotted line); beyond, the motion is chaotic: nobody can follow."
        )
        plots = [None if p is None else _marked(p, until) for p in plots]
    return _chapter("Errors against the reference", note, plots)


def observables(d: Drawing) -> Chapter | None:
    """Each value with the reference, and the distance from it."""
    plots: list[Plot | None] = []
    for name in dict.fromkeys(n for m in d.motions.values() for n in m.observables):
        exact = max((m.exact[name] for m in d.motions.values() if name in m.exact), key=len, default=None)
        in_unit = unit(next(m.units.get(f"obs_{name}", "") for m in d.motions.values() if name in m.observables))
        of = _of("observables", name)
        low, high = _limits([c for c in d.curves(of) if c is not None and len(c)], exact)
        known = [] if exact is None else [Trace("reference", exact.t, exact.y)]
        caption = f"Smallest and largest of each span; {'the thin line is the' if known else 'there is no'} reference."
        own = traces(d.lines, d.motions, of, (2 * low - high, 2 * high - low))
        axis = Axis(name, in_unit, low=low, high=high)
        plots.append(Plot(f"obs-{name}", name, caption, d.axis, axis, [*own, *known]))
        plots.append(d.log(f"away-{name}", f"{name}: distance from the reference", f"Magnitude, {d.largest}.",
                           "|difference|", in_unit, _of("away", name), high - low))  # fmt: skip
    return _chapter("Observables", "What the problem asks to be watched.", plots)


def invariants(d: Drawing) -> Chapter | None:
    """Departure of each from its start."""
    plots = []
    for name in dict.fromkeys(n for m in d.motions.values() for n in m.invariants):
        in_unit = unit(next(m.units.get(f"inv_{name}", "") for m in d.motions.values() if name in m.invariants))
        starts = [abs(float(c.invariant_drifts.get(name, {}).get("start", 0.0))) for c in d.variant.runs]
        size = max((s for s in starts if 0.0 < s < float("inf")), default=1.0)
        caption = f"Departure from the start ({number(size)} {in_unit}), {d.largest}."
        plots.append(d.log(f"inv-{name}", name, caption, f"|{name} − start|", in_unit, _of("invariants", name), size))
    return _chapter("Invariants", "Quantities beside energy that the exact motion keeps.", plots)


def _chapter(title: str, note: str, plots: Sequence[Plot | None]) -> Chapter | None:
    there = tuple(p for p in plots if p is not None)
    return Chapter(title, note, there) if there else None


def _marked(plot: Plot, until: float) -> Plot:
    if plot.name == "plane":  # the plane needs no reference
        return plot
    return Plot(**{**vars(plot), "marks": {"judged up to here": [until]}})


def _norm(name: str) -> Callable[[Motion], Curve | None]:
    return lambda m: m.norms.get(name)


def _of(kind: str, name: str) -> Callable[[Motion], Curve | None]:
    return lambda m: getattr(m, kind).get(name)


def _limits(shown: Sequence[Curve], exact: Curve | None) -> tuple[float, float]:
    """All values; where one blew up, the neighbourhood of the reference."""
    values = [c.y for c in shown] + ([exact.y] if exact is not None else [])
    low, high = min((float(v.min()) for v in values), default=0.0), max((float(v.max()) for v in values), default=1.0)
    if exact is not None and len(exact):
        size = max(float(np.ptp(exact.y)), float(np.abs(exact.y).max()))
        if size > BLOWN_UP * (high - low):
            low, high = max(low, float(exact.y.min()) - size), min(high, float(exact.y.max()) + size)
    margin = 0.08 * (high - low) or 0.08 * abs(high) or 1.0
    return low - margin, high + margin
