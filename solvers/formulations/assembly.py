"""Elements evaluated in batches and summed into one vector: one compiled loop for each kind gathers and scatters.

The code of a kind serves any number of bodies and joints (``generated.Loop``), so mechanisms share it. An ``Assembly``
owns the arrays that it reads and writes: one instance serves one run at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float, Int

from ...harness.base.code_meter import making_code
from ...harness.base.generated import Code, Loop, Program, compile_functions
from ...harness.base.generated.steps import set_to_zero
from .layout import Layout
from .symbolic import ELEMENTS, Element


@dataclass(frozen=True)
class Batch:
    """An ``element`` for m parts: their parameters, indices of inputs z and w, and indices of outputs (-1: dropped)."""

    element: Element
    parameters: Float[np.ndarray, "m n_parameters"]
    z: Int[np.ndarray, "m n_z"]
    w: Int[np.ndarray, "m n_w"]
    out: Int[np.ndarray, "m n_out"]


class Assembly:
    """The sum of the outputs of all elements, out(y, w), and the nonzeros of its derivatives by y and w."""

    def __init__(self, layout: Layout, batches: Sequence[Batch], n_out: int, *, differentiable: bool) -> None:
        """Compile the elements, and allocate inputs and ``n_out`` outputs; derivatives only if ``differentiable``."""
        self._batches = [b for b in batches if len(b.z)]
        self._y = np.concatenate((np.zeros(layout.n), layout.constants))
        self._w = np.zeros(layout.n_u + 6)
        self.y, self.t, self.w = self._y[: layout.n], self._y[-1:], self._w[: layout.n_u]  # inputs of the programs
        self._codes = [_compile_element(b.element, derivative=differentiable) for b in self._batches]
        sparsities = [code.sparsity for code in self._codes if differentiable]
        self.row, self.column, self.of_w = _index_derivatives(self._batches[: len(sparsities)], sparsities)
        self.column[self.column >= np.where(self.of_w, layout.n_u, layout.n)] = -1  # constants
        self.out = np.zeros(n_out + 1)  # the outputs after ``evaluate``, and a spare one
        self.evaluate = self._make_program("values", self.out, _concatenate([b.out for b in self._batches]))

    def values(
        self, y: Float[np.ndarray, " n"], w: Float[np.ndarray, " n_u"], t: float = 0.0
    ) -> Float[np.ndarray, " n_out"]:
        """Evaluate all outputs at unknowns ``y``, accelerations ``w`` and time ``t`` [s], and return a copy of them."""
        self.set_inputs(y, w, t)
        self.evaluate.run()
        return self.out[:-1].copy()

    def make_derivative_program(
        self,
        data: Float[np.ndarray, " slots"],
        place: Int[np.ndarray, " n_entries"],
        weight: Float[np.ndarray, " n_entries"],
    ) -> Program:
        """Return a program that adds ``weight`` times the derivative of each entry to ``data[place]``.

        The derivative is d out[``row``] / d (w if ``of_w`` else y)[``column``]. The last element of ``data`` is a
        dummy: entries with ``place`` -1 are added there. Entries whose row or column is -1 (constants and dropped
        outputs) must have ``place`` -1. The program evaluates the derivatives at the values set by ``set_inputs``.
        """
        return self._make_program("derivatives", data, place, weight)

    def set_inputs(self, y: Float[np.ndarray, " n"], w: Float[np.ndarray, " n_u"], t: float) -> None:
        """Set the unknowns ``y``, accelerations ``w`` and time ``t`` [s] at which the programs evaluate."""
        self.y[:], self.w[:], self.t[0] = y, w, t

    def _make_program(
        self, name: str, target: np.ndarray, place: np.ndarray, weight: np.ndarray | None = None
    ) -> Program:
        """Return a program that runs the function ``name`` of every batch at the inputs set by ``set_inputs``.

        ``name`` is "values" or "derivatives". Results are added to ``target[place]``, or to its last element, a dummy,
        where ``place`` is -1. Without ``weight`` the target is set to zero first; with it, each result is multiplied by
        its weight.
        """
        place, start = np.where(place < 0, len(target) - 1, place), 0
        steps = [set_to_zero(target)] if weight is None else []
        for code, b in zip(self._codes, self._batches, strict=True):
            size = len(b.z) * code.sizes[name]
            own = slice(start, start + size)  # the results of this batch
            start += size
            rows = [np.ascontiguousarray(b.parameters, dtype=float)]
            rows += [] if weight is None else [weight[own].astype(float)]
            z, w = (np.ascontiguousarray(a, dtype=np.int64) for a in (b.z, b.w))
            arrays = [np.array([len(b.z)]), *rows, self._y, z, self._w, w, target, place[own].copy()]
            steps.append((code.code.address(name), arrays))
        return Program(steps, self._codes)


class _Compiled(NamedTuple):
    """The code of one kind of element, the number of results of each function, and the sparsity of the derivatives."""

    code: Code
    sizes: dict[str, int]
    sparsity: ca.Sparsity


@lru_cache(ELEMENTS)
@making_code
def _compile_element(e: Element, *, derivative: bool) -> _Compiled:
    """Compile the loops over all parts of one kind of element, with their sizes and a sparsity pattern.

    Function "values" adds the outputs of each part to the vector that it is called with; "derivatives", if
    ``derivative``, the nonzeros of d out / d (z, w) times a weight each. Sizes are those of one part's contribution by
    function; the pattern is that of d out / d (z, w) if ``derivative``, else of the outputs.
    """
    out = ca.vertcat(*e.outputs.values())
    loops = {"values": Loop(rows=[e.parameters], gathered=[e.z, e.w], added=[out])}
    sizes, sparsity = {"values": out.numel()}, out.sparsity()
    if derivative:
        jacobian = ca.jacobian(out, ca.vertcat(e.z, e.w))
        sparsity, weight = jacobian.sparsity(), ca.SX.sym("weight", jacobian.nnz())
        entries = ca.vertcat(*jacobian.nonzeros()) * weight if jacobian.nnz() else ca.SX(0, 1)
        loops["derivatives"] = Loop(rows=[e.parameters, weight], gathered=[e.z, e.w], added=[entries])
        sizes["derivatives"] = jacobian.nnz()
    return _Compiled(compile_functions(loops), sizes, sparsity)


def _index_derivatives(
    batches: Sequence[Batch], sparsities: Sequence[ca.Sparsity]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the row, column and ``of_w`` flag of every nonzero derivative of the batches, part by part.

    The row is an output of the assembly, or -1 where the output is dropped; the column is an unknown in y, or an
    acceleration in w where the flag is set. A column may be that of a constant, which has no derivative.
    """
    rows, columns, of_w = [], [], []
    for b, s in zip(batches, sparsities, strict=True):
        r, c = (np.array(a, dtype=np.int64) for a in s.get_triplet())
        n_z = b.z.shape[1]
        of = np.broadcast_to(c >= n_z, (len(b.z), len(c)))
        rows.append(b.out[:, r])
        columns.append(np.where(of, b.w[:, np.maximum(c - n_z, 0)], b.z[:, np.minimum(c, n_z - 1)]))
        of_w.append(of)
    return _concatenate(rows), _concatenate(columns), _concatenate(of_w).astype(bool)


def _concatenate(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Return all entries of the arrays, row by row, as one vector; without arrays, an empty vector of integers."""
    return np.concatenate([np.ascontiguousarray(a).ravel() for a in arrays]) if arrays else np.zeros(0, dtype=np.int64)
