"""The series file of a run: NPZ, no pickle. Scalars over every accepted step, poses thinned for drawing.

Written once by the run's process, read by reports; its digest is in the run's record.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from ..files import FileError, parse_json, to_json
from ..places import Place, place_of
from ..shapes import Shape, convert_shape
from .npz import read_npz, write_npz

SERIES_SCHEMA: Literal[1] = 1
KIND: Literal["mbsbench series"] = "mbsbench series"
LARGEST = 2**28  # [bytes] of a file, and of its arrays: ten times the longest
POSES = ("frame", "exact", "state", "sample")  # along times of their own
OTHER = ("end_", "start_", "joint_", "gravity", "system_")  # not along time


@dataclass(frozen=True)
class Series:
    """The arrays of one series file by name, as listed in ``docs/results-format.md``; all read-only."""

    arrays: Mapping[str, np.ndarray]
    events: tuple[Mapping[str, Any], ...]
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: Mapping[str, str]  # of obs_, ref_ and inv_ series, by full name
    symbols: Mapping[str, str]  # mathtext without $, of obs_ series, by full name
    peaks: Mapping[str, float] = field(default_factory=dict)  # [s] when reported maxima occurred, by column
    reference: str = ""  # where it comes from: ``harness.reference.computation.Source``

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

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
    kind: Literal["mbsbench series"] = KIND
    schema: Literal[1] = SERIES_SCHEMA


def write_series(path: Path | Place, series: Series) -> str:
    """Write whole or not at all; returns the sha256 of the file."""
    events = tuple(map(dict, series.events))
    names = (series.body_names, series.joint_names, dict(series.units), dict(series.symbols))
    head = Head(events, *names, dict(series.peaks), series.reference)
    return write_npz(path, {"meta": np.asarray(to_json(head)), **series.arrays})


def read_series(path: Path | Place, sha256: str = "", *, poses: bool = True) -> Series:
    """The series in ``path``, or FileError; with ``sha256``, only if the file is the one that was recorded.

    Without ``poses`` those of the run and of the exact motion, most of a file, stay packed.
    """
    head, arrays = _read(path, sha256, lambda name: poses or not name.startswith(POSES))
    for array in arrays.values():
        array.setflags(write=False)
    names = (head.body_names, head.joint_names, head.units, head.symbols)
    return Series(arrays, head.events, *names, head.peaks, head.reference)


def check_series(path: Path | Place, sha256: str) -> None:
    """FileError if it is not the recorded file of this schema; its arrays stay packed."""
    _read(path, sha256, "meta".__eq__)


def _read(path: Path | Place, sha256: str, wanted: Callable[[str], bool]) -> tuple[Head, dict[str, np.ndarray]]:
    """The head of the file and the arrays that are ``wanted``, or FileError."""
    try:
        content = place_of(path).read(LARGEST)
    except OSError as error:
        raise FileError(f"cannot read: {error.strerror or error}") from None
    if sha256 and hashlib.sha256(content).hexdigest() != sha256:
        raise FileError("not the file that was recorded (truncated or changed)")
    try:
        arrays = read_npz(content, LARGEST, wanted)
        head = convert_shape(parse_json(str(arrays.pop("meta", "")), "meta"), Head, "meta")
        _check_lengths(arrays)
    except ValueError as error:
        raise FileError(f"not a whole series file of schema {SERIES_SCHEMA}: {error}") from None
    return head, arrays


def _check_lengths(arrays: Mapping[str, np.ndarray]) -> None:
    """One value a row in all series, one pose a frame; ValueError else."""
    for name, a in arrays.items():
        lead = next((f"{kind}_t" for kind in POSES if name.startswith(f"{kind}_")), "t")
        if name.startswith(OTHER):
            continue
        if lead not in arrays or a.shape[:1] != arrays[lead].shape or (lead == "t" and a.ndim != 1):
            rows = arrays[lead].shape if lead in arrays else "no shape"
            raise ValueError(f"{name} has the shape {a.shape}, {lead} has {rows}")
