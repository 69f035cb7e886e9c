"""Moments to jump to: where a run stopped, singular passages and other events, the largest energy error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....harness.results.series import Series
from ...model.results import Run

EVENTS = 200  # of a run; the first ones; the page says that there are more


@dataclass(frozen=True)
class Mark:
    """A moment of the run at ``player`` in the cast; ``kind`` is ``stop``, ``event`` or ``whip``."""

    t: float
    kind: str
    player: int
    words: str


def marks_of(series: Series, run: Run, player: int) -> list[Mark]:
    """All of a run, in order of time."""
    out = [m for e in series.events[:EVENTS] if (m := _event(e, player)) is not None]
    t = series["t"]
    if "energy_error" in series:
        error = np.abs(np.where(np.isfinite(series["energy_error"]), series["energy_error"], 0.0))
        k = int(np.argmax(error))
        if error[k] > 0.0:
            out.append(Mark(float(t[k]), "whip", player, f"largest energy error, {series['energy_error'][k]:.3g} J"))
    if run.stopped:
        words = f"{run.status.replace('_', ' ')}: {'; '.join(run.reasons)}"[:400]
        out.append(Mark(float(t[-1]), "stop", player, words))
    return sorted(out, key=lambda m: m.t)


def _event(event: Mapping[str, Any], player: int) -> Mark | None:
    t = event.get("t")
    if not isinstance(t, (int, float)) or not math.isfinite(t):
        return None
    rest = [
        f"{k.replace('_', ' ')} {f'{v:.3g}' if isinstance(v, float) else v}"
        for k, v in event.items() if k not in ("t", "kind")
    ]  # fmt: skip
    return Mark(float(t), "event", player, ", ".join([str(event.get("kind", "event")), *rest])[:200])
