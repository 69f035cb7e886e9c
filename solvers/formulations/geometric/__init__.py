"""The geometric route: poses (r, R) and body velocities in compiled kernels with exact block Jacobians.

Numba keys its cache by the file of each function alone, so an edited callee would leave stale machine code in its
callers. The cache folder is therefore named by the content of the whole package.
"""

import hashlib
from pathlib import Path

import numba

from ....harness.cache import cache_folder

_HERE = Path(__file__).parent
_SOURCE = b"".join(file.read_bytes() for file in sorted(_HERE.rglob("*.py")))
_NAME = f"kernels-{hashlib.sha256(_SOURCE).hexdigest()[:12]}"
numba.config.CACHE_DIR = str(cache_folder(_NAME, _HERE / "__pycache__"))
