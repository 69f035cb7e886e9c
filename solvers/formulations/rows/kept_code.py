"""Machine code of joints and forces by kind, kept under the text of their declarations: kept code needs no CasADi."""

import hashlib
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....harness.code_meter import making_code
from ....harness.mechanics import declaring, fixed_order, forces, joints
from ..generated import Code
from ..generated.code import print_functions


class RowCode(NamedTuple):
    """Function ``rows``, and its constant results, which it leaves out: forces (n, 3) of rows, whether phi_t is 0."""

    code: Code
    way: np.ndarray | None
    still: bool


@cache
@making_code
def row_code(kind: str, rows: tuple[int, ...], ground: bool) -> RowCode:
    """Return the code of a kind's constraint rows (``loops.rows``), with its constant results."""
    code = load_or_make_code("loops.rows", kind, rows, ground)
    constants = np.zeros(2 + 3 * len(rows))
    code.function("constants", 1)(constants.ctypes.data)
    way = constants[2:].reshape(len(rows), 3) if constants[0] else None
    return RowCode(code, way, bool(constants[1]))


def newton_code(*of: Any, **choices: bool) -> Code:
    """Return the code of ODE-GC's full Newton method for a kind of joint (``newton.newton_loops``).

    ``of`` and ``choices`` are its arguments.
    """
    return load_or_make_code("newton.newton_loops", *of, **choices)


def wrench_code(*of: Any, use_f_bar: bool) -> tuple[Code, int, int]:
    """Return the code of ODE-GC's simplified method for a kind of joint (``wrenches.wrench_loops``).

    With it, the numbers of matrix entries that it keeps of the start and of the end of a step.
    """
    code, sizes = load_or_make_code("wrenches.wrench_loops", *of, use_f_bar=use_f_bar), np.zeros(2)
    code.function("sizes", 1)(sizes.ctypes.data)
    return code, int(sizes[0]), int(sizes[1])


@cache
@making_code
def load_or_make_code(maker: str, kind: str = "", *of: Any, **choices: Any) -> Code:
    """Return the code that ``maker`` makes of a ``kind`` of joint or force, loaded from disk if it is kept there.

    ``maker`` is "module.function" of this folder; ``of`` and ``choices`` are its further arguments.
    """

    def print_code() -> str:
        module, function = maker.split(".")
        return print_functions(getattr(import_module(f".{module}", __package__), function)(*key, **choices))

    key = (kind, *of) if kind else of
    declared = {**joints.DECLARED, **forces.DECLARED}
    paths = {f.__code__.co_filename for f in vars(declared[kind]).values() if hasattr(f, "__code__")} if kind else ()
    return Code(print_code, f"{maker} {key} {choices}\0{texts_of_makers()}\0{digest_files(tuple(sorted(paths)))}")


@cache
@making_code
def texts_of_makers() -> str:
    """Return a digest of the text of all modules that make code, of all declarations, and CasADi's version."""
    here = Path(__file__).resolve().parent
    folders = (here, here.parent / "generated", Path(joints.__file__).parent / "kinds", Path(forces.__file__).parent)
    paths = [path for folder in folders for path in sorted(folder.glob("*.py"))]
    return digest_files((*map(str, paths), str(declaring.__file__), str(fixed_order.__file__))) + version("casadi")


@cache
def digest_files(paths: tuple[str, ...]) -> str:
    """Return a digest of the content of these files."""
    return hashlib.sha256(b"\0".join(Path(path).read_bytes() for path in paths)).hexdigest()
