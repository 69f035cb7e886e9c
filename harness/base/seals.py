"""Seal files that another library writes and reads back, and remove those that differ from their seal before it reads.

numba writes its cache without waiting for the disk and trusts what it finds: a power cut leaves incomplete files.
"""

import contextlib
import hashlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from .files import FileError, parse_json, read_text, to_json, write_text

SEALS = "seals.json"
LARGEST = 2**26  # [bytes] of a sealed file: it is held in memory before its seal is checked


def remove_unsealed(folder: Path, pattern: str) -> None:
    """Remove files in and below ``folder`` that match ``pattern`` and differ from what ``seal_files`` recorded."""
    kept = {}
    with contextlib.suppress(FileError, OSError):
        found = parse_json(read_text(folder / SEALS, "seals"), SEALS) if _is_file(folder / SEALS) else {}
        kept = found if isinstance(found, dict) else {}
    for path in _list_files(folder, pattern):
        with contextlib.suppress(OSError):  # another process has removed it
            if not (_is_file(path) and kept.get(_name(folder, path)) == _digest(path)):
                path.unlink()


def seal_files(folder: Path, pattern: str) -> None:
    """Record the digests of the files that match ``pattern``, by which ``remove_unsealed`` knows them.

    If nothing can be written, the files count as unsealed and are made again next time.
    """
    seals = {}
    for path in _list_files(folder, pattern):
        with contextlib.suppress(OSError):
            seals[_name(folder, path)] = _digest(path)
    with contextlib.suppress(OSError):
        write_text(folder / SEALS, to_json(seals))


def _list_files(folder: Path, pattern: str) -> Iterator[Path]:
    """Yield the files in and below ``folder`` that match ``pattern``, links included; none if it cannot be read."""
    with contextlib.suppress(OSError):
        yield from sorted(p for p in folder.rglob(pattern) if not p.is_dir() or p.is_symlink())


def _name(folder: Path, path: Path) -> str:
    """Return the path of a file relative to ``folder``: its key among the seals."""
    return str(path.relative_to(folder))


def _is_file(path: Path) -> bool:
    """Return whether ``path`` is a regular file, not a link, and no larger than ``LARGEST``."""
    about = os.lstat(path)
    return stat.S_ISREG(about.st_mode) and about.st_size <= LARGEST


def _digest(path: Path) -> str:
    """Return the SHA-256 digest of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
