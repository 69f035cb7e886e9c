"""Plots as plain data for a page; ``assets/plots.js`` draws them.

Points keep their numbers to seven digits. Curves over time, of which a report has thousands, are stored in steps: times
and values on linear axes to 1/8190 of their own range, values on logarithmic ones to a tenth of a percent.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .packing import Steps
from .palette import Look
from .spec import Axis, Plot, Trace


def for_browser(plots: Sequence[Plot], looks: Mapping[str, Look]) -> dict[str, Any]:
    """Short names, nothing that is a default; texts that come again and again by their number."""
    texts: dict[str, int] = {}
    found = {p.name: {"title": p.title, "x": _axis(p.x), "y": _axis(p.y),
                      "traces": [_trace(t, looks, p, texts) for t in p.traces],
                      "marks": {k: list(v) for k, v in p.marks.items()}} for p in plots}  # fmt: skip
    return {"texts": list(texts), "plots": found}


def _axis(axis: Axis) -> dict[str, Any]:
    return {k: v for k, v in vars(axis).items() if v == v and v != "" and v is not False and k != "symbol"}


def _trace(trace: Trace, looks: Mapping[str, Look], plot: Plot, texts: dict[str, int]) -> dict[str, Any]:
    rough = bool(plot.x.link)
    out: dict[str, Any] = {"name": trace.name}
    for key, axis in (("x", plot.x), ("left", plot.x), ("right", plot.x),
                      ("y", plot.y), ("low", plot.y), ("high", plot.y)):  # fmt: skip
        values = getattr(trace, key)
        if values is not None:
            out[key] = Steps(values, log=axis.log) if rough else np.asarray(values)
    for key in ("mode", "solver", "dash", "group", "end", "hollow", "reach"):
        if (value := getattr(trace, key)) and value != "lines":
            out[key] = value
    for key in ("ends", "urls", "words"):
        if any(getattr(trace, key)):
            out[key] = np.array([texts.setdefault(t, len(texts)) for t in getattr(trace, key)])
    if not trace.main:
        out["main"] = False
    if trace.solver in looks:
        out |= {"colour": looks[trace.solver].colour, "marker": looks[trace.solver].marker}
    return out
