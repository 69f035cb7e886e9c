"""SUNDIALS IDA by scikit-sundae's own interface, where module ``sundials`` does not know the installed version.

Residuals pass through Python, which takes longer, and scikit-sundae offers neither of the settings of Newton's
iteration by which module ``sundials`` errs less.
"""

import time
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from .sundials import ONE_STEP_LIMIT, OUT_OF_TIME, IdaEquations


class PublicIda:
    """IDA on ``equations`` like ``sundials.Ida``, which says what the arguments and methods are."""

    messages = ""

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
        """Prepare IDA at the initial values; ``seconds`` is the CPU time left, None without a limit."""
        from sksundae.ida import IDA

        e, more = equations, dict[str, Any]()
        if linear_solver == "band":
            more = {"lband": int(np.max(e.rows - e.columns)), "uband": int(np.max(e.columns - e.rows))}
        elif linear_solver == "sparse":
            n, ones = len(e.y), np.ones(len(e.rows))
            more = {"sparsity": sp.csc_matrix((ones, (e.rows, e.columns)), shape=(n, n))}
        self._equations, self._sparse = e, linear_solver == "sparse"
        self._until = None if seconds is None else time.process_time() + seconds
        self._stop: float | None = None
        self.evaluations = self.jacobians = 0
        steps = {"first_step": first_step, "max_step": max_step, "max_num_steps": ONE_STEP_LIMIT}
        limits = {"rtol": rtol, "atol": atol, **steps}
        self._ida = IDA(self._evaluate_residual, linsolver=linear_solver, jacfn=self._fill_jacobian, **limits, **more)
        self._ida.init_step(start, e.y.copy(), e.y_dot.copy())

    def __enter__(self) -> "PublicIda":
        return self

    def __exit__(self, *exception: object) -> None:
        """Release nothing: scikit-sundae frees its memory itself."""

    def stop_at(self, t: float) -> None:
        """Set the time [s] that no step may pass."""
        self._stop = t

    def step(self, t_end: float) -> tuple[int, float, Float[np.ndarray, " n"]]:
        """Take one step towards ``t_end`` [s]; return IDA's flag (negative: it failed), the time [s] reached and y.

        At the limit of CPU time no step is taken: the flag is the first of ``OUT_OF_TIME``, and time and y are void.
        """
        if self._until is not None and time.process_time() > self._until:
            return OUT_OF_TIME[0], 0.0, self._equations.y
        found = self._ida.step(t_end, method="onestep", tstop=self._stop)
        return int(found.status), float(found.t), np.asarray(found.y)

    def _set_state(self, t: float, y: np.ndarray, y_dot: np.ndarray) -> None:
        """Copy time, y and y' to the arrays from which the equations are evaluated."""
        e = self._equations
        e.t[0], e.y[:], e.y_dot[:] = t, y, y_dot

    def _evaluate_residual(self, t: float, y: np.ndarray, y_dot: np.ndarray, F: np.ndarray) -> None:
        """Set ``F`` to the residual F(t, y, y'), and count it."""
        self.evaluations += 1
        self._set_state(t, y, y_dot)
        self._equations.evaluate.run()
        F[:] = self._equations.F

    def _fill_jacobian(
        self, t: float, y: np.ndarray, y_dot: np.ndarray, F: np.ndarray, cj: float, J: np.ndarray
    ) -> None:
        """Set ``J``, a full matrix or the nonzeros of a sparse one, to dF/dy + ``cj`` dF/dy', and count it."""
        self.jacobians += 1
        self._set_state(t, y, y_dot)
        e = self._equations
        J[slice(None) if self._sparse else (e.rows, e.columns)] = e.jacobian(cj)
