"""Pack what is only drawn in a series file: poses rounded to a grid, envelopes as codes, both as differences.

Differences are stored as byte planes, which compress well. Data by which a run is judged are packed without loss: times
are left out if sums of the steps give the same bits.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Int

from .envelopes import Envelope

Arrays = dict[str, np.ndarray]
DRAWN = ("frame", "exact")  # kinds of poses that are only drawn
GRID = 4e-4  # step of positions, as a fraction of the motion's length: a fifth of a pixel
TURNS = 2047  # steps of a quaternion's components from 0 to 1
FAR = 2**30  # [steps] from the origin: positions farther away are kept as float32
FINE = 6000  # equidistant times from which those of the exact motion are chosen
PACKED, ENVELOPE = "packed_", "env_"  # prefixes of members


def pack(arrays: Mapping[str, np.ndarray], envelopes: Mapping[str, Envelope], length: float) -> Arrays:
    """Return the members of a brief series file with these arrays and envelopes.

    Poses that are only drawn are rounded to a grid relative to ``length``, the length of the motion [m]. Times are left
    out where ``unpack`` finds the same bits: as sums of the steps, or as rows of a grid of times.
    """
    out, t = dict(arrays), arrays["t"]
    if np.array_equal(_sum_steps(out["t"][:1], out["dt"]), out["t"]):
        out["t"] = out["t"][:1]
    for kind in DRAWN:
        if f"{kind}_r" in out:
            out |= _pack_poses(kind, out.pop(f"{kind}_r"), out.pop(f"{kind}_q"), length)
            times = out[f"{kind}_t"]
            # times of frames are among those of the steps, times of the exact motion are equidistant
            grid = t if kind == "frame" else np.linspace(times[0], times[-1], FINE)
            rows = np.minimum(np.searchsorted(grid, times), len(grid) - 1)
            if np.array_equal(grid[rows], times):
                out[f"{kind}_t"] = times[[0, -1]]
                out[f"{PACKED}{kind}_rows"] = _pack_rows(rows.astype(np.int32))
    for name, e in envelopes.items():
        low, high = e.codes
        out[f"{ENVELOPE}{name}"] = _split_bytes(np.concatenate((np.diff(low, prepend=np.int32(0)), high - low)))
    if envelopes:
        some = next(iter(envelopes.values()))
        out["env"] = np.array([some.begin, some.end, *(e.base for e in envelopes.values())])
    return out


def unpack(members: Mapping[str, np.ndarray]) -> tuple[Arrays, dict[str, Envelope]]:
    """Return the arrays and envelopes in the members of a brief series file, which ``pack`` made.

    Members with poses may be missing, if they were not read. Raise ValueError if members are inconsistent.
    """
    out = {k: a for k, a in members.items() if not k.startswith((PACKED, ENVELOPE)) and k != "env"}
    if "t" in out and "dt" in out and len(out["t"]) == 1:
        out["t"] = _sum_steps(out["t"], out["dt"])
    for kind in DRAWN:
        if f"{PACKED}{kind}_q" in members:
            out |= _unpack_poses(kind, members)
        if f"{PACKED}{kind}_rows" in members:
            ends, packed = out[f"{kind}_t"], members[f"{PACKED}{kind}_rows"]
            grid = out["t"] if kind == "frame" else np.linspace(ends[0], ends[-1], FINE)
            rows = _unpack_rows(packed, (packed.size // 4,))
            if rows.min() < 0 or rows.max() >= len(grid):
                raise ValueError(f"{kind}_t refers to rows outside its {len(grid)} times")
            out[f"{kind}_t"] = grid[rows]
    names = [k for k in members if k.startswith(ENVELOPE)]
    about = members.get("env", np.zeros(2))
    if about.shape != (2 + len(names),) or about.dtype != float:
        raise ValueError(f"env must hold {2 + len(names)} float64 (got {about.dtype} of shape {about.shape})")
    begin, end, *bases = map(float, about)
    coded = {name: _unpack_codes(members[name]) for name in names}
    return out, {
        name.removeprefix(ENVELOPE): Envelope(begin, end, codes, base)
        for (name, codes), base in zip(coded.items(), bases, strict=True)
    }


def _unpack_codes(packed: np.ndarray) -> Int[np.ndarray, "2 spans"]:
    """Return the codes of an envelope's lower and upper bounds; raise ValueError for an odd number of values.

    Packed are the differences of successive lower bounds, then those of the upper from the lower bounds.
    """
    values = _join_bytes(packed)
    if len(values) % 2:
        raise ValueError(f"an envelope must hold an even number of values (got {len(values)})")
    low, apart = values.reshape(2, -1)
    low = np.cumsum(low, dtype=np.int32)
    return np.stack((low, low + apart))


def _sum_steps(start: np.ndarray, dt: np.ndarray) -> np.ndarray:
    """Return the times [s] of accepted steps: ``start``, of shape (1,), and its sums with the steps ``dt`` [s].

    The first of ``dt`` belongs to the start and does not count.
    """
    return np.cumsum(np.concatenate((start, dt[1:])))


def _pack_poses(kind: str, r: np.ndarray, q: np.ndarray, length: float) -> Arrays:
    """Return the members that hold the positions ``r`` (n, nb, 3) [m] and quaternions ``q`` (n, nb, 4) of a ``kind``.

    Positions are kept unrounded if any is too far or not finite, and NaN in ``q`` becomes 0. ``length`` is the length
    of the motion [m].
    """
    step = GRID * (length if length > 0.0 else 1.0)
    steps = np.rint(r.astype(float) / step)
    turned = np.rint(TURNS * _continue_signs(np.nan_to_num(q.astype(float))))
    out = {f"{PACKED}{kind}_q": _pack_rows(turned.astype(np.int32)), f"{PACKED}{kind}_shape": np.array(q.shape[:2])}
    if np.all(np.abs(steps) < FAR):
        return out | {f"{PACKED}{kind}_r": _pack_rows(steps.astype(np.int32)), f"{PACKED}{kind}_step": np.array(step)}
    return out | {f"{kind}_r": r}


def _continue_signs(q: np.ndarray) -> np.ndarray:
    """Return quaternions (n, nb, 4), each with the sign that brings it nearer to the one before.

    Both signs are the same rotation; without jumps the differences are small.
    """
    signs = np.where(np.sum(q[1:] * q[:-1], axis=-1) < 0.0, -1.0, 1.0)
    return np.concatenate((q[:1], q[1:] * np.cumprod(signs, axis=0)[..., None]))


def _unpack_poses(kind: str, members: Mapping[str, np.ndarray]) -> Arrays:
    """Return positions [m] and unit quaternions of a ``kind`` of pose in float32, by the names of their arrays.

    A zero quaternion becomes NaN, as it was before it was packed. Positions that were not packed are left out.
    """
    n, nb = map(int, members[f"{PACKED}{kind}_shape"])
    turned = _unpack_rows(members[f"{PACKED}{kind}_q"], (n, nb, 4)) / TURNS
    size = np.linalg.norm(turned, axis=2, keepdims=True)
    q = np.divide(turned, size, out=np.full_like(turned, np.nan), where=size > 0.0)
    out = {f"{kind}_q": q.astype(np.float32)}
    if f"{PACKED}{kind}_r" in members:
        r = _unpack_rows(members[f"{PACKED}{kind}_r"], (n, nb, 3)) * float(members[f"{PACKED}{kind}_step"])
        out[f"{kind}_r"] = r.astype(np.float32)
    return out


def _pack_rows(a: Int[np.ndarray, "n ..."]) -> np.ndarray:
    """Return the second differences of ``a`` along its first axis, column by column, as byte planes.

    They are small for a smooth motion, so that most bytes are zero.
    """
    flat = a.reshape(len(a), -1)
    zeros = np.zeros_like(flat[:1])
    return _split_bytes(np.diff(np.concatenate((zeros, zeros, flat)), n=2, axis=0).T.ravel())


def _unpack_rows(packed: np.ndarray, shape: tuple[int, ...]) -> Int[np.ndarray, "n ..."]:
    """Return the integers that ``_pack_rows`` packed, in this ``shape``; raise ValueError if their number differs."""
    values = _join_bytes(packed)
    if min(shape) < 1 or len(values) != np.prod(shape):
        raise ValueError(f"poses of shape {shape} cannot be unpacked from {len(values)} numbers")
    once = np.cumsum(values.reshape(-1, shape[0]), axis=1, dtype=np.int32)
    return np.cumsum(once, axis=1, dtype=np.int32).T.reshape(shape)


def _split_bytes(a: Int[np.ndarray, " n"]) -> np.ndarray:
    """Return the byte planes of integers: the lowest byte of each, then the second and so on, of shape (4, n) uint8.

    This makes equal bytes adjacent, which compresses well.
    """
    return np.ascontiguousarray(a.astype("<i4").view(np.uint8).reshape(-1, 4).T)


def _join_bytes(planes: np.ndarray) -> Int[np.ndarray, " n"]:
    """Return the integers in byte planes, undoing ``_split_bytes``; raise ValueError for another shape or type."""
    if planes.dtype != np.uint8 or planes.ndim != 2 or len(planes) != 4:
        raise ValueError(f"packed numbers must be uint8 of shape (4, n) (got {planes.dtype} of shape {planes.shape})")
    return np.ascontiguousarray(planes.T).view("<i4").ravel().astype(np.int32)
