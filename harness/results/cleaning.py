"""Old results: which folders may go, how large they are, and their removal where no command is writing into them."""

import contextlib
import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..files import FileError
from ..places import Place
from . import store

NAMED = re.compile(r"(.+)-(\d{8}-\d{6}(-\d+)?)")  # by a command: what it ran, and when; other names are the user's
DAY = 86400.0  # [s]
RECENT = 600.0  # [s] a file this young may be on its way


@dataclass(frozen=True)
class Old:
    """A results folder that may be removed."""

    folder: Path
    bytes: int


def find_old(local: Path, keep: int, older_than: float) -> list[Old]:
    """Results in ``local`` that are ``older_than`` [s] and not among the newest ``keep`` of their suite, by name.

    Folders with a name of the user's own, links, and the one that ``latest`` points to are none of them.
    """
    latest, newest = (local / "latest").resolve(), dict[str, list[Path]]()
    for path in sorted(local.glob("*"), key=_time_of, reverse=True):
        if (named := NAMED.fullmatch(path.name)) and not path.is_symlink() and _holds_results(path):
            newest.setdefault(named[1], []).append(path)
    out = [path for own in newest.values() for path in own[keep:]]
    old = [path for path in out if path.resolve() != latest and time.time() - _last_change(path) >= older_than]
    return [Old(path, size_of(path)) for path in sorted(old)]


def remove(folder: Path) -> bool:
    """Remove the results; False, and nothing is touched, where a command is writing into them."""
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(store.lock(folder))
            held.enter_context(store.in_use(folder, alone=True))
        except (FileError, OSError):
            return False
        (Place(folder.parent) / folder.name).remove_folder()
    return True


def is_written(folder: Path) -> bool:
    """Whether a command is writing into the results."""
    try:
        if (Place(folder) / store.LOCK).is_own_file():
            store.lock(folder).close()
        with store.in_use(folder, alone=True):
            return False
    except (FileError, OSError):
        return True


def files_in(folder: Path) -> Iterator[os.DirEntry[str]]:
    """All files below ``folder``; no link is followed."""
    with contextlib.suppress(FileNotFoundError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                yield from files_in(Path(entry.path))
            elif entry.is_file(follow_symlinks=False):
                yield entry


def size_of(folder: Path) -> int:
    """Bytes in all files below ``folder``."""
    return sum(entry.stat(follow_symlinks=False).st_size for entry in files_in(folder))


def remove_unused(folders: Sequence[Path], older_than: float, *, dry_run: bool = False) -> tuple[int, int]:
    """Remove files that nothing has read or written for ``older_than`` [s]; return their number and bytes."""
    files = size = 0
    for entry in [e for folder in folders for e in files_in(folder)]:
        about = entry.stat(follow_symlinks=False)
        if time.time() - max(about.st_atime, about.st_mtime) >= max(older_than, RECENT):
            files, size = files + 1, size + about.st_size
            if not dry_run:
                Path(entry.path).unlink(missing_ok=True)
    return files, size


def _time_of(path: Path) -> tuple[str, str]:
    named = NAMED.fullmatch(path.name)
    return (named[2] if named else "", path.name)


def _holds_results(path: Path) -> bool:
    """Whether it is a results folder of this or an older version."""
    return any((path / name).is_dir() and not (path / name).is_symlink() for name in ("runs", "cells"))


def _last_change(path: Path) -> float:
    return max(p.lstat().st_mtime for p in (path, *path.iterdir()))
