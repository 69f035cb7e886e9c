"""Write plots as plain data for a page (``assets/plots.js`` draws them), and data as scripts that load from a disk.

A bundle, decoded by ``MBS.unpack`` of ``assets/site.js``, holds the length of its JSON in four bytes, the JSON, and the
bytes of its arrays, all deflated; an array is ``{"kind", "at", "n"}`` there, with the values that undo its steps.
Points keep their numbers to seven digits. Curves over time, of which a report has thousands, are stored in steps: times
and values on linear axes to 1/8190 of their own range, values on logarithmic ones to a tenth of a percent.
"""

import base64
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...harness.base.files import to_json
from .spec import Axis, LineStyle, Plot, Trace

STEPS = 4095  # steps of a linear axis: errors are at most 1/8190 of a curve's range, a twentieth of a pixel
LOG_STEP = 0.002  # step of a logarithmic axis: errors are at most a tenth of a percent
MOST_STEPS = 65534  # 0 is reserved for zeros


def format_bundle(name: str, value: Any) -> str:
    """Return a script that sets ``window.MBS[name]`` to the deflated bundle of ``value``.

    Leaves of ``value`` may be arrays or ``Steps``.
    """
    parts = bytearray()
    head = format_json(_pack_leaves(value, parts)).encode("utf-8")
    whole = len(head).to_bytes(4, "little") + head + parts
    return format_script(name, {"packed": base64.b64encode(zlib.compress(whole, 6)).decode("ascii")})


class Steps:
    """An array to be stored as whole numbers of equal steps, in two bytes each, with zeros kept exactly.

    With ``log`` the steps are of the logarithms, unless a value is negative.
    """

    def __init__(self, values: np.ndarray, *, log: bool = False) -> None:
        self.values = np.asarray(values, dtype=float)
        self.log = log and bool(np.all(self.values >= 0.0))

    def count_steps(self) -> tuple[np.ndarray, dict[str, float]]:
        """Return each value as a whole number of steps below 65536, and by name the numbers that restore the values.

        These are ``step`` with ``low`` or, for steps of the logarithm, ``log``. Both results are empty if a value is
        not finite or there is none: such arrays are stored as they are.
        """
        v = self.values
        if not v.size or not np.all(np.isfinite(v)):
            return np.zeros(0, dtype=np.int64), {}
        if not self.log:
            low, step = float(v.min()), float(np.ptp(v)) / STEPS
            counts = np.rint((v - low) / step) if step > 0.0 else np.zeros(len(v))
            return counts.astype(np.int64), {"low": low, "step": step}
        above = v[v > 0.0]
        if not above.size:
            return np.zeros(len(v), dtype=np.int64), {"log": 0.0, "step": LOG_STEP}
        low = math.log(float(above.min()))
        step = max(LOG_STEP, (math.log(float(above.max())) - low) / (MOST_STEPS - 1))
        counts = np.rint((np.log(np.where(v > 0.0, v, 1.0)) - low) / step) + 1
        return np.where(v > 0.0, counts, 0).astype(np.int64), {"log": low, "step": step}


def _pack_leaves(value: Any, parts: bytearray) -> Any:
    """Return nested data with each array replaced by its description; the array's bytes are appended to ``parts``."""
    if isinstance(value, Steps):
        counts, undo = value.count_steps()
        packed = undo or not value.values.size
        return _store_array(counts, parts) | undo if packed else _store_array(value.values, parts)
    if isinstance(value, np.ndarray):
        return _store_array(value, parts)
    if isinstance(value, Mapping):
        return {str(k): _pack_leaves(v, parts) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_pack_leaves(v, parts) for v in value]
    return value


def _store_array(array: np.ndarray, parts: bytearray) -> dict[str, Any]:
    """Append the bytes of an array to ``parts``; return its ``kind``, its offset ``at`` and its length ``n``.

    Floats become float32, counts up to 65535 differences of uint16, other counts int32. First come the lowest bytes of
    all elements, then the next ones, which deflates better.
    """
    if array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            kind, plain = "f4", array.astype("<f4")
    elif array.size and (array.min() < 0 or array.max() > 65535):
        kind, plain = "i4", array.astype("<i4")
    else:
        kind, plain = "u2", np.diff(array.astype("<u2"), prepend=np.uint16(0)).astype("<u2")  # modulo 2^16
    width = plain.dtype.itemsize
    planes = np.frombuffer(np.ascontiguousarray(plain).tobytes(), np.uint8).reshape(-1, width).T.tobytes()
    at = len(parts)
    parts.extend(planes)
    return {"kind": kind, "at": at, "n": len(plain)}


def format_script(name: str, value: Any) -> str:
    """Return a script that sets ``window.MBS[name]`` to ``value``, as JSON."""
    return f"(window.MBS ||= {{}})[{json.dumps(name)}] = {format_json(value)};\n"


def format_json(value: Any) -> str:
    """Return ``value`` as strict JSON that is safe inside a script; NaN and infinities become null."""
    return to_json(value).replace("\u2028", "\\u2028").replace("\u2029", "\\u2029").replace("</", "<\\/")


def shorten_plots(plots: Sequence[Plot], looks: Mapping[str, LineStyle]) -> dict[str, Any]:
    """Return the plots as ``assets/plots.js`` reads them: short names, no default values, and repeated texts numbered.

    ``looks`` gives the colour and marker of each solver.
    """
    texts: dict[str, int] = {}
    found = {
        p.name: {
            "title": p.finding or p.title,
            "x": _list_axis_fields(p.x),
            "y": _list_axis_fields(p.y),
            "traces": [_list_trace_fields(t, looks, p, texts) for t in p.traces],
            "marks": {k: list(v) for k, v in p.marks.items()},
            "focus": list(p.focus),
            **({"triangles": [vars(t) for t in p.triangles]} if p.triangles else {}),
            "name": p.title,
        }
        for p in plots
    }
    return {"texts": list(texts), "plots": found}


def _list_axis_fields(axis: Axis) -> dict[str, Any]:
    """Return the fields of an axis that are set, without its symbol for print."""
    return {k: v for k, v in vars(axis).items() if v == v and v not in ("", ()) and v is not False and k != "symbol"}


def _list_trace_fields(
    trace: Trace, looks: Mapping[str, LineStyle], plot: Plot, texts: dict[str, int]
) -> dict[str, Any]:
    """Return the fields of a trace that are set, with texts as their numbers in ``texts``, to which new ones are added.

    Curves of a plot whose time axis is linked to others are stored in steps.
    """
    rough = bool(plot.x.link)
    out: dict[str, Any] = {"name": trace.name}
    for key, axis in (
        ("x", plot.x),
        ("left", plot.x),
        ("right", plot.x),
        ("y", plot.y),
        ("low", plot.y),
        ("high", plot.y),
    ):
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
