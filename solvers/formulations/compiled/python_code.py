"""Compiled functions as the plain Python that they are written in, on the arrays of their bundles, for a debugger.

Machine code calls them by address as it calls itself. Numbers are NumPy's, so that division by zero gives what it gives
in machine code; sums and products are not contracted, and functions of ``math`` raise where machine code returns NaN.
"""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
USER_LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)
RAISED: list[BaseException] = []  # by a function that machine code called: at most one, until it is raised again


class Fields:
    """A record as compiled code sees it: fields are read and written by name."""

    def __init__(self, record: np.ndarray) -> None:
        object.__setattr__(self, "_record", record)

    def __getattr__(self, name: str) -> Any:
        return self._record[name][()]

    def __setattr__(self, name: str, value: float) -> None:
        self._record[name] = value


def view_records(bundle: Any) -> Any:
    """Return the bundle, and the bundles in it, with ``Fields`` in place of records."""
    given = {}
    for name, x in zip(bundle._fields, bundle, strict=True):
        if isinstance(x, np.ndarray) and x.dtype.names:
            given[name] = Fields(x)
        else:
            given[name] = view_records(x) if isinstance(x, tuple) else x
    return type(bundle)(**given)


class PythonFunction:
    """A function with its bundle, called by Python, or by machine code at ``address``."""

    def __init__(self, function: Callable[[Any], None], bundle: Any) -> None:
        self._function, self._bundle = function, view_records(bundle)
        self.address = self._make_address()

    def _make_address(self) -> int:
        """Return the address at which machine code calls this object."""
        self._callback = CALLBACK(self._run_for_machine_code)
        return int(ctypes.cast(self._callback, ctypes.c_void_p).value or 0)

    def __call__(self) -> None:
        self._function(self._bundle)

    def _run_for_machine_code(self, _: Any) -> None:
        """Run the function for machine code; store what it raises in ``RAISED``, and do nothing while that is full."""
        if not RAISED:
            try:
                self()
            except BaseException as error:  # Python would print and drop it, also a debugger's request to quit
                RAISED.append(error)


class PythonLoop(PythonFunction):
    """A generated loop over joints or forces of one kind: CasADi evaluates its expressions for each of them.

    ``loop`` is the ``Loop`` that machine code is made of, ``arrays`` are its arguments, the first of them the number of
    elements.
    """

    def __init__(self, loop: Any, arrays: Sequence[np.ndarray]) -> None:
        """Make a CasADi function of the expressions of ``loop``, and an address at which machine code calls it."""
        import casadi as ca

        self._loop, self._arrays = loop, arrays
        inputs, outputs = [*loop.whole, *loop.rows, *loop.blocks], [*loop.stored, *loop.added_blocks]
        self._evaluate = ca.Function("evaluate", inputs, outputs)
        self.address = self._make_address()

    def __call__(self) -> None:
        """Evaluate the expressions for each element in turn; store or add the results in the arrays."""
        members, left = int(self._arrays[0][0]), iter(self._arrays[1:])

        def list_parts(access: str) -> list[list[np.ndarray]]:
            """Return, for each expression of ``access``, views of the next array: the entries of each element.

            ``access`` is a field of ``Loop``: "whole" gives all elements the same entries, "rows" and "stored" one row
            each, and "blocks" and "added_blocks" those from the indices in a further array on.
            """
            parts = []
            for x in getattr(self._loop, access):
                array, size = next(left), x.numel()
                first = next(left) if "blocks" in access else np.arange(members) * (0 if access == "whole" else size)
                flat = np.ndarray(array.nbytes // 8, buffer=array)
                parts.append([flat[a : a + size] for a in first])
            return parts

        read = [part for access in ("whole", "rows", "blocks") for part in list_parts(access)]
        stored, added = list_parts("stored"), list_parts("added_blocks")
        for element in range(members):
            given = [part[element] for part in read]
            found = [np.array(x).ravel(order="F") for x in self._evaluate.call(given)]
            for k, part in enumerate((*stored, *added)):
                part[element][:] = found[k] if k < len(stored) else part[element] + found[k]


def raise_again() -> None:
    """Raise the exception of a function that machine code called, if there is one."""
    if RAISED:
        raise RAISED.pop()
