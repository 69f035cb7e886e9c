"""Folders that keep computed things between runs: in the checkout or, once installed, in the user's cache.

Nothing is written beside installed modules: that folder may be shared or read-only.
"""

import os
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CHOSEN = "MBSBENCH_CACHE"  # in the environment: a folder for all that is kept
IN_RESULTS = ROOT / "results" / "local"
CACHES = {  # name of each folder: what it keeps, and where it is in a checkout
    "generated": ("compiled code of solvers", ROOT / "solvers" / "formulations" / "generated" / "__pycache__"),
    "laws": ("compiled code that measures", ROOT / "harness" / "metrics" / "__pycache__"),
    "user_forces": ("compiled code of user forces", IN_RESULTS),
    "references": ("reference motions", IN_RESULTS),
    "catalogue": ("the catalogue", IN_RESULTS),
    "sources": ("digests of code", IN_RESULTS),
    "machine": ("names of features", IN_RESULTS),
    "warmed": ("what was compiled", IN_RESULTS),
}


def list_caches() -> dict[str, Path]:
    """List the folders of all caches by what they keep, whether or not they exist."""
    return {what: cache_folder(name, place) for name, (what, place) in CACHES.items()}


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
