"""Strips beside the mechanism over time: errors, |phi|, |phi_dot| and step size, and moments to jump to."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ....harness.results.series import Series
from ...model.results import Run

EVENTS = 200  # of a run; the first ones; the page says that there are more
SPANS = 1200  # a strip is about 500 pixels wide, and can be stretched
STRIPS: Sequence[Mapping[str, Any]] = (  # ``signed``: it has a sign, ``both``: its smallest values matter too
    {"name": "energy_error", "symbol": "E − E₀", "unit": "J", "signed": True, "both": True},
    {"name": "position_error", "symbol": "|r − r exact|", "unit": "m", "signed": False, "both": False},
    {"name": "phi_norm", "symbol": "|φ|", "unit": "m", "signed": False, "both": False},
    {"name": "phi_dot_norm", "symbol": "|φ̇|", "unit": "m/s", "signed": False, "both": False},
    {"name": "dt", "symbol": "step", "unit": "s", "signed": False, "both": True},
)


def marks_of(series: Series, run: Run, player: int) -> list[dict[str, Any]]:
    """Moments of the run at ``player`` in the cast, in order of time: its ``stop``, ``event``s and ``whip``."""
    t, out = series["t"], []
    for event in series.events[:EVENTS]:
        at = event.get("t")
        if isinstance(at, int | float) and math.isfinite(at):
            rest = [f"{k.replace('_', ' ')} {v:.3g}" if isinstance(v, float) else f"{k.replace('_', ' ')} {v}"
                    for k, v in event.items() if k not in ("t", "kind")]  # fmt: skip
            out.append((float(at), "event", ", ".join([str(event.get("kind", "event")), *rest])[:200]))
    if "energy_error" in series:
        error = np.abs(np.where(np.isfinite(series["energy_error"]), series["energy_error"], 0.0))
        k = int(np.argmax(error))
        if error[k] > 0.0:
            out.append((float(t[k]), "whip", f"largest energy error, {series['energy_error'][k]:.3g} J"))
    if run.stopped:
        out.append((float(t[-1]), "stop", f"{run.status.replace('_', ' ')}: {'; '.join(run.reasons)}"[:400]))
    return [{"t": at, "kind": kind, "player": player, "words": words}
            for at, kind, words in sorted(out, key=lambda m: m[0])]  # fmt: skip


def strip(
    t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], t_end: float, spans: int = SPANS
) -> Float[np.ndarray, "2 spans"]:
    """Smallest and largest value in each of ``spans`` equal spans of [0, t_end]; NaN in a span without a number."""
    low, high = np.full(spans, np.nan), np.full(spans, np.nan)
    good = np.isfinite(t) & np.isfinite(a)
    k = np.clip(np.asarray(t[good] / t_end * spans), 0, spans - 1).astype(int)
    np.fmin.at(low, k, a[good])
    np.fmax.at(high, k, a[good])
    return np.stack((low, high))


def select_known(series: Sequence[Series]) -> list[Mapping[str, Any]]:
    """Those that some run has a number for: without a reference there is no error."""
    return [s for s in STRIPS if any(s["name"] in own and np.isfinite(own[s["name"]]).any() for own in series)]


def strips_of(series: Series, run: Run, t_end: float, spans: int = SPANS, kinds: Sequence[Mapping[str, Any]] = STRIPS
              ) -> Float[np.ndarray, "n spans"]:  # fmt: skip
    """Strips of a run in the order of ``kinds``: smallest values, where they matter, and largest ones."""
    t, out = series["t"], []
    for kind in kinds:
        name = kind["name"]
        a = series[name] if name in series else np.full(len(t), np.nan)
        if name == "dt" and len(a) > 2 and not run.stopped:
            a = a[:-1]  # cut to end at t_end; of a failure it is the point
        low_high = strip(t[: len(a)], a, t_end, spans)
        out += list(low_high) if kind["both"] else [low_high[1]]
    return np.stack(out)
