"""The mechanism of the first page: two runs over each other, seen from the front, as plain data for a small canvas."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..model.results import Results, Run
from ..plots.palette import Look
from .animation.stage import flat, view_of
from .paths import longest, path_of
from .segments import mechanism_of

FRAMES = 300
WINDOW = 10.0  # [s] of the motion, at most: what is seen in its own time
STEPS = 4095  # of the box: a fifth of a pixel
ROOM = 0.06  # of the box on each side


def glimpse(results: Results, runs: Sequence[Run], looks: Mapping[str, Look]) -> dict[str, Any] | None:
    """Ends of all segments at even times, each the nearest stored pose; None where no run kept poses."""
    read = [(c, results.readable_series(c)) for c in runs]
    found = [(c, m) for c, s in read if (m := mechanism_of(s)) is not None]
    if not found:
        return None
    path = longest(path_of(s) for _, s in read)
    view = view_of(found[0][1])
    whole = max(float(m.t[-1]) for _, m in found)
    t = np.linspace(0.0, min(whole, WINDOW), FRAMES)
    lines = [flat(np.stack([m.segments(m.frame(now)) for now in t]), view) for _, m in found]
    ground = flat(found[0][1].ground, view)
    sound = np.concatenate([lines[0].reshape(-1, 2), ground])  # what flies apart may leave the picture
    low, high = sound.min(axis=0), sound.max(axis=0)
    size = float(np.max(high - low)) or 1.0
    low, high = low - ROOM * size, high + ROOM * size
    step = float(np.max(high - low)) / STEPS
    return {
        "t": float(t[-1]), "frames": FRAMES, "size": ((high - low) / step).tolist(),
        "ground": ((ground - low) / step).tolist(),
        "exact": path and {"name": path.name, "until": min(float(path.exact_t[-1]), float(t[-1])),
                           "path": _columns((flat(path.exact_at(t), view) - low) / step)},
        "players": [{
            "solver": c.record.solver, "colour": looks[c.record.solver].colour, "stopped": c.stopped,
            "last": float(m.t[-1]), "lines": _columns((xy - low) / step),
        } for (c, m), xy in zip(found, lines, strict=True)],
    }  # fmt: skip


def _columns(values: np.ndarray) -> np.ndarray:
    """Each coordinate over time, one after the other; up to four boxes away from this one."""
    return np.clip(np.rint(values.reshape(len(values), -1).T) + 4 * STEPS, 0, 65535).astype(np.int64).ravel()
