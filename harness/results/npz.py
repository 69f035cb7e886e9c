"""NPZ files: written whole or not at all, read as plain arrays within a limit on memory, without pickle."""

import functools
import hashlib
import io
import lzma
import math
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from ..places import Place, place_of

PLAIN = "biufU"  # kinds of numbers, and text
MEMBERS = 1000  # arrays at most
LONGEST_HEADER = 10_000  # [bytes] of an NPY file, which ends with the first end of a line
XZ = b"\xfd7zXZ\0"
PRESET = 1  # of xz: 6 makes files 6 % smaller and takes four times as long
LEVEL = 1  # of compression: numbers of a motion shrink by 3 % more at zlib's own, which takes twice as long


def write_npz(
    path: Path | Place, arrays: Mapping[str, np.ndarray], *, compressed: bool = True, solid: bool = False
) -> str:
    """Write ``arrays`` to ``path`` whole or not at all; returns the sha256 of the file.

    ``solid``: compressed by xz as one, which many small arrays need.
    """
    with place_of(path).whole() as file:
        if solid:
            with lzma.open(file, "wb", preset=PRESET) as one:
                _write_members(one, arrays, zipfile.ZIP_STORED)
        else:
            _write_members(file, arrays, zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED)
        file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def _write_members(file: IO[bytes], arrays: Mapping[str, np.ndarray], kind: int) -> None:
    with zipfile.ZipFile(file, "w", kind, compresslevel=LEVEL) as archive:
        for name, a in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(a), allow_pickle=False)


def read_npz(
    source: Path | Place | bytes, largest: int, wanted: Callable[[str], bool] = lambda name: True
) -> dict[str, np.ndarray]:
    """The arrays of a file that are ``wanted``; ValueError over ``largest`` bytes or if it is no NPZ file."""
    try:
        content = source if isinstance(source, bytes) else place_of(source).read(largest)
        content = _decompress(content, largest) if content.startswith(XZ) else content
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            size = sum(m.file_size for m in members)
            if size > largest or len(members) > MEMBERS:
                raise ValueError(f"{len(members)} arrays of {size} bytes, more than {MEMBERS} or {largest}")
            named = {m.filename.removesuffix(".npy"): m for m in members}
            return {name: _array(archive.read(m)) for name, m in named.items() if wanted(name)}
    except OSError as error:
        raise ValueError(f"cannot read: {error.strerror or error}") from None
    except (
        zipfile.BadZipFile,
        zlib.error,
        lzma.LZMAError,
        struct.error,
        EOFError,
        NotImplementedError,
        RuntimeError,
    ) as error:
        raise ValueError(f"not a whole NPZ file: {error}") from None


def _decompress(content: bytes, largest: int) -> bytes:
    one = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=largest)
    found = one.decompress(content, max_length=largest)
    if not one.eof:
        raise ValueError(f"cut short, or more than {largest} bytes")
    return found


@functools.lru_cache(1024)
def _read_header(content: bytes) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Shape, order and type in the header of an NPY file, and where its data begin: many arrays have the same."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"an array of NPY version {version}")
    return *readers[version](file), file.tell()


def _array(content: bytes) -> np.ndarray:
    """The array in an NPY file, which must hold exactly the bytes that its shape needs."""
    end = content.find(b"\n", 0, LONGEST_HEADER) + 1
    shape, fortran, dtype, end = _read_header(content[: end or LONGEST_HEADER])
    data = content[end:]
    if dtype.kind not in PLAIN or math.prod(shape) * dtype.itemsize != len(data) or min(shape, default=0) < 0:
        raise ValueError(f"an array of {dtype} of shape {shape} in {len(data)} bytes")
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
