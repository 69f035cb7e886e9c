"""Values as scripts that a page from a disk can load: strict JSON, arrays in base64."""

import base64
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def script(name: str, value: Any) -> str:
    """A script that sets ``window.MBS[name]``."""
    return f"(window.MBS ||= {{}})[{json.dumps(name)}] = {text(value)};\n"


def text(value: Any) -> str:
    """Strict JSON of numbers, texts, lists, mappings and arrays; a number that is none is null."""
    shown = json.dumps(_plain(value), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return shown.replace("\u2028", "\\u2028").replace("\u2029", "\\u2029").replace("</", "<\\/")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return packed(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value


def in_steps(array: np.ndarray) -> dict[str, Any]:
    """Values from zero up, each to 1/65535 of the largest, in two bytes: enough for where a point is drawn."""
    largest = float(array.max()) if array.size else 0.0
    if not largest > 0.0 or array.min() < 0.0:
        return packed(array)
    scale = largest / 65535
    return {**packed(np.round(array / scale).astype(np.int64)), "scale": scale}


def packed(array: np.ndarray) -> dict[str, str]:
    """Floats as float32, whole numbers in few bytes: ``{"dtype": "f4", "bdata": ...}``, as the plots read it."""
    if array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            kind, array = "f4", array.astype("<f4")
    elif array.dtype.kind in "iu" and array.size and array.min() >= 0 and array.max() < 65536:
        kind, array = "u2", array.astype("<u2")
    else:
        kind, array = "i4", array.astype("<i4")
    return {"dtype": kind, "bdata": base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")}
