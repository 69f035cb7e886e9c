"""The series file of a run: NPZ, no pickle. Scalars over accepted steps or their envelopes, poses thinned for drawing.

A file of every step has schema 1; one that keeps envelopes and packs what is drawn has schema 2. Written once by the
run's process, read by reports; its digest is in the run's record.
"""

import hashlib
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from ..files import FileError, parse_json, to_json
from ..places import Place, place_of
from ..shapes import Shape, convert_shape
from .envelopes import Envelope
from .npz import read_npz, write_npz
from .packing import PACKED, pack, unpack

PLAIN: Literal[1] = 1  # schemas
BRIEF: Literal[2] = 2
KIND: Literal["mbsbench series"] = "mbsbench series"
LARGEST = 2**28  # [bytes] of a file, and of its arrays: ten times the longest
MARKS = "period_marks"  # [s] ends of the periods of a long motion
LAST = "last_"  # the last rows of a series that is kept as an envelope
POSES = ("frame", "exact", "state", "sample")  # along times of their own
BUNDLED = ("bundled_states", "bundled_samples", "bundled_between")  # which states of a brief file a bundle takes
TOGETHER = (  # series of which a file has all or none
    {"exact_t", "exact_r", "exact_q"},
    {"frame_t", "frame_r", "frame_q"},
)  # fmt: skip
OTHER = ("end_", "start_", "joint_", "gravity", "system_", LAST, MARKS, "bundled_")  # not along time
NAMED = 8  # series in a line


class Enveloped(FileError):
    """Every step of a series is asked for that is kept as an envelope."""


