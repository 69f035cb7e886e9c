"""For all tests: one thread for linear algebra; with SHAPES=1, arrays have the shapes that their annotations say.

The checks triple the time of tests and of what they fork, so `make test-shapes` alone asks for them.
"""

import os
from pathlib import Path

from jaxtyping import install_import_hook

import tests.shape_checks  # noqa: F401 - the hook looks it up by its name

ROOT = Path(__file__).resolve().parents[1]
SHAPED = ("cli", "harness", "problems", "solvers", "reports")
COMPILED = ("user_forces", "methods", "compiled", "passes", "rows")  # what numba compiles takes no wrapper
LOOKS = ("code_meter",)  # it looks at who calls it, which a wrapper would be
EXTENDED = ("exact",)  # jaxtyping has no dtype of 64 bits of mantissa
if os.environ.get("SHAPES") == "1":
    install_import_hook(
        [
            ".".join(("mbsbench", *path.relative_to(ROOT).with_suffix("").parts))
            for folder in SHAPED
            for path in (ROOT / folder).rglob("*.py")
            if path.stem not in (*COMPILED, *LOOKS) and path.parent.name not in (*COMPILED, *EXTENDED)
        ],
        "tests.shape_checks.check",
    )

from mbsbench.harness.machine import THREADS  # noqa: E402 - below the hook, which sees what comes later

os.environ.update(THREADS)
