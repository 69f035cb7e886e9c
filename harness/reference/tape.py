"""Record a route's algebra, written once in NumPy, on a tape that CasADi evaluates without Python.

The function runs once on arrays of symbols; one call then evaluates its result for many states, in a tenth of NumPy's
time on small arrays, and each route has one set of formulas only.
"""

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

TWO_PI = 2.0 * np.pi


class TapeNumber:
    """A number of a tape, which wraps CasADi's symbol ``x`` so that NumPy takes it for one element of an array."""

    __slots__ = ("x",)

    def __init__(self, x: Any) -> None:
        """Wrap CasADi's symbol ``x``."""
        self.x = x

    def __neg__(self) -> "TapeNumber":
        """Return -x."""
        return TapeNumber(-self.x)

    def __mod__(self, other: float) -> "TapeNumber":
        """Return the floored remainder, which has the sign of the divisor as in Python."""
        return TapeNumber(self.x - other * (self.x / other).floor())

    def __pow__(self, n: int) -> "TapeNumber":
        """Return x to the whole power n."""
        return TapeNumber(self.x**n)

    def sqrt(self) -> "TapeNumber":
        """Return the square root, as ``np.sqrt`` calls this method; NumPy's other functions call those below."""
        return TapeNumber(self.x.sqrt())

    def sin(self) -> "TapeNumber":
        """Return the sine, for ``np.sin``."""
        return TapeNumber(self.x.sin())

    def cos(self) -> "TapeNumber":
        """Return the cosine, for ``np.cos``."""
        return TapeNumber(self.x.cos())

    def rint(self) -> "TapeNumber":
        """Return the nearest whole number, halves upwards, for ``np.round``."""
        return TapeNumber((self.x + 0.5).floor())

    def arctan2(self, other: Any) -> "TapeNumber":
        """Return the angle of the point (other, self), for ``np.arctan2(self, other)``."""
        import casadi as ca

        return TapeNumber(ca.atan2(self.x, _unwrap_number(other)))


ZERO = TapeNumber(None)  # most matrix entries: operations with it are not recorded, which saves nine tenths of the time


def _unwrap_number(a: Any) -> Any:
    """Return the CasADi symbol of a ``TapeNumber``, or any other number as a float."""
    return a.x if isinstance(a, TapeNumber) else float(a)


def _make_operator(name: str, swap: bool) -> Callable[[TapeNumber, Any], Any]:
    """Return the method of ``TapeNumber`` for the operator ``name``, such as "add", which does not record zeros.

    With ``swap`` it is the reflected method, with the ``TapeNumber`` on the right.
    """
    act = getattr(operator, name)

    def apply_operator(self: TapeNumber, other: Any) -> Any:
        """Apply the operator, without recording sums with zero or products with it."""
        if isinstance(other, np.ndarray):
            return NotImplemented  # NumPy then proceeds element by element
        zero = other is ZERO or (not isinstance(other, TapeNumber) and other == 0.0)
        if name == "mul" and (zero or self is ZERO):
            return ZERO
        if name == "add" and zero:
            return self
        if name == "add" and self is ZERO and isinstance(other, TapeNumber):
            return other
        a, b = self.x, _unwrap_number(other)
        return TapeNumber(act(b, a) if swap else act(a, b))

    return apply_operator


for _name in ("add", "sub", "mul", "truediv"):
    setattr(TapeNumber, f"__{_name}__", _make_operator(_name, False))
    setattr(TapeNumber, f"__r{_name}__", _make_operator(_name, True))


class TapeMemory(NamedTuple):
    """The arrays of a compiled evaluation at some number of states, and how to run it."""

    states: np.ndarray  # (nt, n) input
    found: np.ndarray  # (nt, m) entries that are not zero in every state
    whole: np.ndarray  # (nt, size) all entries
    arrays: tuple[np.ndarray, ...]  # views of ``whole`` in the shapes of the results
    run: Callable[[], None]
    buffer: Any  # CasADi's, to be kept alive


class Tape:
    """A compiled evaluation at many states (nt, n) of a ``function`` that is written for one state (n,)."""

    def __init__(self, function: Callable[[np.ndarray], tuple[np.ndarray, ...]], n: int) -> None:
        """Record and compile ``function``, which returns arrays, on symbols of one state with ``n`` entries."""
        import casadi as ca

        ZERO.x = ca.SX(0.0)
        y = ca.SX.sym("y", n)
        state = np.empty(n, dtype=object)
        state[:] = [TapeNumber(y[k]) for k in range(n)]
        found = [np.asarray(a) for a in function(state)]
        self._shapes = [a.shape for a in found]
        self._ends = np.cumsum([a.size for a in found])
        out = ca.sparsify(ca.vertcat(*(_unwrap_number(a) for array in found for a in array.ravel())))
        self._rows = np.array(out.sparsity().row(), dtype=np.int64)  # of the entries that are not zero in every state
        self._one = ca.Function("terms", [y], [out.nz[:]])
        self._memories: dict[int, TapeMemory] = {}  # by number of states

    def __call__(self, y: Float[np.ndarray, "nt n"]) -> tuple[np.ndarray, ...]:
        """Return the arrays of ``function`` at the states ``y`` (nt, n), with the states as first axis.

        The arrays returned are views of memory that the next call with as many states overwrites.
        """
        nt = len(y)
        if nt not in self._memories:
            buffer, run = (self._one if nt == 1 else self._one.map(nt)).buffer()
            states, found = np.empty(y.shape), np.empty((nt, len(self._rows)))
            buffer.set_arg(0, states.data)
            buffer.set_res(0, found.data)
            whole = np.zeros((nt, int(self._ends[-1])))
            split = zip(np.split(whole, self._ends[:-1], axis=1), self._shapes, strict=True)
            arrays = tuple(a.reshape(nt, *shape) for a, shape in split)
            self._memories[nt] = TapeMemory(states, found, whole, arrays, run, buffer)
        memory = self._memories[nt]
        memory.states[:] = y
        memory.run()
        memory.whole[:, self._rows] = memory.found
        return memory.arrays
