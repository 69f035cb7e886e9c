"""SUNDIALS IDA from the libraries that scikit-sundae contains, with residuals in machine code that calls no Python.

It replaces scikit-sundae's own interface, which copies vectors, records every step, and passes full matrices for banded
Jacobians.
"""

import ctypes
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ...harness.base.code_meter import making_code
from ...harness.base.generated import Program
from ...harness.base.generated.residual import compile_residual
from ...harness.base.private_interfaces import locate_sundials
from ...harness.mechanics.types import NotInstalled
from .packages import find_remedy

ADDRESS, NUMBER, FLAG = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
BY_COLUMNS, ONE_STEP, ONE_STEP_LIMIT = 0, 2, 100_000  # CSC_MAT, IDA_ONE_STEP; IDA's own limit a call
REMEDY = (
    "pip install scikit-sundae; where it has no wheel (Linux on arm64), build SUNDIALS with SuperLU_MT first, and name "
    "its folder by SUNDIALS_PREFIX"
)
OUT_OF_MEMORY = -21  # IDA_MEM_FAIL
OUT_OF_TIME = (-8, -12)  # IDA's flags of a residual that fails, which it does here at the deadline alone
CREATORS = ("SUNDense", "SUNBand", "SUNSparse", "SUNLinSol_", "N_V", "IDACreate")  # return addresses, others flags


def refuse_if_missing() -> NotInstalled | None:
    """Return how to install scikit-sundae where it is missing; else import it, and return None.

    Importing it here excludes the import from a solver's CPU time.
    """
    if (reason := find_remedy("sksundae", "scikit-sundae", REMEDY)) is None:
        with making_code:
            import_module("sksundae")
    return reason


@dataclass(frozen=True)
class IdaEquations:
    """F(t, y, y') = 0 in IDA's order: the program ``evaluate`` computes ``F`` from ``t``, ``y`` and ``y_dot``."""

    evaluate: Program
    t: Float[np.ndarray, " 1"]
    y: Float[np.ndarray, " n"]
    y_dot: Float[np.ndarray, " n"]
    F: Float[np.ndarray, " n"]
    jacobian: Callable[[float], Float[np.ndarray, " nnz"]]  # dF/dy + cj dF/dy' at t, y, y_dot
    rows: Int[np.ndarray, " nnz"]
    columns: Int[np.ndarray, " nnz"]


