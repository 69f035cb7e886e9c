"""Tables of numbers over time: CSV (any delimiter, with a header or without), Parquet, NPZ and MAT, by name of column.

Each column carries the precision it was printed with: a start can be compared with no more than that.
"""

import hashlib
import io
import itertools
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from ..files import FileError

COMMENT = "#%"
SAMPLE = 200  # lines at either end from which printed digits are counted
NUMBER = re.compile(r"[+-]?(\d*)\.?(\d*)(?:[eE]([+-]?\d+))?$")


@dataclass(frozen=True)
class Table:
    """Columns (nt, ...) by name; ``resolution``: half a unit of the last digit printed, of the same shape."""

    path: Path
    sha256: str
    columns: Mapping[str, np.ndarray]
    resolution: Mapping[str, np.ndarray]


def read_table(path: Path, names: tuple[str, ...] = (), renamed: Mapping[str, str] = MappingProxyType({})) -> Table:
    """The table in ``path``, or FileError; ``names`` of a CSV without a header; ``renamed``: our names by theirs."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from None
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"{path}: expected a file that ends in {', '.join(READERS)}")
    try:
        columns, resolution = reader(content, names, renamed)
    except (ValueError, KeyError, OSError, EOFError, NotImplementedError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: {' '.join(str(error).split())}") from None
    return Table(path, hashlib.sha256(content).hexdigest(), columns, resolution)


Columns = dict[str, np.ndarray]


def _csv(content: bytes, names: tuple[str, ...], renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    whole = [x for x in content.decode("utf-8-sig").splitlines() if x.strip()]
    lines = [x for x in whole if x.lstrip()[0] not in COMMENT]
    if not lines:
        raise ValueError("it holds no rows")
    remarks = [x.strip().lstrip(COMMENT) for x in itertools.takewhile(lambda x: x.lstrip()[0] in COMMENT, whole)]
    delimiter = next((d for d in (";", "\t", ",") if d in lines[0]), None)
    decimal = "," if delimiter == ";" and "," in lines[-1] and "." not in lines[-1] else "."

    def fields(line: str) -> list[str]:
        return [
            f.strip().strip('"').replace(decimal, ".") for f in (line.split(delimiter) if delimiter else line.split())
        ]

    first = fields(lines[0])
    if not all(_is_number(f) for f in first):
        header, lines = first, lines[1:]
    elif names:
        header = list(names)
    elif remarks and len(fields(remarks[-1])) == len(first):  # as numpy.savetxt and Exudyn write it
        header = fields(remarks[-1])
    else:
        raise ValueError("it has no header: name its columns in order, --columns t,r_x,r_y,...")
    if len(set(header)) < len(header):
        raise ValueError(f"column {next(h for h in header if header.count(h) > 1)!r} is there twice")
    if not lines:
        raise ValueError("it has a header and no rows")
    sample = [fields(line) for line in (*lines[:SAMPLE], *lines[SAMPLE:][-SAMPLE:])]
    if len(sample[0]) != len(header):
        raise ValueError(f"{len(header)} columns are named, the first row has {len(sample[0])}")
    plain = [line.replace(decimal, ".") for line in lines] if decimal != "." else lines
    numbers = np.loadtxt(plain, delimiter=delimiter, ndmin=2, comments=None)
    resolution = {
        h: _resolution(numbers[:, k], [row[k] for row in sample if k < len(row)]) for k, h in enumerate(header)
    }
    return {h: numbers[:, k] for k, h in enumerate(header)}, resolution


def _is_number(text: str) -> bool:
    match = NUMBER.fullmatch(text)
    return bool(match and (match[1] or match[2])) or text.lower() in ("nan", "inf", "-inf", "+inf")


def _resolution(values: Float[np.ndarray, " nt"], printed: list[str]) -> Float[np.ndarray, " nt"]:
    """Half a unit of the last digit of ``values``: %f fixes the decimals of a column, %e and %g its digits.

    Whole numbers are exact: zeros of a planar motion, mostly.
    """
    digits, decimals = 1, 0
    for match in filter(None, map(NUMBER.fullmatch, printed)):
        digits = max(digits, len((match[1] + match[2]).lstrip("0")))
        decimals = max(decimals, len(match[2]) - int(match[3] or 0))
    if digits >= 17 or not any("." in text or "e" in text.lower() for text in printed):
        return np.zeros(len(values))
    sizes = np.abs(np.where(np.isfinite(values) & (values != 0.0), values, 10.0 ** -(decimals + digits)))
    by_digits: np.ndarray = 10.0 ** (np.floor(np.log10(sizes)) - digits + 1)
    out: np.ndarray = 0.5 * np.maximum(by_digits, 10.0**-decimals)
    return np.where(np.isfinite(values), out, 0.0)


def _arrays(found: Mapping[str, np.ndarray], renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    """Numeric arrays, the axis of time first; those of MATLAB may have it last."""
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
    exact = np.broadcast_to(0.0, 1)
    return columns, {
        k: eps[k] * np.abs(a) if eps[k] > 1e-10 else np.broadcast_to(exact, a.shape) for k, a in columns.items()
    }


def _npz(content: bytes, names: tuple[str, ...], renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        return _arrays({k: file[k] for k in file.files}, renamed)


def _mat(content: bytes, names: tuple[str, ...], renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    if content[:10] == b"MATLAB 7.3":
        raise ValueError("MAT files of version 7.3 are not read: save it with save(file, '-v7', ...)")
    try:
        found = loadmat(io.BytesIO(content))  # type: ignore[arg-type]  # a file, too
    except (MatReadError, TypeError) as error:
        raise ValueError(f"not a MAT file of version 7.2 or older: {error}") from None
    return _arrays({k: a for k, a in found.items() if not k.startswith("__")}, renamed)


def _parquet(content: bytes, names: tuple[str, ...], renamed: Mapping[str, str]) -> tuple[Columns, Columns]:
    import pandas as pd

    frame = pd.read_parquet(io.BytesIO(content))
    return _arrays({str(k): frame[k].to_numpy() for k in frame.columns}, renamed)


Reader = Callable[[bytes, tuple[str, ...], Mapping[str, str]], tuple[Columns, Columns]]
READERS: dict[str, Reader] = {
    ".csv": _csv, ".tsv": _csv, ".txt": _csv, ".dat": _csv, ".parquet": _parquet, ".npz": _npz, ".mat": _mat,
}  # fmt: skip
