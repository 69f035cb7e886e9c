"""Read and write a run's series file (NPZ, no pickle): scalars at accepted steps or as envelopes, and thinned poses.

A plain file, with every step, has schema 1. A brief file, of schema 2, has envelopes of most scalars and packs what is
only drawn. The file is written once, by the run's process, and read by reports; its digest is in the run's record.
"""

import hashlib
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from ..base.confined_paths import ConfinedPath, confine_path
from ..base.files import FileError, parse_json, to_json
from ..base.shapes import Shape, convert_shape
from .envelopes import Envelope
from .npz import read_npz, write_npz
from .packing import PACKED, pack, unpack

PLAIN: Literal[1] = 1  # schema of a file with every step
BRIEF: Literal[2] = 2  # schema of a brief file
KIND: Literal["mbsbench series"] = "mbsbench series"
LARGEST = 2**28  # [bytes] of a file, and of its arrays: ten times the largest one
MARKS = "period_marks"  # [s] ends of the periods of a long motion
LAST = "last_"  # prefix of the last rows of a series that is kept as an envelope
POSES = ("frame", "exact", "state", "sample")  # arrays along their own times
BUNDLED = ("bundled_states", "bundled_samples", "bundled_between")  # states of a brief file that a bundle takes
TOGETHER = (  # groups of series that a file has completely or not at all
    {"exact_t", "exact_r", "exact_q"},
    {"frame_t", "frame_r", "frame_q"},
)
OTHER = ("end_", "start_", "joint_", "gravity", "system_", LAST, MARKS, "bundled_")  # arrays not along time
NAMED = 8  # most series named in the line of ``repr``


class EnvelopedSeries(FileError):
    """Signal that every step of a series was requested, of which the file holds only an envelope."""


@dataclass(frozen=True, repr=False)
class Series:
    """The arrays of one series file by name, as listed in ``docs/results-format.md``; all are read-only.

    A series is kept at the rows ``t`` in ``arrays``, or as one of the ``envelopes``; ``points`` draws either.
    """

    arrays: Mapping[str, np.ndarray]
    events: tuple[Mapping[str, Any], ...]
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: Mapping[str, str]  # units of obs_, ref_ and inv_ series, by full name
    symbols: Mapping[str, str]  # symbols of obs_ series in mathtext without $, by full name
    peaks: Mapping[str, float] = field(default_factory=dict)  # times of reported maxima [s], by column
    reference: str = ""  # its source: ``harness.reference.computation.Source``
    envelopes: Mapping[str, Envelope] = field(default_factory=dict)
    steps_sha256: str = ""  # digest of all accepted steps, kept or not; empty in older files
    length: float = math.nan  # length of the motion [m], if the file is packed; else NaN

    def __repr__(self) -> str:
        t, inner = self.arrays.get("t", np.zeros(0)), ("diag_", *POSES, *OTHER)
        names = sorted({*self.arrays, *self.envelopes} - {"t"}, key=lambda k: (k.startswith(inner), k))
        until = f" to {t[-1]:.6g} s" if len(t) else ""
        more = f" and {len(names) - NAMED} more, which .names('') has" if names[NAMED:] else ""
        return f"<Series of {len(t)} times{until}: {', '.join(names[:NAMED]) or 'nothing'}{more}>"

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the series at its rows; raise EnvelopedSeries if it is an envelope, FileError if it is missing."""
        if name in self.envelopes:
            raise EnvelopedSeries(
                f"{name} is stored as an envelope: read it with .points, or run again with --lossless for all its steps"
            )
        return self._rows(name)

    def _rows(self, name: str) -> np.ndarray:
        """Return the array of that name; raise FileError if there is none."""
        if name not in self.arrays:
            raise FileError(f"a series file lacks {name}, which every run writes")
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays or name in self.envelopes

    @property
    def is_brief(self) -> bool:
        """True for a brief file, which keeps states, poses and scalars only as far as judging and drawing need them."""
        return self.length == self.length

    def get(self, name: str) -> np.ndarray | None:
        """Return the series at its rows, None if there is none; raise EnvelopedSeries if it is an envelope."""
        if name in self.envelopes:
            return self[name]
        return self.arrays.get(name)

    def points(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and values to draw: every row or, for an envelope, both bounds of each span at one time."""
        return self.envelopes[name].points if name in self.envelopes else (self.arrays["t"], self._rows(name))

    def tail(self, name: str, rows: int) -> np.ndarray:
        """Return the last ``rows`` values of a series, or as many as are stored.

        An envelope has the last values beside it only if its run failed; otherwise none are returned.
        """
        kept = self.arrays.get(LAST + name, np.zeros(0)) if name in self.envelopes else self._rows(name)
        return kept[-rows:]

    def names(self, prefix: str) -> list[str]:
        """Return the names of all series that begin with ``prefix``, with the prefix removed."""
        return [k[len(prefix) :] for k in (*self.arrays, *self.envelopes) if k.startswith(prefix)]

    def select(self, prefix: str) -> dict[str, np.ndarray]:
        """Return the series whose names begin with ``prefix``, such as ``obs_``, by name without it; no envelopes."""
        return {k[len(prefix) :]: a for k, a in self.arrays.items() if k.startswith(prefix)}