class Ida:
    """IDA on ``equations``, whose ``y`` and ``y_dot`` are the initial values; a context manager."""

    def __init__(
        self,
        equations: IdaEquations,
        linear_solver: str,
        *,
        rtol: float,
        atol: Float[np.ndarray, " n"],
        first_step: float,
        max_step: float,
        seconds: float | None,
        start: float = 0.0,
    ) -> None:
        """Prepare IDA at the initial values; steps fail after ``seconds`` of CPU time from now, if that is given.

        ``linear_solver`` is "dense", "band" or "sparse"; a ``first_step`` or ``max_step`` [s] of 0 is left to IDA;
        ``start`` is the initial time [s].
        """
        self._equations, self._stack, self._messages = equations, ExitStack(), list[str]()
        self._failure: BaseException | None = None
        self._indices = list[tuple[np.ndarray, np.ndarray]]()  # index arrays of a sparse matrix, and their values
        self.jacobians = 0
        n = len(equations.y)
        self._solution = tuple(x.copy() for x in (equations.y, equations.y_dot))
        context = ADDRESS()
        _check(_function("SUNContext_Create")(FLAG(0), ctypes.byref(context)))
        self._free_at_exit("SUNContext_Free", ctypes.byref(context))
        self._hear_c = ctypes.CFUNCTYPE(None, FLAG, *[ctypes.c_char_p] * 3, FLAG, ADDRESS, ADDRESS)(self._store_message)
        _check(_function("SUNContext_ClearErrHandlers")(context))
        _check(_function("SUNContext_PushErrHandler")(context, self._hear_c, None))
        self._atol = atol.copy()
        y, y_dot, tolerances = (self._make_vector(x, context) for x in (*self._solution, self._atol))
        matrix, solver = self._make_linear_solver(linear_solver, n, y, context)
        self._memory = _allocate("IDACreate", context)
        self._free_at_exit("IDAFree", ctypes.byref(self._memory))
        code, limit = compile_residual(), 2**62 if seconds is None else int((time.process_time() + seconds) * 1e6)
        own = (equations.y, equations.y_dot, equations.F)
        run, (program,) = equations.evaluate.step
        self._work = np.array(
            [
                0,
                limit,
                ctypes.cast(_function("N_VGetArrayPointer"), ADDRESS).value,
                *(x.ctypes.data for x in own),
                own[0].nbytes,
                equations.t.ctypes.data,
                run,
                program.ctypes.data,
            ],
            dtype=np.int64,
        )
        self._jacobian = ctypes.CFUNCTYPE(FLAG, NUMBER, NUMBER, *[ADDRESS] * 8)(self._fill_jacobian)
        for name, *arguments in (
            ("IDAInit", ADDRESS(code.address("residual")), NUMBER(start), y, y_dot),
            ("IDASetUserData", ADDRESS(self._work.ctypes.data)),
            ("IDASVtolerances", NUMBER(rtol), tolerances),
            ("IDASetLinearSolver", solver, matrix),
            ("IDASetJacFn", self._jacobian),
            # SUNDIALS scales a correction for the steps since its matrix was made, multipliers with it, which no test
            # holds: they grew from rounding wherever nothing else needs a second iteration. Without, and with Newton's
            # test at 0.1 of the error test in place of 0.33, IDA errs less: 0.75 times (median of 99 pairs of runs), in
            # 0.88 times as many steps with as many evaluations
            ("IDASetLinearSolutionScaling", FLAG(0)),
            ("IDASetNonlinConvCoef", NUMBER(0.1)),
            ("IDASetInitStep", NUMBER(first_step)),
            ("IDASetMaxStep", NUMBER(max_step)),
            ("IDASetMaxNumSteps", ctypes.c_long(ONE_STEP_LIMIT)),
        ):
            _check(_function(name)(self._memory, *arguments))
        self._t = NUMBER(start)
        self._step = _function("IDASolve"), ctypes.byref(self._t), y, y_dot, FLAG(ONE_STEP)

    def __enter__(self) -> "Ida":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    @property
    def evaluations(self) -> int:
        """Number of residuals F(t, y, y') that SUNDIALS evaluated."""
        return int(self._work[0])

    @property
    def messages(self) -> str:
        """Error messages of SUNDIALS so far, on one line."""
        return " ".join(self._messages)

    def stop_at(self, t: float) -> None:
        """Set the time [s] that no step may pass."""
        _check(_function("IDASetStopTime")(self._memory, NUMBER(t)))

    def step(self, t_end: float) -> tuple[int, float, Float[np.ndarray, " n"]]:
        """Take one step towards ``t_end`` [s]; return IDA's flag (negative: it failed), its time and y.

        y is an array that the next step overwrites. An exception in the Jacobian is raised again here.
        """
        solve, t, y, y_dot, how = self._step
        flag = solve(self._memory, NUMBER(t_end), t, y, y_dot, how)
        if self._failure is not None:
            raise self._failure
        return flag, self._t.value, self._solution[0]

    def _make_vector(self, x: np.ndarray, context: Any) -> Any:
        """Return the address of a SUNDIALS vector over the memory of ``x``; the vector is freed with this object."""
        out = _allocate("N_VMake_Serial", _find_index_type()(len(x)), ADDRESS(x.ctypes.data), context)
        self._free_at_exit("N_VDestroy", out)
        return out

    def _make_linear_solver(self, kind: str, n: int, y: Any, context: Any) -> tuple[Any, Any]:
        """Make Newton's matrix and its linear solver, and return the addresses of both.

        The memory of the matrix, and the position in it of each nonzero of the Jacobian, are stored for
        ``_fill_jacobian``. ``kind`` is "dense", "band" or "sparse"; ``n`` is the number of unknowns; ``y`` and
        ``context`` are addresses of SUNDIALS' objects.
        """
        INDEX, rows, columns = _find_index_type(), self._equations.rows, self._equations.columns
        below, above = int(np.max(rows - columns)), int(np.max(columns - rows))
        name, solver_name, threads = kind.capitalize(), f"SUNLinSol_{kind.capitalize()}", list[Any]()
        sizes: list[Any]
        if kind == "dense":
            size, sizes, places = n * n, [INDEX(n)], columns * n + rows
        elif kind == "band":
            height = 2 * below + above + 1  # with room for pivoting
            size, sizes, places = (
                n * height,
                [INDEX(above), INDEX(below)],
                columns * (height - 1) + rows + below + above,
            )
        else:
            size, sizes, places = len(rows), [INDEX(n), INDEX(len(rows)), FLAG(BY_COLUMNS)], np.arange(len(rows))
            solver_name, threads = "SUNLinSol_SuperLUMT", [FLAG(1)]  # more take milliseconds to set out
        matrix = _allocate(f"SUN{name}Matrix", INDEX(n), *sizes, context)
        self._free_at_exit("SUNMatDestroy", matrix)
        self._data, self._places = _view_memory(_function(f"SUN{name}Matrix_Data")(matrix), NUMBER, size), places
        if kind == "sparse":
            starts = np.searchsorted(columns, np.arange(n + 1))
            for part, x in (("Values", rows), ("Pointers", starts)):
                address = _function(f"SUNSparseMatrix_Index{part}")(matrix)
                self._indices.append((_view_memory(address, INDEX, len(x)), x))
        solver = _allocate(solver_name, y, matrix, *threads, context)
        self._free_at_exit("SUNLinSolFree", solver)
        return matrix, solver

    def _fill_jacobian(self, t: float, cj: float, y: int, y_dot: int, *rest: int) -> int:
        """Fill the matrix dF/dy + ``cj`` dF/dy' for IDA; return 0, or -1 after an exception, which is stored.

        ``y`` and ``y_dot`` are addresses of vectors. SUNDIALS has set the matrix to zero.
        """
        try:
            self.jacobians += 1
            self._equations.t[0] = t
            for own, vector in ((self._equations.y, y), (self._equations.y_dot, y_dot)):
                ctypes.memmove(own.ctypes.data, _function("N_VGetArrayPointer")(ADDRESS(vector)), own.nbytes)
            self._data[self._places] = self._equations.jacobian(cj)
            for target, x in self._indices:
                target[:] = x
        except BaseException as error:  # no exception may pass through C
            self._failure = error
            return -1
        return 0

    def _store_message(self, line: int, function: bytes, file: bytes, message: bytes, code: int, *rest: int) -> None:
        """Store an error message of SUNDIALS, as its error handler."""
        self._messages.append(f"[{function.decode()}, Error: {code}] {message.decode().strip()}")

    def _free_at_exit(self, name: str, what: Any) -> None:
        """Store a call of SUNDIALS' function ``name`` on the object ``what``, to be made when this object is closed."""
        self._stack.callback(_function(name), what)


