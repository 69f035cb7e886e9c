"""Elements evaluated by the batch and scattered into one vector: gather, one compiled map a kind, one sparse product.

CasADi maps the expression of one body or joint over all of them inside its own virtual machine (no C compiler), on
NumPy memory (``Function.buffer``). An ``Assembly`` owns that memory, so one instance serves one run at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from .layout import Layout
from .symbolic import Element


@dataclass(frozen=True)
class Batch:
    """``element`` over m parts: parameters, where it reads z and w, where each output is added (-1: nowhere)."""

    element: Element
    parameters: Float[np.ndarray, "m n_parameters"]
    z: Int[np.ndarray, "m n_z"]
    w: Int[np.ndarray, "m n_w"]
    out: Int[np.ndarray, "m n_out"]


class Assembly:
    """out(y, w) = sum over elements, with the nonzeros of its derivatives."""

    def __init__(self, layout: Layout, batches: Sequence[Batch], n_out: int, *, differentiable: bool) -> None:
        batches = [b for b in batches if len(b.z)]
        self._alive: list = []
        self._n, self._n_u, self.n_out = layout.n, layout.n_u, n_out
        self._y = np.concatenate((np.zeros(layout.n), layout.constants))
        self._w = np.zeros(layout.n_u + 6)
        self._z_index = _joined([b.z for b in batches])
        self._w_index = _joined([b.w for b in batches])
        self._z, self._w_read = np.zeros(len(self._z_index)), np.zeros(len(self._w_index))
        values = [_function(b, derivative=False) for b in batches]
        out_index = _joined([b.out for b in batches])
        self._values = np.zeros(len(out_index))
        self._evaluate = self._bind(values, batches, self._values)
        self._scatter = _scatter(out_index, n_out)
        derivatives = [_function(b, derivative=True) for b in batches] if differentiable else []
        self.row, self.column, self.of_w = _entries(batches[: len(derivatives)], [f[1] for f in derivatives])
        self.column[self.column >= np.where(self.of_w, layout.n_u, layout.n)] = -1  # constants
        self._derivatives = np.zeros(len(self.row))
        self._differentiate = self._bind(derivatives, batches[: len(derivatives)], self._derivatives)

    def values(
        self, y: Float[np.ndarray, " n"], w: Float[np.ndarray, " n_u"], t: float = 0.0
    ) -> Float[np.ndarray, " n_out"]:
        """The assembled outputs at unknowns ``y`` and accelerations ``w``."""
        self._read(y, w, t)
        for evaluate in self._evaluate:
            evaluate()
        return self._scatter @ self._values

    def derivatives(
        self, y: Float[np.ndarray, " n"], w: Float[np.ndarray, " n_u"], t: float = 0.0
    ) -> Float[np.ndarray, " n_entries"]:
        """d out[``row``] / d (w if ``of_w`` else y)[``column``], one value an entry; entries at one place add.

        Entries of constants and dropped outputs have row or column -1. The array is reused by the next call.
        """
        self._read(y, w, t)
        for differentiate in self._differentiate:
            differentiate()
        return self._derivatives

    def _read(self, y: np.ndarray, w: np.ndarray, t: float) -> None:
        self._y[: self._n] = y
        self._y[-1] = t
        self._w[: self._n_u] = w
        np.take(self._y, self._z_index, out=self._z, mode="clip")  # "raise" would copy; the indices are ours
        np.take(self._w, self._w_index, out=self._w_read, mode="clip")

    def _bind(self, functions: list, batches: Sequence[Batch], target: np.ndarray) -> list:
        """Evaluators that write slices of ``target``, CasADi's columns being the parts."""
        calls, z0, w0, t0 = [], 0, 0, 0
        for (function, _), b in zip(functions, batches, strict=True):
            z1, w1, t1 = z0 + b.z.size, w0 + b.w.size, t0 + function.nnz_out(0)
            memory, call = function.buffer()
            arrays = self._z[z0:z1], self._w_read[w0:w1], np.array(b.parameters, dtype=float).ravel()
            for k, array in enumerate(arrays):
                memory.set_arg(k, array.data)
            memory.set_res(0, target[t0:t1].data)
            calls.append(call)
            self._alive.append((function, memory, arrays))  # CasADi keeps bare pointers
            z0, w0, t0 = z1, w1, t1
        return calls


def _function(batch: Batch, *, derivative: bool) -> tuple[ca.Function, ca.Sparsity]:
    """The mapped function of one batch and the sparsity of one part's output."""
    e = batch.element
    out = ca.densify(ca.vertcat(*e.outputs.values()))
    inputs = [e.z, e.w, e.parameters]
    sparsity = out.sparsity()
    if derivative:
        jacobian = ca.jacobian(out, ca.vertcat(e.z, e.w))
        sparsity, out = jacobian.sparsity(), ca.vertcat(*jacobian.nonzeros()) if jacobian.nnz() else ca.SX(0, 1)
    return ca.Function("element", inputs, [out], {"cse": True}).map(len(batch.z)), sparsity


def _entries(batches: Sequence[Batch], sparsities: Sequence[ca.Sparsity]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows, columns, of_w = [], [], []
    for b, s in zip(batches, sparsities, strict=True):
        r, c = (np.array(a, dtype=np.int64) for a in s.get_triplet())
        n_z = b.z.shape[1]
        of = np.broadcast_to(c >= n_z, (len(b.z), len(c)))
        rows.append(b.out[:, r])
        columns.append(np.where(of, b.w[:, np.maximum(c - n_z, 0)], b.z[:, np.minimum(c, n_z - 1)]))
        of_w.append(of)
    return _joined(rows), _joined(columns), _joined(of_w).astype(bool)


def _joined(arrays: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.ascontiguousarray(a).ravel() for a in arrays]) if arrays else np.zeros(0, dtype=np.int64)


def _scatter(index: Int[np.ndarray, " m"], n: int) -> sp.csr_array:
    used = np.flatnonzero(index >= 0)
    return sp.csr_array((np.ones(len(used)), (index[used], used)), shape=(n, len(index)))