@dataclass(frozen=True, repr=False)
class Series:
    """The arrays of one series file by name, as listed in ``docs/results-format.md``; all read-only.

    A series is kept at the rows ``t`` in ``arrays``, or as one of the ``envelopes``; ``points`` draws either.
    """

    arrays: Mapping[str, np.ndarray]
    events: tuple[Mapping[str, Any], ...]
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: Mapping[str, str]  # of obs_, ref_ and inv_ series, by full name
    symbols: Mapping[str, str]  # mathtext without $, of obs_ series, by full name
    peaks: Mapping[str, float] = field(default_factory=dict)  # [s] when reported maxima occurred, by column
    reference: str = ""  # where it comes from: ``harness.reference.computation.Source``
    envelopes: Mapping[str, Envelope] = field(default_factory=dict)
    steps_sha256: str = ""  # of all accepted steps, whether kept or not; empty in older files
    length: float = math.nan  # [m] of the motion, where what is drawn is packed

    def __repr__(self) -> str:
        t, inner = self.arrays.get("t", np.zeros(0)), ("diag_", *POSES, *OTHER)
        names = sorted({*self.arrays, *self.envelopes} - {"t"}, key=lambda k: (k.startswith(inner), k))
        until = f" to {t[-1]:.6g} s" if len(t) else ""
        more = f" and {len(names) - NAMED} more, which .names('') has" if names[NAMED:] else ""
        return f"<Series of {len(t)} times{until}: {', '.join(names[:NAMED]) or 'nothing'}{more}>"

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self.envelopes:
            raise Enveloped(
                f"{name} is kept as an envelope: ask for its points, or run again with --lossless for all its steps"
            )
        return self._rows(name)

    def _rows(self, name: str) -> np.ndarray:
        if name not in self.arrays:
            raise FileError(f"a series file lacks {name}, which every run writes")
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays or name in self.envelopes

    @property
    def is_brief(self) -> bool:
        """Whether states, poses and series that nothing judges are kept as far as they are drawn."""
        return self.length == self.length

    def get(self, name: str) -> np.ndarray | None:
        """The series at its rows, None if there is none; Enveloped where rows are not kept."""
        if name in self.envelopes:
            return self[name]
        return self.arrays.get(name)

    def points(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Times and values to draw: every row, or the least and the largest value of each span."""
        return self.envelopes[name].points if name in self.envelopes else (self.arrays["t"], self._rows(name))

    def tail(self, name: str, rows: int) -> np.ndarray:
        """The last ``rows`` values, or as many as are kept."""
        kept = self.arrays.get(LAST + name, np.zeros(0)) if name in self.envelopes else self._rows(name)
        return kept[-rows:]

    def names(self, prefix: str) -> list[str]:
        """What follows ``prefix`` in the names of all series that begin with it."""
        return [k[len(prefix) :] for k in (*self.arrays, *self.envelopes) if k.startswith(prefix)]

    def select(self, prefix: str) -> dict[str, np.ndarray]:
        """All series whose name starts with ``prefix`` (``"obs_"``), by the rest of it."""
        return {k[len(prefix) :]: a for k, a in self.arrays.items() if k.startswith(prefix)}


class Head(Shape, frozen=True):
    """The member ``meta`` of a series file, as JSON."""

    events: tuple[dict[str, Any], ...]
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    symbols: dict[str, str]
    peaks: dict[str, float] = msgspec.field(default_factory=dict)
    reference: str = ""
    steps_sha256: str = ""
    length: float | None = None  # [m]
    kind: Literal["mbsbench series"] = KIND
    schema: Literal[1, 2] = 1


def write_series(path: Path | Place, series: Series) -> str:
    """Write whole or not at all; returns the sha256 of the file."""
    events = tuple(map(dict, series.events))
    names = (series.body_names, series.joint_names, dict(series.units), dict(series.symbols))
    about = (dict(series.peaks), series.reference, series.steps_sha256)
    if series.is_brief:
        head = Head(events, *names, *about, series.length, schema=BRIEF)
        arrays = pack(series.arrays, series.envelopes, series.length)
    else:
        head, arrays = Head(events, *names, *about, schema=PLAIN), dict(series.arrays)
    return write_npz(path, {"meta": np.asarray(to_json(head)), **arrays}, solid=series.is_brief)


def read_series(path: Path | Place, sha256: str = "", *, poses: bool = True) -> Series:
    """The series in ``path``, or FileError; with ``sha256``, only if the file is the one that was recorded.

    Without ``poses`` those of the run and of the exact motion, most of a file, stay packed.
    """
    head, arrays, envelopes = _read(path, sha256, lambda name: poses or not name.removeprefix(PACKED).startswith(POSES))
    for array in arrays.values():
        array.setflags(write=False)
    names = (head.body_names, head.joint_names, head.units, head.symbols)
    length = math.nan if head.length is None else head.length
    return Series(arrays, head.events, *names, head.peaks, head.reference, envelopes, head.steps_sha256, length)


def name_file(run_id: str, *, brief: bool) -> str:
    """The file of a run's series in a results folder."""
    return f"series/{run_id}.npz{'.xz' if brief else ''}"


def check_series(path: Path | Place, sha256: str) -> None:
    """FileError if it is not the recorded file; one whose digest was not recorded must be whole and of this schema."""
    if sha256:
        _read_content(path, sha256)
    else:
        _read(path, sha256, "meta".__eq__)


def _read_content(path: Path | Place, sha256: str) -> bytes:
    try:
        content = place_of(path).read(LARGEST)
    except OSError as error:
        raise FileError(f"cannot read: {error.strerror or error}") from None
    if sha256 and hashlib.sha256(content).hexdigest() != sha256:
        raise FileError("not the file that was recorded (truncated or changed)")
    return content


def _read(
    path: Path | Place, sha256: str, wanted: Callable[[str], bool]
) -> tuple[Head, dict[str, np.ndarray], dict[str, Envelope]]:
    """The head of the file, the arrays that are ``wanted`` and envelopes, or FileError."""
    content = _read_content(path, sha256)
    try:
        arrays = read_npz(content, LARGEST, wanted)
        head = convert_shape(parse_json(str(arrays.pop("meta", "")), "meta"), Head, "meta")
        arrays, envelopes = unpack(arrays) if head.schema == BRIEF else (arrays, {})
        _check_lengths(arrays)
        _check_content(arrays, {*arrays, *envelopes})
    except (ValueError, TypeError, IndexError, KeyError, OverflowError) as error:  # arrays of other types and shapes
        why = " ".join(str(error).split())
        raise FileError(f"not a whole series file of schema {PLAIN} or {BRIEF}: {why}") from None
    return head, arrays, envelopes


def _check_content(arrays: Mapping[str, np.ndarray], names: Collection[str]) -> None:
    """Numbers along times that go forward, and all of what is written together; ValueError else."""
    for name, a in arrays.items():
        if a.dtype.kind not in "biuf" and not name.startswith(OTHER):
            raise ValueError(f"{name} holds {a.dtype}, not numbers")
        is_time = name == "t" or (name.endswith("_t") and name.removesuffix("_t") in POSES)
        if is_time and not (np.all(np.isfinite(a)) and np.all(np.diff(a) >= 0.0)):
            raise ValueError(f"{name} does not go forward")
    for group in TOGETHER:
        if missing := [name for name in group if name not in names] if not group.isdisjoint(names) else []:
            raise ValueError(f"{', '.join(sorted(missing))}: missing, beside {min(group & set(names))}")


def _check_lengths(arrays: Mapping[str, np.ndarray]) -> None:
    """One value a row in all series, one pose a frame; ValueError else."""
    for name, a in arrays.items():
        lead = next((f"{kind}_t" for kind in POSES if name.startswith(f"{kind}_")), "t")
        if name.startswith(OTHER):
            continue
        if lead not in arrays or a.shape[:1] != arrays[lead].shape or (lead == "t" and a.ndim != 1):
            rows = arrays[lead].shape if lead in arrays else "no shape"
            raise ValueError(f"{name} has the shape {a.shape}, {lead} has {rows}")
