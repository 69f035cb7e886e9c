"""Check an engine's motion of our problems, from the engine's own tests (``mbsbench.kit``, docs/engines.md).

Call ``kit.check(case, motion, order=..., precision=...)`` for each of ``kit.CASES``, or in a terminal ``python -m
mbsbench.kit FILE.py:FUNCTION [CASE ...]``.
"""

import argparse
import importlib.util
import sys
from pathlib import Path

from .harness.judge.law import PRECISIONS
from .harness.lab.kit.cases import CASES
from .harness.lab.kit.model import Model
from .harness.lab.kit.verdict import EngineFailure, check, estimate_rounding

__all__ = ["CASES", "EngineFailure", "Model", "check"]


def main() -> int:
    """Check an engine from a terminal, on the named cases or on all, and print a line per case.

    Return 0 if all pass, else 1; a wrong call, such as a file without that function, ends with exit code 2.
    """
    parser = argparse.ArgumentParser("python -m mbsbench.kit", description="Check an engine's motion on our cases.")
    parser.add_argument("motion", metavar="FILE.py:FUNCTION", help="yields r, q, v, omega of all bodies, step by step")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)} (default: all)")
    parser.add_argument("--order", type=float, default=1.0, help="that the engine claims (default: 1)")
    parser.add_argument("--precision", choices=PRECISIONS, default="float64", help="of its numbers (default: float64)")
    parser.add_argument("--dt", type=float, default=2e-3, help="step [s]; it runs at half of it, too (default: 0.002)")
    given = parser.parse_args()
    path, _, function = given.motion.rpartition(":")
    spec = importlib.util.spec_from_file_location(Path(path).stem, path) if Path(path).is_file() else None
    if spec is None or spec.loader is None:
        parser.error(f"expected FILE.py:FUNCTION, a file that exists (got {given.motion!r})")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not hasattr(module, function):
        parser.error(f"{path} has no function {function!r}")
    failed = 0
    for case in given.cases or CASES:
        try:
            found = check(case, getattr(module, function), order=given.order, precision=given.precision, dt=given.dt)
            worst = max(found, key=lambda f: f.value)
            rounding = estimate_rounding(case, given.precision, given.dt)
            words = f"at most {worst.value:.2g} of what is allowed ({worst.quantity}); rounding alone: {rounding:.2g} m"
            print(f"{case}: passed, {words}")  # noqa: T201  its output is the answer
        except EngineFailure as error:
            failed += 1
            print(error)  # noqa: T201  its output is the answer
        except ValueError as error:
            parser.error(f"{case}: {error}")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