class SeriesHeader(Shape, frozen=True):
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


def write_series(path: Path | ConfinedPath, series: Series) -> str:
    """Write a series file atomically, packed if the series is brief; return the sha256 of the file."""
    events = tuple(map(dict, series.events))
    names = (series.body_names, series.joint_names, dict(series.units), dict(series.symbols))
    about = (dict(series.peaks), series.reference, series.steps_sha256)
    if series.is_brief:
        head = SeriesHeader(events, *names, *about, series.length, schema=BRIEF)
        arrays = pack(series.arrays, series.envelopes, series.length)
    else:
        head, arrays = SeriesHeader(events, *names, *about, schema=PLAIN), dict(series.arrays)
    return write_npz(path, {"meta": np.asarray(to_json(head)), **arrays}, solid=series.is_brief)


def read_series(path: Path | ConfinedPath, sha256: str = "", *, poses: bool = True) -> Series:
    """Read a series file; raise FileError if it is invalid or does not have the digest ``sha256``, if given.

    Without ``poses``, those of the run and of the exact motion, which are most of a file, are not read.
    """
    head, arrays, envelopes = _read(path, sha256, lambda name: poses or not name.removeprefix(PACKED).startswith(POSES))
    for array in arrays.values():
        array.setflags(write=False)
    names = (head.body_names, head.joint_names, head.units, head.symbols)
    length = math.nan if head.length is None else head.length
    return Series(arrays, head.events, *names, head.peaks, head.reference, envelopes, head.steps_sha256, length)


def name_series_file(run_id: str, *, brief: bool) -> str:
    """Return the path of a run's series file, relative to its results folder; that of a brief file ends in ``.xz``."""
    return f"series/{run_id}.npz{'.xz' if brief else ''}"


def check_series(path: Path | ConfinedPath, sha256: str) -> None:
    """Raise FileError unless a series file has the digest ``sha256``.

    If that is empty, the file must be complete and of a known schema instead.
    """
    if sha256:
        _read_content(path, sha256)
    else:
        _read(path, sha256, "meta".__eq__)


def _read_content(path: Path | ConfinedPath, sha256: str) -> bytes:
    """Return the bytes of a series file; raise FileError if it cannot be read or does not have a given digest."""
    try:
        content = confine_path(path).read(LARGEST)
    except OSError as error:
        raise FileError(f"cannot read: {error.strerror or error}") from None
    if sha256 and hashlib.sha256(content).hexdigest() != sha256:
        raise FileError("not the file that was recorded (truncated or changed)")
    return content


def _read(
    path: Path | ConfinedPath, sha256: str, is_wanted: Callable[[str], bool]
) -> tuple[SeriesHeader, dict[str, np.ndarray], dict[str, Envelope]]:
    """Return the header of the file, the arrays for whose names ``is_wanted`` returns True, and the envelopes.

    Raise FileError if the file is invalid, or does not have the digest ``sha256`` unless that is empty.
    """
    content = _read_content(path, sha256)
    try:
        arrays = read_npz(content, LARGEST, is_wanted)
        head = convert_shape(parse_json(str(arrays.pop("meta", "")), "meta"), SeriesHeader, "meta")
        arrays, envelopes = unpack(arrays) if head.schema == BRIEF else (arrays, {})
        _check_lengths(arrays)
        _check_content(arrays, {*arrays, *envelopes})
    # raised for arrays of unexpected types and shapes
    except (ValueError, TypeError, IndexError, KeyError, OverflowError) as error:
        why = " ".join(str(error).split())
        raise FileError(f"not a whole series file of schema {PLAIN} or {BRIEF}: {why}") from None
    return head, arrays, envelopes


def _check_content(arrays: Mapping[str, np.ndarray], names: Collection[str]) -> None:
    """Raise ValueError unless times do not decrease, values are numbers, and groups of series are complete.

    ``names`` are the names of all series in the file, envelopes included, by which groups (``TOGETHER``) are checked.
    """
    for name, a in arrays.items():
        if a.dtype.kind not in "biuf" and not name.startswith(OTHER):
            raise ValueError(f"{name} holds {a.dtype}, not numbers")
        is_time = name == "t" or (name.endswith("_t") and name.removesuffix("_t") in POSES)
        if is_time and not (np.all(np.isfinite(a)) and np.all(np.diff(a) >= 0.0)):
            raise ValueError(f"{name} must be finite and must not decrease")
    for group in TOGETHER:
        present = group & set(names)
        if present and present != group:
            raise ValueError(f"{', '.join(sorted(group - present))}: missing, although {min(present)} is there")


def _check_lengths(arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError unless every array has one row for each of its times; series along ``t`` must be flat.

    Arrays that are not along time (``OTHER``) are not checked.
    """
    for name, a in arrays.items():
        lead = next((f"{kind}_t" for kind in POSES if name.startswith(f"{kind}_")), "t")
        if name.startswith(OTHER):
            continue
        if lead not in arrays or a.shape[:1] != arrays[lead].shape or (lead == "t" and a.ndim != 1):
            rows = arrays[lead].shape if lead in arrays else "no shape"
            raise ValueError(f"{name} has the shape {a.shape}, {lead} has {rows}")
