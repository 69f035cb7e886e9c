"""Folders that keep computed things between runs: in the checkout or, once installed, in the user's cache.

Nothing is written beside installed modules: that folder may be shared or read-only.
"""

import os
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
    folders = {name: cache_folder(name, ROOT / place) for name, place in sorted(IN_CHECKOUT.items())}
    return tuple(Cache(name, folder, _size_of(folder)) for name, folder in folders.items())


def _size_of(folder: Path) -> int:
    return sum(p.lstat().st_size for p in folder.rglob("*") if p.is_file())


def is_checkout() -> bool:
    """Whether this is a checkout, not an installed package."""
    return (ROOT / "pyproject.toml").exists()


def cache_folder(name: str, in_checkout: Path) -> Path:
    """``in_checkout / name`` in a checkout; installed, ``mbsbench/name`` in ``$XDG_CACHE_HOME`` or ``~/.cache``.

    Always ``name`` in ``$MBSBENCH_CACHE``, where that is set to an absolute path.
    """
    chosen = os.environ.get(CHOSEN, "")
    if os.path.isabs(chosen):
        return Path(chosen) / name
    if is_checkout() and os.access(ROOT, os.W_OK):
        return in_checkout / name
    given = os.environ.get("XDG_CACHE_HOME", "")
    user = Path(given if os.path.isabs(given) else os.path.expanduser("~/.cache")) / "mbsbench" / name
    temporary = Path(tempfile.gettempdir()) / f"mbsbench-{os.getuid()}" / name  # no home, or a read-only one
    return user if _is_ours(user) else temporary if _is_ours(temporary) else Path(tempfile.mkdtemp(prefix="mbsbench-"))


def _is_ours(folder: Path) -> bool:
    """Whether the folder and the one above exist or can be made and only we can write there: it holds machine code."""
    try:
        folder.parent.parent.mkdir(parents=True, exist_ok=True)
        folder.parent.mkdir(mode=0o700, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        about = [place.stat() for place in (folder.parent, folder)]
        return all(a.st_uid == os.getuid() and not a.st_mode & 0o022 for a in about) and os.access(folder, os.W_OK)
    except OSError:
        return False
