"""Read tables of numbers over time by name of column: text (module ``text_tables``), Parquet, NPZ and MAT.

Each column has the precision with which it was printed, which limits the comparison of a start.
"""

import hashlib
import io
import math
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ...base.confined_paths import read_whole
from ...base.files import FileError
from ...results.npz import read_npz
from .modelica import is_modelica_result, read_modelica_result
from .text_tables import parse_text_table


@dataclass(frozen=True)
class Table:
    """Columns (nt, ...) by name; ``resolution`` is half a unit of the last printed digit, in the same shape."""

    path: Path
    sha256: str
    columns: Mapping[str, np.ndarray]
    resolution: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)  # by column, if the file has a row of units
    angle: str = ""  # unit of all angles, if the file states one
    notes: tuple[str, ...] = ()


def read_table(path: Path, names: tuple[str, ...] = (), renamed: Mapping[str, str] = MappingProxyType({})) -> Table:
    """Return the table in a file of text, Parquet, NPZ or MAT; raise FileError if it cannot be read.

    ``names`` are those of columns in text without a header; ``renamed`` maps names in the file to ours, to find the
    time.
    """
    try:
        content = read_whole(path)
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from None
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise FileError(f"{path}: expected a file that ends in {', '.join(READERS)}")
    reader = READERS[suffix]
    try:
        if reader is None:
            text = parse_text_table(content, names)
            digest = hashlib.sha256(content).hexdigest()
            return Table(path, digest, text.columns, text.resolution, text.units, text.angle, text.notes)
        columns, resolution = reader(content, renamed)
    except (ValueError, KeyError, OSError, EOFError, NotImplementedError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: {' '.join(str(error).split())}") from None
    return Table(path, hashlib.sha256(content).hexdigest(), columns, resolution)


Columns = dict[str, np.ndarray]
MOST = 2**30  # [bytes] of all arrays of a table


def _select_columns(found: Mapping[str, np.ndarray], renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    """Return the numeric arrays by name with time as first axis, and their resolution; raise ValueError without a time.

    MATLAB's arrays may have time as last axis; arrays without that axis are left out. The resolution is a rounding of
    float32 or float16; that of integers and float64 counts as 0.
    """
    numeric = {k: np.asarray(a) for k, a in found.items() if np.asarray(a).dtype.kind in "fiu" and np.size(a) > 1}
    time = next((numeric[k] for k in numeric if renamed.get(k, k).lower() in ("t", "time")), None)
    if time is None:
        raise ValueError(f"it has no t or time, only {', '.join(found) or 'nothing'}")
    nt = time.size
    columns = {}
    for name, a in numeric.items():
        a = a.reshape(-1) if a.size == nt else a
        if a.shape[0] != nt and a.shape[-1] == nt:
            a = np.moveaxis(a, -1, 0)
        if a.shape[0] == nt:
            columns[name] = a.astype(np.float64)
    eps = {k: np.finfo(a.dtype).eps if a.dtype.kind == "f" else 0.0 for k, a in numeric.items()}
    zero = np.broadcast_to(0.0, 1)
    return columns, {
        k: eps[k] * np.abs(a) if eps[k] > 1e-10 else np.broadcast_to(zero, a.shape) for k, a in columns.items()
    }


def _check_size(size: int) -> None:
    """Raise ValueError for more than ``MOST`` unpacked bytes: a small file may expand to a very large array."""
    if size > MOST:
        raise ValueError(f"it unpacks to {size:,} bytes, more than {MOST:,}")


def _read_npz(content: bytes, renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    """Return the columns of an NPZ file and their resolution."""
    return _select_columns(read_npz(content, MOST), renamed)


def _read_mat(content: bytes, renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    """Return the columns of a MAT file, which may be a result of Modelica, and their resolution."""
    from scipy.io import loadmat, whosmat

    if content[:10] == b"MATLAB 7.3":
        raise ValueError("MAT files of version 7.3 are not read: save it with save(file, '-v7', ...)")
    try:
        sizes = [8 * math.prod(shape) for _, shape, _ in whosmat(io.BytesIO(content))]  # type: ignore[arg-type]
        found = loadmat(io.BytesIO(content)) if sum(sizes) <= MOST else {}  # type: ignore[arg-type]  # a file, too
    except Exception as error:  # damaged files raise errors of many kinds
        raise ValueError(f"not a whole MAT file of version 7.2 or older: {error}") from None
    _check_size(sum(sizes))
    if is_modelica_result(found):
        return _select_columns(read_modelica_result(found), renamed)
    return _select_columns({k: a for k, a in found.items() if not k.startswith("__")}, renamed)


def _read_parquet(content: bytes, renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    """Return the columns of a Parquet file and their resolution."""
    import pandas as pd
    from pyarrow import parquet  # type: ignore[import-untyped]

    about = parquet.ParquetFile(io.BytesIO(content)).metadata
    _check_size(8 * about.num_rows * about.num_columns)
    frame = pd.read_parquet(io.BytesIO(content))
    return _select_columns({str(k): frame[k].to_numpy() for k in frame.columns}, renamed)


Reader = Callable[[bytes, Mapping[str, str]], tuple[Columns, Columns]]
READERS: dict[str, Reader | None] = {  # none: text
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".sto", ".mot"), None),
    ".parquet": _read_parquet,
    ".npz": _read_npz,
    ".mat": _read_mat,
}
