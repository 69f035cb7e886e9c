"""Write NPZ files atomically, and read them as plain arrays within a limit on memory, without pickle."""

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

from ..base.confined_paths import ConfinedPath, confine_path

PLAIN = "biufU"  # dtype kinds of numbers and of text
MEMBERS = 1000  # most arrays in a file
LONGEST_HEADER = 10_000  # [bytes] of an NPY file's header, which ends at the first newline
XZ = b"\xfd7zXZ\0"  # first bytes of an xz stream
PRESET = 1  # preset of xz: 6 makes files 6 % smaller and takes four times as long
LEVEL = 1  # zlib's default saves 3 % more on numbers of a motion and takes twice as long


def write_npz(
    path: Path | ConfinedPath, arrays: Mapping[str, np.ndarray], *, compressed: bool = True, solid: bool = False
) -> str:
    """Write ``arrays`` to ``path`` atomically; return the sha256 of the file.

    ``solid`` compresses all arrays together by xz, which suits many small arrays; otherwise each is compressed by zlib,
    or, without ``compressed``, not at all.
    """
    with confine_path(path).write_atomically() as file:
        if solid:
            with lzma.open(file, "wb", preset=PRESET) as one:
                _write_members(one, arrays, zipfile.ZIP_STORED)
        else:
            _write_members(file, arrays, zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED)
        file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def _write_members(file: IO[bytes], arrays: Mapping[str, np.ndarray], kind: int) -> None:
    """Write arrays to an open file as a ZIP archive of NPY files; ``kind`` is the method of compression."""
    with zipfile.ZipFile(file, "w", kind, compresslevel=LEVEL) as archive:
        for name, a in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(a), allow_pickle=False)


def read_npz(
    source: Path | ConfinedPath | bytes, largest: int, wanted: Callable[[str], bool] = lambda name: True
) -> dict[str, np.ndarray]:
    """Read those arrays of an NPZ file, or of its content, whose names are ``wanted``.

    Raise ValueError if it is larger than ``largest`` bytes, packed or unpacked, or not an NPZ file.
    """
    try:
        content = source if isinstance(source, bytes) else confine_path(source).read(largest)
        content = _decompress(content, largest) if content.startswith(XZ) else content
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            size = sum(m.file_size for m in members)
            if size > largest or len(members) > MEMBERS:
                raise ValueError(f"it holds {len(members)} arrays of {size} bytes, more than {MEMBERS} or {largest}")
            named = {m.filename.removesuffix(".npy"): m for m in members}
            return {name: _parse_array(archive.read(m)) for name, m in named.items() if wanted(name)}
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
    """Return the content of an xz stream; raise ValueError if it is incomplete or larger than ``largest`` bytes."""
    one = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=largest)
    found = one.decompress(content, max_length=largest)
    if not one.eof:
        raise ValueError(f"it is cut short, or holds more than {largest} bytes")
    return found


@functools.lru_cache(1024)
def _read_header(content: bytes) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Return shape, whether in Fortran order, dtype and start of the data from an NPY header; headers repeat."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"an array has NPY version {version}, expected {' or '.join(map(str, readers))}")
    return *readers[version](file), file.tell()


def _parse_array(content: bytes) -> np.ndarray:
    """Parse the content of an NPY file, and return its array.

    Raise ValueError unless its dtype is of numbers or text (``PLAIN``), and its bytes are exactly those of its shape.
    """
    end = content.find(b"\n", 0, LONGEST_HEADER) + 1
    shape, fortran, dtype, end = _read_header(content[: end or LONGEST_HEADER])
    data = content[end:]
    if dtype.kind not in PLAIN or math.prod(shape) * dtype.itemsize != len(data) or min(shape, default=0) < 0:
        raise ValueError(f"an array of {dtype} of shape {shape} cannot be stored in {len(data)} bytes")
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
