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
from typing import IO, Any, cast

import numpy as np

from ..base.confined_paths import ConfinedPath, confine_path

PLAIN = "biufU"  # dtype kinds of numbers and of text
MEMBERS = 1000  # most arrays in a file
LONGEST_HEADER = 10_000  # [bytes] of an NPY file's header, which ends at the first newline
XZ = b"\xfd7zXZ\0"  # first bytes of an xz stream
LOCAL = b"PK\3\4"  # first bytes of a member in a ZIP archive
AFTER = 8  # flag of a member whose size stands after its data and in the archive's table, as where it was streamed
PRESET = 1  # preset of xz: 6 makes files 6 % smaller and takes four times as long
AT_ONCE = 2**16  # [bytes] largest array that is written by one call, together with its header
LEVEL = 1  # zlib's default saves 3 % more on numbers of a motion and takes twice as long


def write_npz(path: Path | ConfinedPath, arrays: Mapping[str, np.ndarray], *, solid: bool = False) -> str:
    """Write ``arrays`` to ``path`` atomically; return the sha256 of the file.

    With ``solid`` all arrays are compressed together by xz, which suits many small ones; otherwise each by zlib.
    """
    with confine_path(path).write_atomically() as file:
        if solid:
            content = lzma.compress(_pack_members(arrays), preset=PRESET)
            file.write(content)
            return hashlib.sha256(content).hexdigest()
        _write_members(file, arrays, zipfile.ZIP_DEFLATED)
        file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def write_scratch_npz(path: Path | ConfinedPath, arrays: Mapping[str, np.ndarray]) -> None:
    """Write ``arrays`` to ``path`` completely or not at all, for a process that reads the file at once and removes it.

    They are not compressed, and the file is not forced to disk.
    """
    with confine_path(path).write_atomically(durable=False) as file:
        _write_members(file, arrays, zipfile.ZIP_STORED)


class _Parts(io.RawIOBase):
    """A stream that keeps what is written to it, and that cannot be read."""

    def __init__(self) -> None:
        self.parts = list[bytes]()

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, content: Any) -> int:
        """Keep the bytes ``content``."""
        self.parts.append(bytes(content))
        return len(content)


def _pack_members(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return arrays as an uncompressed ZIP archive of NPY files, which one call can then compress."""
    _write_members(packed := _Parts(), arrays, zipfile.ZIP_STORED)
    return b"".join(packed.parts)


def _write_members(file: IO[bytes] | _Parts, arrays: Mapping[str, np.ndarray], kind: int) -> None:
    """Write arrays to an open file as a ZIP archive of NPY files; ``kind`` is the method of compression."""
    with zipfile.ZipFile(cast(IO[bytes], file), "w", kind, compresslevel=LEVEL) as archive:
        for name, given in arrays.items():
            a = np.asanyarray(given)
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                if a.flags.c_contiguous and a.nbytes <= AT_ONCE and a.dtype.kind in PLAIN:
                    member.write(_format_header(a.dtype.str, a.shape) + a.tobytes())
                else:
                    np.lib.format.write_array(member, a, allow_pickle=False)


@functools.lru_cache(1024)
def _format_header(dtype: str, shape: tuple[int, ...]) -> bytes:
    """Return the header of an NPY file for a C-contiguous array; cached, since headers repeat."""
    header = io.BytesIO()
    about = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, about)
    return header.getvalue()


def read_npz(
    source: Path | ConfinedPath | bytes, largest: int, is_wanted: Callable[[str], bool] = lambda name: True
) -> dict[str, np.ndarray]:
    """Read the arrays of an NPZ file, given by path or content, for whose names ``is_wanted`` returns True; else all.

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
            return {
                name: _parse_array(_read_member(archive, m, content)) for name, m in named.items() if is_wanted(name)
            }
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


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, content: bytes) -> bytes:
    """Return the bytes of a member of an archive; ``content`` are the bytes of the whole archive.

    An uncompressed member is cut out here, ten times as fast as by ``zipfile``: a file has a hundred small ones. Any
    other, and one that is unusual, is left to ``zipfile``, which refuses what is wrong.
    """
    begin, name = member.header_offset, member.orig_filename.encode()
    head = content[begin : begin + 30 + len(name)]
    plain = member.compress_type == zipfile.ZIP_STORED and member.flag_bits in (0, AFTER)
    if plain and head[:4] == LOCAL and head[30:] == name:
        name_length, extra_length = struct.unpack_from("<HH", head, 26)
        start = begin + 30 + name_length + extra_length
        data = content[start : start + member.file_size]
        if name_length == len(name) and len(data) == member.file_size and zlib.crc32(data) == member.CRC:
            return data
    return archive.read(member)


def _decompress(content: bytes, largest: int) -> bytes:
    """Return the content of an xz stream; raise ValueError if it is incomplete or larger than ``largest`` bytes."""
    decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=largest)
    found = decompressor.decompress(content, max_length=largest)
    if not decompressor.eof:
        raise ValueError(f"it is cut short, or holds more than {largest} bytes")
    return found


@functools.lru_cache(1024)
def _read_header(content: bytes) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Return shape, whether in Fortran order, dtype, and offset of the data from an NPY file's header.

    Cached, since headers repeat. Raise ValueError for a version of the format that is not 1.0 or 2.0.
    """
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"an array has NPY version {version}, expected {' or '.join(map(str, readers))}")
    return *readers[version](file), file.tell()


def _parse_array(content: bytes) -> np.ndarray:
    """Return the array in the content of an NPY file, read-only.

    Raise ValueError unless its dtype is of numbers or text (``PLAIN``) and the content has just the bytes of its shape.
    """
    end = content.find(b"\n", 0, LONGEST_HEADER) + 1
    shape, fortran, dtype, end = _read_header(content[: end or LONGEST_HEADER])
    size = len(content) - end
    if dtype.kind not in PLAIN or math.prod(shape) * dtype.itemsize != size or min(shape, default=0) < 0:
        raise ValueError(f"an array of {dtype} of shape {shape} cannot be stored in {size} bytes")
    return np.frombuffer(content, dtype, offset=end).reshape(shape, order="F" if fortran else "C")
