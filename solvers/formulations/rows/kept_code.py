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
    """Function ``rows``, and what it leaves out because it is constant: forces (n, 3) of rows, whether phi_t is 0."""

    code: Code
    way: np.ndarray | None
    still: bool


@cache
@making_code
def row_code(kind: str, rows: tuple[int, ...], ground: bool) -> RowCode:
    """``loops.rows`` as code."""
    code = code_of("loops.rows", kind, rows, ground)
    constants = np.zeros(2 + 3 * len(rows))
    code.function("constants", 1)(constants.ctypes.data)
    way = constants[2:].reshape(len(rows), 3) if constants[0] else None
    return RowCode(code, way, bool(constants[1]))


def newton_code(*of: Any, **choices: bool) -> Code:
    """Functions of ``newton.newton_loops``."""
    return code_of("newton.newton_loops", *of, **choices)


def wrench_code(*of: Any, use_f_bar: bool) -> tuple[Code, int, int]:
    """Functions of ``wrenches.wrench_loops``, and how many entries of the start and of the end are kept."""
    code, sizes = code_of("wrenches.wrench_loops", *of, use_f_bar=use_f_bar), np.zeros(2)
    code.function("sizes", 1)(sizes.ctypes.data)
    return code, int(sizes[0]), int(sizes[1])


@cache
@making_code
def code_of(maker: str, kind: str = "", *of: Any, **choices: Any) -> Code:
    """What ``maker``, a function of a module of this folder, makes of a kind of joint or force."""

    def print_code() -> str:
        module, function = maker.split(".")
        return print_functions(getattr(import_module(f".{module}", __package__), function)(*key, **choices))

    key = (kind, *of) if kind else of
    declared = {**joints.DECLARED, **forces.DECLARED}
    paths = {f.__code__.co_filename for f in vars(declared[kind]).values() if hasattr(f, "__code__")} if kind else ()
    return Code(print_code, f"{maker} {key} {choices}\0{texts_of_makers()}\0{text_of(tuple(sorted(paths)))}")


@cache
@making_code
def texts_of_makers() -> str:
    """A digest of the modules that make code of declarations, of all that the project declares, and of CasADi."""
    here = Path(__file__).resolve().parent
    folders = (here, here.parent / "generated", Path(joints.__file__).parent / "kinds", Path(forces.__file__).parent)
    paths = [path for folder in folders for path in sorted(folder.glob("*.py"))]
    return text_of((*map(str, paths), str(declaring.__file__), str(fixed_order.__file__))) + version("casadi")


@cache
def text_of(paths: tuple[str, ...]) -> str:
    """A digest of these files."""
    return hashlib.sha256(b"\0".join(Path(path).read_bytes() for path in paths)).hexdigest()
