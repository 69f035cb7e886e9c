"""The geometric route: poses (r, R) and body velocities in compiled kernels with exact block Jacobians.

Numba keys its cache by the file of each function alone, so an edited callee would leave stale machine code in its
callers. The cache folder is therefore named by the content of the whole package.
"""

import contextlib
import fcntl
import hashlib
from collections.abc import Iterator
from pathlib import Path

import numba

from ....harness.cache import cache_folder

_HERE = Path(__file__).parent
_SOURCE = b"".join(file.read_bytes() for file in sorted(_HERE.rglob("*.py")))
_NAME = f"kernels-{hashlib.sha256(_SOURCE).hexdigest()[:12]}"
numba.config.CACHE_DIR = str(cache_folder(_NAME, _HERE / "__pycache__"))


@contextlib.contextmanager
def compiled_once(kernel: numba.core.dispatcher.Dispatcher) -> Iterator[None]:
    """Of processes that come here with ``kernel`` not compiled, one compiles it and the others find it in the cache."""
    with contextlib.ExitStack() as stack:
        if not getattr(kernel, "signatures", None):  # none either where numba is switched off
            with contextlib.suppress(OSError):  # nowhere to write: each compiles for itself
                folder = Path(numba.config.CACHE_DIR)
                folder.mkdir(parents=True, exist_ok=True)
                lock = stack.enter_context(open(folder / f"{kernel.__name__}.lock", "w"))
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield
