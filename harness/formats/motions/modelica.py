"""Read results of Modelica tools (Dymola, OpenModelica) from a MAT file: variables with their values over time."""

import re
from collections.abc import Mapping

import numpy as np

SPELT = {"r_0": "r", "v_0": "v", "w_a": "omega", "Q": "q"}  # our names of vectors in Modelica.Mechanics.MultiBody
VECTOR = re.compile(r"^(.*?)\.?\b(r_0|v_0|w_a|Q)\[(\d)\]$")


def is_modelica_result(found: Mapping[str, np.ndarray]) -> bool:
    """Return whether the arrays of a MAT file are a result of a Modelica tool."""
    return {"Aclass", "name", "dataInfo"} <= {*found}


def read_modelica_result(found: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return columns (nt,) by name, with ``body.r_0[1]`` as ``body.r.x``; parameters are repeated in all rows.

    ``found`` are the arrays of the MAT file. Raise ValueError for an unknown layout.
    """
    layout = [str(x).strip() for x in np.atleast_1d(found["Aclass"])]
    if len(layout) < 4 or layout[0] != "Atrajectory" or layout[3] not in ("binTrans", "binNormal"):
        raise ValueError(f"not a result of Modelica that is known here (Aclass {', '.join(layout)})")
    transposed = layout[3] == "binTrans"
    chars, info = [str(x) for x in np.atleast_1d(found["name"])], np.atleast_2d(found["dataInfo"])
    if transposed:
        width = max(map(len, chars))
        chars = ["".join(row) for row in zip(*(x.ljust(width) for x in chars), strict=True)]
    info = info.T if transposed else info
    out: dict[str, np.ndarray] = {}
    for name, (table, signed_row, *_) in zip((x.strip() for x in chars), info, strict=False):
        rows = np.atleast_2d(found[f"data_{int(table) or 2}"])
        rows = rows if transposed else rows.T
        # a negative index is that of an alias with the opposite sign
        values = np.sign(int(signed_row)) * rows[abs(int(signed_row)) - 1].astype(float)
        out[_convert_name(name)] = values
    nt = max(map(len, out.values()), default=0)
    return {name: a if len(a) == nt else np.full(nt, a[0]) for name, a in out.items() if len(a) in (1, 2, nt)}


def _convert_name(name: str) -> str:
    """Return a variable's name with the vectors of Modelica's bodies spelt as ours: ``body.r_0[1]`` is ``body.r.x``."""
    match = VECTOR.match(name)
    if match is None:
        return name
    where, what, k = match[1], SPELT[match[2]], int(match[3])
    return ".".join(filter(None, (where, what, str(k) if what == "q" else "xyz"[k - 1] if k < 4 else str(k))))
