"""Find old results and remove them, unless a command is writing into them."""

import contextlib
import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from . import store

# names that a command gives to folders: what it ran, and when; other names are the user's
NAMED = re.compile(r"(.+)-(\d{8}-\d{6}(-\d+)?)")
DAY = 86400.0  # [s]
# [s] a younger file may still be in use: more leaves rubbish for longer, less may take what is being written
RECENT = 600.0


@dataclass(frozen=True)
class OldFolder:
    """A results folder that may be removed."""

    folder: Path
    bytes: int


def find_old_folders(local: Path, keep: int, older_than: float) -> list[OldFolder]:
    """Return the results folders in ``local`` that ``clean`` may remove, sorted by path.

    They have not changed for ``older_than`` [s] and are not among the newest ``keep`` of their suite. Folders named by
    the user, links, and the target of ``latest`` are never returned.
    """
    latest, newest = (local / "latest").resolve(), dict[str, list[Path]]()
    for path in sorted(local.glob("*"), key=_make_age_key, reverse=True):
        if (named := NAMED.fullmatch(path.name)) and not path.is_symlink() and _holds_results(path):
            newest.setdefault(named[1], []).append(path)
    out = [path for own in newest.values() for path in own[keep:]]
    old = [path for path in out if path.resolve() != latest and time.time() - _find_last_change(path) >= older_than]
    return [OldFolder(path, measure_size(path)) for path in sorted(old)]


def remove_folder(folder: Path) -> bool:
    """Remove a results folder and return True; return False, and change nothing, if a command is using it."""
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(store.lock_folder(folder))
            held.enter_context(store.hold_folder(folder, alone=True))
        except (FileError, OSError):
            return False
        (ConfinedPath(folder.parent) / folder.name).remove_folder()
    return True


def is_in_use(folder: Path) -> bool:
    """Return whether a command is writing into a results folder or holds it; True, too, if the folder is unreadable."""
    try:
        if (ConfinedPath(folder) / store.LOCK).is_own_file():
            store.lock_folder(folder).close()
        with store.hold_folder(folder, alone=True):
            return False
    except (FileError, OSError):
        return True


def list_files(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Yield all files in ``folder`` and its subfolders; links are neither yielded nor followed."""
    with contextlib.suppress(FileNotFoundError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                yield from list_files(Path(entry.path))
            elif entry.is_file(follow_symlinks=False):
                yield entry


def measure_size(folder: Path) -> int:
    """Return the total size [bytes] of all files in ``folder`` and its subfolders."""
    return sum(entry.stat(follow_symlinks=False).st_size for entry in list_files(folder))


def remove_unused(folders: Sequence[Path], older_than: float, *, dry_run: bool = False) -> tuple[int, int]:
    """Remove files below ``folders`` that nothing has read or written for ``older_than`` [s], at least ``RECENT``.

    Return their number and total size [bytes]. With ``dry_run`` they are counted and not removed.
    """
    files = size = 0
    for entry in [e for folder in folders for e in list_files(folder)]:
        about = entry.stat(follow_symlinks=False)
        if time.time() - max(about.st_atime, about.st_mtime) >= max(older_than, RECENT):
            files, size = files + 1, size + about.st_size
            if not dry_run:
                Path(entry.path).unlink(missing_ok=True)
    return files, size


def _make_age_key(path: Path) -> tuple[str, str]:
    """Return a sort key that orders results folders by age: the time in the name, and the name.

    The time is empty in a name that the user has chosen.
    """
    named = NAMED.fullmatch(path.name)
    return (named[2] if named else "", path.name)


def _holds_results(path: Path) -> bool:
    """Return whether ``path`` is a results folder of this or an older version."""
    return any((path / name).is_dir() and not (path / name).is_symlink() for name in ("runs", "cells"))


def _find_last_change(path: Path) -> float:
    """Return when the folder, or a file directly in it, was last changed [s since 1970]."""
    return max(p.lstat().st_mtime for p in (path, *path.iterdir()))
