"""Machine code of joints and forces by kind, cached on disk by the text of its sources: cached code needs no CasADi."""

import hashlib
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....harness.base import generated
from ....harness.base.code_meter import making_code
from ....harness.base.generated import Code
from ....harness.base.generated.code import print_functions
from ....harness.mechanics import declaring, fixed_order, forces, joints


class RowCode(NamedTuple):
    """Code of the function ``rows``, and the results that it leaves out as constants."""

    code: Code
    way: np.ndarray | None  # forces (n, 3) of the rows on body i, or None where they vary
    is_phi_t_zero: bool  # whether phi_t is 0


@cache
@making_code
def load_row_code(kind: str, rows: tuple[int, ...], ground: bool) -> RowCode:
    """Return the code of a kind of joint's constraint rows (``loops.make_row_loops``), with its constant results.

    ``rows`` are the indices of the rows; with ``ground`` body j is the ground.
    """
    code = load_or_make_code("loops.make_row_loops", kind, rows, ground)
    constants = np.zeros(2 + 3 * len(rows))
    code.function("constants", 1)(constants.ctypes.data)
    way = constants[2:].reshape(len(rows), 3) if constants[0] else None
    return RowCode(code, way, bool(constants[1]))


@cache
@making_code
def load_or_make_code(maker: str, kind: str = "", *of: Any, **choices: Any) -> Code:
    """Load the code that ``maker`` makes for a ``kind`` of joint or force from disk, or make and store it; return it.

    ``maker`` is "module.function" of this folder; ``of`` and ``choices`` are its further arguments. Without ``kind``
    the code is that of bodies alone.
    """

    def print_code() -> str:
        """Make the functions and return their LLVM IR."""
        module, function = maker.split(".")
        return print_functions(getattr(import_module(f".{module}", __package__), function)(*key, **choices))

    key = (kind, *of) if kind else of
    declared = {**joints.DECLARED, **forces.DECLARED}
    paths = {f.__code__.co_filename for f in vars(declared[kind]).values() if hasattr(f, "__code__")} if kind else ()
    return Code(print_code, f"{maker} {key} {choices}\0{digest_makers()}\0{digest_files(tuple(sorted(paths)))}")


@cache
@making_code
def digest_makers() -> str:
    """Return a digest of the files of all modules that make code and of all declarations, and CasADi's version."""
    files = __file__, generated.__file__, forces.__file__
    folders = [*(Path(file).resolve().parent for file in files), Path(joints.__file__).parent / "kinds"]
    paths = [path for folder in folders for path in sorted(folder.glob("*.py"))]
    return digest_files((*map(str, paths), str(declaring.__file__), str(fixed_order.__file__))) + version("casadi")


@cache
def digest_files(paths: tuple[str, ...]) -> str:
    """Return the SHA-256, in hexadecimal, of the contents of the files ``paths``."""
    return hashlib.sha256(b"\0".join(Path(path).read_bytes() for path in paths)).hexdigest()
