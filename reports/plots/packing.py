"""Values as scripts that a page from a disk can load: strict JSON, or bundles of JSON and arrays, deflated.

A bundle is what ``MBS.unpack`` of ``assets/site.js`` takes apart: the length of its JSON in four bytes, the JSON, then
the bytes of its arrays; an array is ``{"kind", "at", "n"}`` there, with what it takes to undo its steps.
"""

import base64
import json
import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...harness.files import to_json

STEPS = 4095  # of a linear axis: 1/8190 of a curve's own range at most, a twentieth of a pixel
LOG_STEP = 0.002  # of a logarithmic one: a tenth of a percent of the value at most
MOST_STEPS = 65534  # 0 is for zeros


def bundle(name: str, value: Any) -> str:
    """A script that sets ``window.MBS[name]`` to the deflated bundle of ``value``; arrays or ``Steps`` as leaves."""
    parts = bytearray()
    head = text(_leaves(value, parts)).encode("utf-8")
    whole = len(head).to_bytes(4, "little") + head + parts
    return script(name, {"packed": base64.b64encode(zlib.compress(whole, 9)).decode("ascii")})


class Steps:
    """An array to be stored in steps of two bytes: even ones, or even in the logarithm, with zeros apart."""

    def __init__(self, values: np.ndarray, *, log: bool = False) -> None:
        self.values = np.asarray(values, dtype=float)
        self.log = log and bool(np.all(self.values >= 0.0))

    def counted(self) -> tuple[np.ndarray, dict[str, float]]:
        """Whole numbers below 65536, and how to undo them."""
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


def _leaves(value: Any, parts: bytearray) -> Any:
    """The value with its arrays put into ``parts``."""
    if isinstance(value, Steps):
        counts, undo = value.counted()
        return _stored(counts, parts) | undo if undo or not value.values.size else _stored(value.values, parts)
    if isinstance(value, np.ndarray):
        return _stored(value, parts)
    if isinstance(value, Mapping):
        return {str(k): _leaves(v, parts) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_leaves(v, parts) for v in value]
    return value


def _stored(array: np.ndarray, parts: bytearray) -> dict[str, Any]:
    """Floats as float32, counts as differences; low bytes before high ones, which deflates better."""
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


def script(name: str, value: Any) -> str:
    """A script that sets ``window.MBS[name]``."""
    return f"(window.MBS ||= {{}})[{json.dumps(name)}] = {text(value)};\n"


def text(value: Any) -> str:
    """Strict JSON, safe inside a script; NaN and infinities become null."""
    return to_json(value).replace("\u2028", "\\u2028").replace("\u2029", "\\u2029").replace("</", "<\\/")
