"""Seals of files that another library writes and reads back: what is not as it was sealed goes before it is read.

numba writes its cache without waiting for the disk and trusts what it finds: a power cut leaves halves of files.
"""

import contextlib
import hashlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from .files import FileError, parse_json, read_text, to_json, write_text

SEALS = "seals.json"
LARGEST = 2**26  # [bytes] of a sealed file


def remove_unsealed(folder: Path, pattern: str) -> None:
    """Remove the files in ``folder``, and below it, that match ``pattern`` and are not as ``seal_files`` found them."""
    kept = {}
    with contextlib.suppress(FileError, OSError):
        found = parse_json(read_text(folder / SEALS, "seals"), SEALS) if _is_file(folder / SEALS) else {}
        kept = found if isinstance(found, dict) else {}
    for path in _list_files(folder, pattern):
        with contextlib.suppress(OSError):  # another process has removed it
            if not (_is_file(path) and kept.get(_name(folder, path)) == _digest(path)):
                path.unlink()


def seal_files(folder: Path, pattern: str) -> None:
    """Note what the files are now; where nothing can be written, they are made again the next time."""
    seals = {}
    for path in _list_files(folder, pattern):
        with contextlib.suppress(OSError):
            seals[_name(folder, path)] = _digest(path)
    with contextlib.suppress(OSError):
        write_text(folder / SEALS, to_json(seals))


def _list_files(folder: Path, pattern: str) -> Iterator[Path]:
    with contextlib.suppress(OSError):
        yield from sorted(p for p in folder.rglob(pattern) if not p.is_dir() or p.is_symlink())


def _name(folder: Path, path: Path) -> str:
    return str(path.relative_to(folder))


def _is_file(path: Path) -> bool:
    """Whether it is a file of its own, not a link, and not larger than any of ours."""
    about = os.lstat(path)
    return stat.S_ISREG(about.st_mode) and about.st_size <= LARGEST


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
