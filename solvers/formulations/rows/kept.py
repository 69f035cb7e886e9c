"""Machine code of joints and forces by kind, kept under the text of their declarations: kept code needs no CasADi."""

import hashlib
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics import declaring, forces, joints
from ..generated import Code
from ..generated.code import print_functions


class RowCode(NamedTuple):
    """Function ``rows``, and what it leaves out because it is constant: forces (n, 3) of rows, whether phi_t is 0."""

    code: Code
    way: np.ndarray | None
    still: bool


@cache
def row_code(kind: str, rows: tuple[int, ...], ground: bool) -> RowCode:
    """``loops.row_loop`` as code."""

    def functions(loops: ModuleType) -> dict[str, Any]:
        loop, way, still = loops.row_loop(kind, rows, ground)
        return {"rows": loop, "constants": loops.constants(way, still, len(rows))}

    code = _code(f"rows {kind} {rows} {ground}", functions, joints.DECLARED[kind])
    constants = np.zeros(2 + 3 * len(rows))
    code.function("constants", 1)(constants.ctypes.data)
    way = constants[2:].reshape(len(rows), 3) if constants[0] else None
    return RowCode(code, way, bool(constants[1]))


@cache
def row_slope_code(kind: str, rows: tuple[int, ...], ground: bool) -> Code:
    """Functions ``load_slopes`` and ``rate_slopes``."""

    def functions(loops: ModuleType) -> dict[str, Any]:
        return {
            "load_slopes": loops.load_slope_loop(kind, rows, ground),
            "rate_slopes": loops.rate_slope_loop(kind, rows, ground),
        }

    return _code(f"row slopes {kind} {rows} {ground}", functions, joints.DECLARED[kind])


@cache
def push_code(kind: str, ground: bool) -> Code:
    """Function ``push``."""
    return _code(f"push {kind} {ground}", lambda loops: {"push": loops.push_loop(kind, ground)}, forces.DECLARED[kind])


@cache
def push_slope_code(kind: str, ground: bool) -> Code:
    """Function ``slopes``."""
    of = forces.DECLARED[kind]
    return _code(f"push slopes {kind} {ground}", lambda loops: {"slopes": loops.push_slope_loop(kind, ground)}, of)


@cache
def mean_row_code(kind: str, rows: tuple[int, ...], ground: bool) -> Code:
    """Function ``rows`` of ``means.mean_row_loop``."""
    return _code(
        f"mean rows {kind} {rows} {ground}", lambda loops: {"rows": _means().mean_row_loop(kind, rows, ground)},
        joints.DECLARED[kind],
    )  # fmt: skip


@cache
def mean_push_code(kind: str, ground: bool) -> Code:
    """Function ``push`` of ``means.mean_push_loop``."""
    of = forces.DECLARED[kind]
    return _code(f"mean push {kind} {ground}", lambda loops: {"push": _means().mean_push_loop(kind, ground)}, of)


@cache
def newton_code(kind: str, rows: tuple[int, ...], ground: bool, direction: int, **choices: bool) -> Code:
    """Functions of ``newton.newton_loops``."""

    def functions(_: ModuleType) -> dict[str, Any]:
        from . import newton  # and CasADi

        return dict(newton.newton_loops(kind, rows, ground, direction, **choices))

    return _code(f"newton {kind} {rows} {ground} {direction} {choices}", functions, joints.DECLARED[kind])


@cache
def wrench_code(
    kind: str, rows: tuple[int, ...], ground: bool, direction: int, *, use_f_bar: bool
) -> tuple[Code, int, int]:
    """Functions of ``wrenches.wrench_loops``, and how many entries of the start and of the end are kept."""

    def functions(_: ModuleType) -> dict[str, Any]:
        from . import wrenches  # and CasADi

        return wrenches.wrench_loops(kind, rows, ground, direction, use_f_bar=use_f_bar)

    code = _code(f"wrenches {kind} {rows} {ground} {direction} {use_f_bar}", functions, joints.DECLARED[kind])
    sizes = np.zeros(2)
    code.function("sizes", 1)(sizes.ctypes.data)
    return code, int(sizes[0]), int(sizes[1])


def _means() -> ModuleType:
    from . import means  # and CasADi

    return means


@cache
def body_code() -> Code:
    """Functions ``forces``, ``applied``, ``slopes`` and ``zero``."""

    def functions(loops: ModuleType) -> dict[str, Any]:
        return {
            "forces": loops.body_loop(gyroscopic=True), "applied": loops.body_loop(gyroscopic=False),
            "slopes": loops.body_slope_loop(), "zero": loops.zero_loop(),
        }  # fmt: skip

    return _code("bodies", functions)


def _code(name: str, functions: Callable[[ModuleType], dict[str, Any]], *declared: Any) -> Code:
    def printed() -> str:
        from . import loops  # and CasADi

        return print_functions(functions(loops))

    paths = {f.__code__.co_filename for one in declared for f in vars(one).values() if hasattr(f, "__code__")}
    return Code(printed, f"{name}\0{texts()}\0{_text(tuple(sorted(paths)))}")


@cache
def texts() -> str:
    """A digest of the modules that make code of declarations, of all that the project declares, and of CasADi."""
    here = Path(__file__).resolve().parent
    folders = (here, here.parent / "generated", Path(joints.__file__).parent / "kinds", Path(forces.__file__).parent)
    paths = [path for folder in folders for path in sorted(folder.glob("*.py"))]
    return _text((*map(str, paths), str(declaring.__file__))) + version("casadi")


@cache
def _text(paths: tuple[str, ...]) -> str:
    return hashlib.sha256(b"\0".join(Path(path).read_bytes() for path in paths)).hexdigest()
