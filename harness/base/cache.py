"""Provide cache folders for computed results between runs: in the checkout or, if installed, in the user's cache.

Nothing is written beside installed modules: that folder may be shared or read-only. Machine code and pickles are loaded
from caches, so that each must be a folder of this user that no other may write to, and not a link; else it is not used.
A damaged disk is no attacker, but as silent: what is stored is sealed by its digest, and what differs is made anew.
"""

import contextlib
import hashlib
import os
import stat
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CHOSEN = "MBSBENCH_CACHE"  # environment variable: a folder for all caches
LOCAL = "results/local"
SEAL = hashlib.sha256().digest_size  # [bytes] of the digest in front of a sealed file
IN_CHECKOUT = {  # caches, and the folders that hold them in a checkout
    "catalogue": LOCAL,
    "generated": "harness/base/generated/__pycache__",
    "laws": "harness/judge/metrics/__pycache__",
    "machine": LOCAL,
    "references": LOCAL,
    "sources": LOCAL,
    "user_forces": LOCAL,
    "warmed": LOCAL,
}


@dataclass(frozen=True)
class Cache:
    """A cache folder and its size."""

    name: str
    folder: Path
    bytes: int


def list_caches() -> tuple[Cache, ...]:
    """Return all caches with their folders and sizes, sorted by name."""
    folders = {name: _choose_place(name, ROOT / place)[0] for name, place in sorted(IN_CHECKOUT.items())}
    return tuple(Cache(name, folder, _size_of(folder)) for name, folder in folders.items())


def _size_of(folder: Path) -> int:
    """Return the sum of the sizes of all files in a folder [bytes]."""
    return sum(p.lstat().st_size for p in folder.rglob("*") if p.is_file())


def is_checkout() -> bool:
    """Return whether this is a checkout, not an installed package."""
    return (ROOT / "pyproject.toml").exists()


def make_cache_folder(name: str, in_checkout: Path) -> Path:
    """Make the folder of the cache ``name`` for this user alone and return its path.

    It is below ``in_checkout`` or, without a writable checkout, in the user's cache: ``mbsbench/`` in
    ``$XDG_CACHE_HOME`` or ``~/.cache``. ``$MBSBENCH_CACHE``, an absolute path, replaces both. A folder to which others
    may write is not used, and a warning names it. Then, or if a folder in the user's cache cannot be made, this process
    and those that it starts use a private temporary folder (``$MBSBENCH_CACHE`` is set). If a folder in the checkout or
    in ``$MBSBENCH_CACHE`` cannot be made, its path is returned all the same, and nothing is cached.
    """
    folder, above = _choose_place(name, in_checkout)
    try:
        why = _make_private(folder, above)
    except OSError:  # a full or read-only disk: nothing is cached
        if above is None or _read_chosen_folder():
            return folder
    else:
        if not why:
            return folder
        with contextlib.suppress(OSError, AttributeError):  # a full or closed stream
            sys.stderr.write(f"warning: the cache {why}: it is not used; remove it: rm -r {folder}\n")
    private = _make_private_folder()
    os.environ[CHOSEN] = str(private)
    _make_private(private / name, private)
    return private / name


def read_cached_file(path: Path, largest: int) -> bytes:
    """Return the content of a file in a cache.

    Raise OSError unless it is a regular file that this user owns, no link, of at most ``largest`` bytes.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        about = os.fstat(descriptor)
        if not stat.S_ISREG(about.st_mode) or about.st_uid != os.getuid() or about.st_size > largest:
            raise OSError(f"{path} is not a regular file of this user of at most {largest} bytes")
    except OSError:
        os.close(descriptor)
        raise
    with os.fdopen(descriptor, "rb") as file:
        return file.read(about.st_size)


def write_sealed_file(path: Path, content: bytes) -> None:
    """Write the SHA-256 digest of ``content``, then ``content``, to ``path`` atomically.

    OSError is ignored: nothing is then stored, and the content is computed again next time.
    """
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as part:
            part.write(hashlib.sha256(content).digest() + content)
        os.replace(part.name, path)


def read_sealed_file(path: Path, largest: int) -> bytes:
    """Return the content that ``write_sealed_file`` wrote, as ``read_cached_file`` reads it.

    Raise OSError if the content differs from its digest: one flipped bit may be a wrong number or a crash.
    """
    kept = read_cached_file(path, largest)
    digest, content = kept[:SEAL], kept[SEAL:]
    if hashlib.sha256(content).digest() != digest:
        raise OSError(f"{path} is damaged: its content differs from its digest")
    return content


def _read_chosen_folder() -> str:
    """Return the folder in ``$MBSBENCH_CACHE``; empty if that is unset or not an absolute path."""
    chosen = os.environ.get(CHOSEN, "")
    return chosen if os.path.isabs(chosen) else ""


def _choose_place(name: str, in_checkout: Path) -> tuple[Path, Path | None]:
    """Return the folder of the cache ``name``, and its parent if that holds caches alone, else (in a checkout) None.

    ``in_checkout`` is the parent in a checkout.
    """
    if chosen := _read_chosen_folder():
        return Path(chosen) / name, Path(chosen)
    if is_checkout() and os.access(ROOT, os.W_OK):
        return in_checkout / name, None
    given = os.environ.get("XDG_CACHE_HOME", "")
    above = Path(given if os.path.isabs(given) else os.path.expanduser("~/.cache")) / "mbsbench"
    return above / name, above


def _make_private(folder: Path, above: Path | None) -> str:
    """Make ``folder``, and its parent ``above`` if given, for this user alone.

    Return why an existing one is not safe, else an empty string; raise OSError if one cannot be made or written to.
    """
    (above or folder).parent.mkdir(parents=True, exist_ok=True)
    for place in filter(None, (above, folder)):
        try:
            place.mkdir(mode=0o700)
        except FileExistsError:
            if why := _explain_risk(place, chosen=place == above and bool(_read_chosen_folder())):
                return why
    if not os.access(folder, os.W_OK):
        raise OSError(f"{folder} is read-only")
    return ""


def _explain_risk(place: Path, *, chosen: bool) -> str:
    """Return why others could write to the folder ``place``; empty if they cannot.

    A folder ``chosen`` by the user (``$MBSBENCH_CACHE``) may be a link, belong to root, or be sticky like /tmp. Raise
    NotADirectoryError if ``place`` is a file.
    """
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


def _make_private_folder() -> Path:
    """Make and return a private temporary folder, for a home that is missing, read-only, or writable by others."""
    own = Path(tempfile.gettempdir()) / f"mbsbench-{os.getuid()}"
    try:
        usable = not _make_private(own, None)
    except OSError:
        usable = False
    return own if usable else Path(tempfile.mkdtemp(prefix="mbsbench-"))