def _view_memory(address: int, kind: Any, size: int) -> np.ndarray:
    """Return an array of ``size`` numbers of the C type ``kind`` over the memory at ``address``."""
    return np.ctypeslib.as_array((kind * size).from_address(address))


def _allocate(name: str, *arguments: Any) -> Any:
    """Return the address of the object made by SUNDIALS' function ``name``; raise MemoryError where it is NULL."""
    address = _function(name)(*arguments)
    if not address:
        raise MemoryError(f"{name} of SUNDIALS had no memory")
    return ADDRESS(address)


def _check(flag: int) -> None:
    """Raise MemoryError or RuntimeError if ``flag``, the result of a call of SUNDIALS, reports a failure."""
    if flag == OUT_OF_MEMORY:
        raise MemoryError("SUNDIALS had no memory")
    if flag < 0:
        raise RuntimeError(f"SUNDIALS refused a setting (flag {flag})")


@cache
def _find_index_type() -> Any:
    """Return the C type of SUNDIALS' indices, 32 or 64 bits as it was built."""
    return np.ctypeslib.as_ctypes_type(locate_sundials()[1])


@cache
def _function(name: str) -> Any:
    """Return SUNDIALS' function ``name`` as a ctypes function; its result is an address or a flag."""
    function = getattr(ctypes.CDLL(locate_sundials()[0]), name)
    function.restype = ADDRESS if name.startswith(CREATORS) else FLAG
    return function
