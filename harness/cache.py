"""Folders that keep computed things between runs: in the checkout or, once installed, in the user's cache.

Nothing is written beside installed modules: that folder may be shared or read-only. Machine code and pickles are loaded
from caches, so each is a folder of this user that no other may write to, and not a link; else it is not used.
"""

import contextlib
import os
import stat
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CHOSEN = "MBSBENCH_CACHE"  # in the environment: a folder for all that is kept
LOCAL = "results/local"
IN_CHECKOUT = {  # caches, and the folders that hold theirs in a checkout
    "catalogue": LOCAL, "generated": "solvers/formulations/generated/__pycache__",
    "laws": "harness/metrics/__pycache__", "machine": LOCAL, "references": LOCAL, "sources": LOCAL,
    "user_forces": LOCAL, "warmed": LOCAL,
}  # fmt: skip


@dataclass(frozen=True)
class Cache:
    """A folder of computed things, and how much it holds."""

    name: str
    folder: Path
    bytes: int


def list_caches() -> tuple[Cache, ...]:
    """Every cache with its place and size, by name."""
    folders = {name: _choose_place(name, ROOT / place)[0] for name, place in sorted(IN_CHECKOUT.items())}
    return tuple(Cache(name, folder, _size_of(folder)) for name, folder in folders.items())


def _size_of(folder: Path) -> int:
    return sum(p.lstat().st_size for p in folder.rglob("*") if p.is_file())


def is_checkout() -> bool:
    """Whether this is a checkout, not an installed package."""
    return (ROOT / "pyproject.toml").exists()


def cache_folder(name: str, in_checkout: Path) -> Path:
    """``in_checkout / name`` in a checkout; installed, ``mbsbench/name`` in ``$XDG_CACHE_HOME`` or ``~/.cache``.

    Always ``name`` in ``$MBSBENCH_CACHE``, where that is set to an absolute path. It is made for this user alone. One
    that others may write to is named in a line, and a private one is used, by all that this process starts, too.
    """
    folder, above = _choose_place(name, in_checkout)
    try:
        why = _make_private(folder, above)
    except OSError:  # a full or read-only disk: nothing is kept
        if above is None or _chosen():
            return folder
    else:
        if not why:
            return folder
        with contextlib.suppress(OSError, AttributeError):  # a full or closed stream
            sys.stderr.write(f"warning: the cache {why}: it is not used; remove it: rm -r {folder}\n")
    private = _private_folder()
    os.environ[CHOSEN] = str(private)
    _make_private(private / name, private)
    return private / name


def read_kept(path: Path, largest: int) -> bytes:
    """The content of a file in a cache: OSError unless it is a file of this user, not a link, and not too large."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        about = os.fstat(descriptor)
        if not stat.S_ISREG(about.st_mode) or about.st_uid != os.getuid() or about.st_size > largest:
            raise OSError(f"{path} is not as a file of this cache is")
    except OSError:
        os.close(descriptor)
        raise
    with os.fdopen(descriptor, "rb") as file:
        return file.read(about.st_size)


def _chosen() -> str:
    chosen = os.environ.get(CHOSEN, "")
    return chosen if os.path.isabs(chosen) else ""


def _choose_place(name: str, in_checkout: Path) -> tuple[Path, Path | None]:
    """The folder, and the one above it where that holds caches alone; a checkout holds the code that uses them, too."""
    if chosen := _chosen():
        return Path(chosen) / name, Path(chosen)
    if is_checkout() and os.access(ROOT, os.W_OK):
        return in_checkout / name, None
    given = os.environ.get("XDG_CACHE_HOME", "")
    above = Path(given if os.path.isabs(given) else os.path.expanduser("~/.cache")) / "mbsbench"
    return above / name, above


def _make_private(folder: Path, above: Path | None) -> str:
    """Make the folder, and that ``above``, for this user alone; what is wrong with one that was there, or nothing.

    OSError where it cannot be made.
    """
    (above or folder).parent.mkdir(parents=True, exist_ok=True)
    for place in filter(None, (above, folder)):
        try:
            place.mkdir(mode=0o700)
        except FileExistsError:
            if why := _complain(place, chosen=place == above and bool(_chosen())):
                return why
    if not os.access(folder, os.W_OK):
        raise OSError(f"{folder} is read-only")
    return ""


def _complain(place: Path, *, chosen: bool) -> str:
    """Why others could put something there; one that the user chose may be a link, or a place as /tmp is."""
    about = place.stat() if chosen else place.lstat()
    if stat.S_ISLNK(about.st_mode):
        return f"{place} is a link"
    if not stat.S_ISDIR(about.st_mode):
        raise NotADirectoryError(str(place))
    if about.st_uid not in ((os.getuid(), 0) if chosen else (os.getuid(),)):
        return f"{place} belongs to another user ({about.st_uid})"
    if about.st_mode & 0o022 and not (chosen and about.st_mode & stat.S_ISVTX):
        return f"{place} may be written to by others (mode {stat.S_IMODE(about.st_mode):03o})"
    return ""


def _private_folder() -> Path:
    """One for temporary files that is this user's alone: no home, a read-only one, or one that others may write to."""
    own = Path(tempfile.gettempdir()) / f"mbsbench-{os.getuid()}"
    try:
        usable = not _make_private(own, None)
    except OSError:
        usable = False
    return own if usable else Path(tempfile.mkdtemp(prefix="mbsbench-"))
