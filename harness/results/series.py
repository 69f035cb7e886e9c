"""The series file of a run: NPZ, no pickle. Scalars over every accepted step, poses thinned for drawing.

Written once by the run's process, read by reports; its digest is in the run's record.
"""

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SERIES_SCHEMA = 1
KIND = "mbsbench series"


class BadSeries(ValueError):
    """Not a whole series file of this schema; the message says why."""


@dataclass(frozen=True)
class Series:
    """The arrays of one series file by name, as listed in ``docs/results-format.md``; all read-only."""

    arrays: Mapping[str, np.ndarray]
    events: tuple[Mapping[str, Any], ...]
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: Mapping[str, str]  # of obs_, ref_ and inv_ series, by full name
    symbols: Mapping[str, str]  # mathtext without $, of obs_ series, by full name

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def named(self, prefix: str) -> dict[str, np.ndarray]:
        """All series whose name starts with ``prefix`` (``"obs_"``), by the rest of it."""
        return {k[len(prefix) :]: a for k, a in self.arrays.items() if k.startswith(prefix)}


def write_series(path: Path, series: Series) -> str:
    """Write atomically; returns the sha256 of the file."""
    texts = {
        "meta": json.dumps(
            {
                "kind": KIND,
                "schema": SERIES_SCHEMA,
                "events": list(series.events),
                "body_names": list(series.body_names),
                "joint_names": list(series.joint_names),
                "units": dict(series.units),
                "symbols": dict(series.symbols),
            }
        )
    }
    return write_npz(path, {**{k: np.asarray(v) for k, v in texts.items()}, **series.arrays})


def read_series(path: Path, sha256: str = "") -> Series:
    """The series in ``path``, or BadSeries; with ``sha256``, only if the file is the one that was recorded."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BadSeries(f"cannot read: {error.strerror or error}") from None
    if sha256 and hashlib.sha256(content).hexdigest() != sha256:
        raise BadSeries("not the file that was recorded (truncated or changed)")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        meta = json.loads(str(arrays.pop("meta")))
    except (ValueError, OSError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise BadSeries(f"not a whole series file: {error}") from None
    if not isinstance(meta, dict) or meta.get("kind") != KIND or meta.get("schema") != SERIES_SCHEMA:
        raise BadSeries(f"not a series file of schema {SERIES_SCHEMA}")
    for array in arrays.values():
        array.setflags(write=False)
    names = (tuple(meta["body_names"]), tuple(meta["joint_names"]))
    return Series(arrays, tuple(meta["events"]), *names, meta["units"], meta["symbols"])


def partial_of(path: Path, pid: int) -> Path:
    """Where process ``pid`` writes what will be ``path``."""
    return path.with_name(f".{path.name}.{pid}.part")


def write_npz(path: Path, arrays: Mapping[str, np.ndarray]) -> str:
    """Write ``arrays`` to ``path`` whole or not at all; returns the sha256 of the file."""
    partial = partial_of(path, os.getpid())
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        digest = hashlib.sha256(partial.read_bytes()).hexdigest()
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
    return digest
