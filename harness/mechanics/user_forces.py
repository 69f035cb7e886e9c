"""Define forces that a user writes as a function of time and of the state of two bodies.

    law(t, r, R, v, Omega, F, T)

t [s]; r, v, Omega (2, 3) and R (2, 3, 3) of body i and body j, as in ``State``; of the ground r = v = Omega = 0, R = I.
The law fills F (2, 3) [N], which acts at each C, and T (2, 3) [N m], about it, both in space; they come as zeros, and
the row of the ground is ignored. Numba compiles it once, to an address that kernels call
(module ``kept_code``).
"""

import ctypes
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import FunctionType
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from .kept_code import compile_callback
from .state import States

NUMBERS = 36  # r, R, v, Omega of two bodies, in this order
SI = (1.0, 1.0, 1.0)
POINTER = ctypes.POINTER(ctypes.c_double)
BODY_MIRROR = np.diag([1.0, 1.0, -1.0])  # mirror of every body frame, so that a mirrored R is a rotation again


@dataclass(frozen=True)
class UserForce:
    """A force by the function ``law`` between two bodies, in plain Python or decorated with ``numba.njit``."""

    law: Callable[..., None]
    i: int
    j: int = -1  # the ground


@dataclass(frozen=True, eq=False)
class ForceLaw:
    """A user's law in the space and the units of a system: ``frame`` takes vectors of its space to the system's."""

    function: Callable[..., None]  # plain Python
    bodies: int  # 2, or 1 beside the ground
    frame: Float[np.ndarray, "3 3"]
    units: tuple[float, float, float] = SI  # factors of the numbers of a length, a mass, a time

    def build_function(self, compiled: Callable[[Any], Any] = lambda f: f) -> Callable[..., None]:
        """Return the law as a function of the state in the system's space and units, with the same arguments.

        It converts the state to the user's space and SI, and the forces back; without a change of either it is the
        user's function. ``compiled`` compiles a function, as ``numba.njit`` does; by default all stays Python.
        """
        law = compiled(self.function)
        L, M, T = self.units
        if self.units == SI and np.array_equal(self.frame, np.eye(3)):
            return law
        n, back, there = self.bodies, np.array(self.frame), np.ascontiguousarray(self.frame.T)
        mirrored = np.linalg.det(self.frame) < 0.0
        body, sign = (BODY_MIRROR, -1.0) if mirrored else (np.eye(3), 1.0)
        force = M * L / T**2

        def in_si(t, r, R, v, Omega, F, moment):  # type: ignore[no-untyped-def]
            """Convert the state in place to the user's space and SI, call the law, and convert F and moments back."""
            for e in range(n):
                r[e] = np.dot(r[e] / L, back)
                v[e] = np.dot(v[e] * (T / L), back)
                R[e] = np.dot(np.dot(there, R[e]), body)
                Omega[e] = sign * T * np.dot(Omega[e], body)
            law(t / T, r, R, v, Omega, F, moment)
            for e in range(n):
                F[e] = force * np.dot(F[e], there)
                moment[e] = sign * force * L * np.dot(moment[e], there)

        return compiled(in_si)

    @cached_property
    def entry(self) -> Any:
        """The compiled law as a C function of t and two pointers: to ``NUMBERS`` of the state, to F and T of both."""
        import numba  # takes half a second, which systems without user forces are spared

        law, double = self.build_function(numba.njit), numba.types.double

        def entry(t, state, load):  # type: ignore[no-untyped-def]
            """Call the law with the state in C's memory, and write F and T there; NaN if it raises."""
            x, out, found = numba.carray(state, (NUMBERS,)), numba.carray(load, (4, 3)), np.zeros((4, 3))
            out[:] = np.nan  # remains where the law raises an error, which C cannot pass on
            r, v, Omega = x[:6].reshape(2, 3), x[24:30].reshape(2, 3), x[30:].reshape(2, 3)
            law(t, r, x[6:24].reshape(2, 3, 3), v, Omega, found[:2], found[2:])
            out[:] = found

        pointer = numba.types.CPointer(double)
        return compile_callback(entry, numba.types.void, double, pointer, pointer)

    def evaluate(self, s: States, i: int, j: int) -> Float[np.ndarray, "nt 4 3"]:
        """Return the forces on i and on j [N], then the torques [N m], in space, at each time of ``s``."""
        out, call = np.zeros((len(s), 4, 3)), self.entry.ctypes
        ends = [(s.r[:, b], s.R[:, b], s.v[:, b], s.Omega[:, b]) for b in (i, j) if b >= 0]
        rest = np.zeros((len(s), 3))
        ends += [(rest, np.broadcast_to(np.eye(3), (len(s), 3, 3)), rest, rest)] * (2 - len(ends))
        # a row per time: r of i and of j, then R, v and Omega likewise
        x = np.concatenate([a.reshape(len(s), -1) for of_both in zip(*ends, strict=True) for a in of_both], axis=1)
        for k, t in enumerate(s.times):
            call(t, x[k].ctypes.data_as(POINTER), out[k].ctypes.data_as(POINTER))
        return out


def present_laws(
    laws: Shaped[np.ndarray, " nu"], frame: Float[np.ndarray, "3 3"], units: tuple[float, float, float] = SI
) -> Shaped[np.ndarray, " nu"]:
    """Return the same laws in a space rotated or mirrored by ``frame``, with units scaled by ``units``.

    ``units`` are the factors of the numbers of a length, a mass and a time; both changes follow those made before.
    """
    out = np.empty(len(laws), dtype=object)
    for k, law in enumerate(laws):
        L, M, T = (a * b for a, b in zip(law.units, units, strict=True))
        out[k] = replace(law, frame=frame @ law.frame, units=(L, M, T))
    out.setflags(write=False)
    return out


def compile_laws(forces: Sequence[UserForce]) -> Shaped[np.ndarray, " nu"]:
    """Compile the laws of ``forces``; return a read-only array with the ``ForceLaw`` of each force.

    A law shared by several forces is compiled once per number of bodies (2, or 1 beside the ground). Raise ValueError,
    naming the force, for a law that is not a Python function or that numba does not compile.
    """
    made: dict[tuple[Callable[..., None], int], ForceLaw] = {}
    out = np.empty(len(forces), dtype=object)
    for k, force in enumerate(forces):
        function = getattr(force.law, "py_func", force.law)  # the Python function that numba.njit decorated
        bodies = 2 if force.j >= 0 else 1
        if not isinstance(function, FunctionType):
            raise ValueError(f"{_describe_failure(k)}: it must be a function defined in Python (got {function!r:.80})")
        if (function, bodies) not in made:
            made[function, bodies] = _compile_law(k, ForceLaw(function, bodies, np.eye(3)))
        out[k] = made[function, bodies]
    out.setflags(write=False)
    return out


def _compile_law(k: int, law: ForceLaw) -> ForceLaw:
    """Compile a law and return it; raise ValueError, which names user force ``k``, if numba cannot."""
    import numba

    if numba.config.DISABLE_JIT:
        raise ValueError(f"user force {k} needs numba's compiler: unset NUMBA_DISABLE_JIT")
    try:
        law.entry  # noqa: B018 - compiled here, where a mistake is the user's
    except Exception as error:  # besides its own errors, Numba passes Python's on
        reason = textwrap.shorten(str(error), 200, placeholder=" ...") or type(error).__name__
        raise ValueError(f"{_describe_failure(k)}: {reason}") from None
    return law


def _describe_failure(k: int) -> str:
    """Return the beginning of the message that numba does not compile user force ``k``."""
    return f"user force {k}: numba does not compile law(t, r, R, v, Omega, F, T)"
