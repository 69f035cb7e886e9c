"""NDF of orders 1 to 5 on the semi-explicit index-1 DAE: Eqs. (92), (94), the class of MATLAB's ode15s (DAE-SE).

    p' = G u,   u' = w,   M w + h - f - A^T lam = 0,   A w + gamma + 2 alpha phi_dot + beta^2 phi = 0

by numerical differentiation formulas in quasi-constant steps (Shampine and Reichelt 1997; scipy_dae with
``NDF_strategy="efficiency"``, whose coefficients are ode15s's). The formula gives u', so that w need not be stored:
the discrete equations are those of form fi of ``solvers.formulations.dae``.

``accelerations="eliminated"`` substitutes w = M^-1 (f - h + A^T lam) in the constraint row (form se). The solution is
the same, but a Jacobian one step old then errs by dA M^-1 / dt: on the four-bar grid, where A M^-1 A^T has condition
1.7e8, Newton's contraction goes from 5e-3 to 40 at a step of 1e-3 s, and a run from 127 to 10,281 steps.

``accelerations="mass_matrix"`` is what ode15s is handed as E(y) y' = f(y), with E = [I 0 0; 0 M 0; 0 A 0] singular. The
residual is that of form fi, written so; ode15s's default for such an E ("weak" dependence on the state) leaves
d(E y')/dy out of Newton's matrix E / (gamma dt) - df/dy, and so does this form.

ode15s measures errors in the maximum norm, scipy_dae in the root mean square: equal tolerances are not equal errors.
``norm="max"`` is ode15s's, in the error test, Newton's test and the choice of order; the first step is scipy_dae's.
Counted: accepted steps, evaluations, Jacobians, factorisations, linear solves (one a Newton iteration), and the
evaluations spent on Jacobians by differences, which the evaluations include. Rejected steps are not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from scipy_dae.integrate._dae import bdf
from scipy_dae.integrate._dae.bdf import BDFDAE
from scipy_dae.integrate._dae.dae import DaeSolver

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.types import Problem, Status, StepControl, Trajectory
from .formulations.classical import BaumgarteOptions
from .formulations.dae import ImplicitForm
from .formulations.ida import OUT_OF_TEST
from .formulations.layout import Layout
from .formulations.linear import factoriser
from .formulations.recording import Clock, StepFailure, march, trajectory
from .formulations.sparse_pattern import FixedPattern
from .formulations.start import consistent, coordinates_and_velocities, layout_for, unloaded


def _maximum(x: np.ndarray) -> float:
    return float(np.max(np.abs(x)))


def _root_mean_square(x: np.ndarray) -> float:
    return math.sqrt(float(x.dot(x)) / len(x))


def _with_norm(norm: Callable[[np.ndarray], float]) -> Callable:
    """scipy_dae's step over a copy of its module's names, with ``norm`` and our Newton iteration; the module stays."""
    return FunctionType(BDFDAE._step_impl.__code__, {**vars(bdf), "norm": norm, "solve_bdf_system": _newton(norm)})


def _newton(norm: Callable[[np.ndarray], float]) -> Callable:
    """scipy_dae's ``solve_bdf_system`` with fewer calls of NumPy: what is not finite shows in the norm."""

    def solve(
        fun: Callable, t: float, y: np.ndarray, c: float, psi: np.ndarray, LU: Any, solve_lu: Callable,
        scale: np.ndarray, tol: float,
    ) -> tuple[bool, int, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        d, before, inverse_scale = np.zeros_like(y), 0.0, 1.0 / scale
        for k in range(bdf.NEWTON_MAXITER):
            y_dot = c * d + psi
            change = solve_lu(LU, fun(t, y, y_dot))
            size = norm(change * inverse_scale)
            if not math.isfinite(size):
                return False, k + 1, y, y_dot, d
            rate = size / before if k else 0.0
            if k and (rate >= 1.0 or rate ** (bdf.NEWTON_MAXITER - k) / (1.0 - rate) * size > tol):
                return False, k + 1, y, y_dot, d
            y, d = y - change, d - change
            if size == 0.0 or (k and rate / (1.0 - rate) * size < tol):
                return True, k + 1, y, y_dot, d
            before = size
        return False, bdf.NEWTON_MAXITER, y, y_dot, d

    return solve


class Ndf(BDFDAE):
    """NDF of scipy_dae with the Newton iteration above."""

    _step_impl = _with_norm(_root_mean_square)


class MaximumNormNdf(BDFDAE):
    """NDF with errors and corrections in the maximum norm."""

    _step_impl = _with_norm(_maximum)


def _set_functions(method: DaeSolver, residual: Callable, jacobian: Callable, pattern: FixedPattern) -> None:
    """Let ``method`` have Jacobians as nonzeros of ``pattern``, which it only adds, and factorise them our way."""
    factorise = factoriser(pattern)

    def evaluate_residual(t: float, y: np.ndarray, y_dot: np.ndarray) -> np.ndarray:
        method.nfev += 1
        return residual(t, y, y_dot)

    def evaluate_jacobian(t: float, y: np.ndarray, y_dot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        method.njev += 1
        return jacobian(t, y, y_dot)

    def lu(data: np.ndarray) -> Callable:
        method.nlu += 1
        return factorise(data)

    def solve_lu(solve: Callable, right: np.ndarray) -> np.ndarray:
        method._nlusove += 1
        return solve(right)

    method.fun, method.jac, method.lu, method.solve_lu = evaluate_residual, evaluate_jacobian, lu, solve_lu
    method.Jy, method.Jyp = evaluate_jacobian(method.t, method.y, method.yp)


@solver("ndf_index1")
@dataclass(frozen=True)
class NdfIndex1(BaumgarteOptions):
    """NDF (ode15s's class) on semi-explicit index 1 + Baumgarte."""

    accelerations: str = option(
        "unknown", "accelerations as algebraic unknowns, eliminated by M^-1, or left in E(y) y' = f(y) as in ode15s",
        choices=("unknown", "eliminated", "mass_matrix"),
    )  # fmt: skip

    norm: str = option(
        "rms",
        "norm of the local error and of Newton's corrections: root mean square or maximum",
        choices=("rms", "max"),
    )

    name: ClassVar[str]
    paper_label: ClassVar[str] = "DAE-SE"
    control: ClassVar[str] = "rtol"

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        layout, notes = layout_for(problem, self.coordinates)
        y = coordinates_and_velocities(layout, problem)
        y, y_dot = consistent(layout, y, self.alpha, self.beta) if self.consistent_start else unloaded(layout, y)
        which = "se" if self.accelerations == "eliminated" else "fi"
        form = self.implicit(layout, which, self.alpha, self.beta)
        ndf = self._integrator(layout, form, clock, y, y_dot, problem.t_end, control)
        setup_time = clock.restart()
        start, lam = (0.0, y, y[layout.lam]), layout.lam
        with np.errstate(all="ignore"):
            done = march(lambda: _step(ndf, lam), start, layout, problem.t_end, control, clock)
        cpu_time = clock.cpu_time()
        counters = {
            "evaluations": ndf.nfev + form.difference_evaluations,
            "jacobians": ndf.njev,
            "factorisations": ndf.nlu,
            "linear_solves": ndf._nlusove,  # scipy_dae's only count of Newton iterations
            "difference_evaluations": form.difference_evaluations,
        }
        return trajectory(layout, done, counters, notes, cpu_time=cpu_time, setup_time=setup_time)

    def _integrator(
        self,
        layout: Layout,
        form: ImplicitForm,
        clock: Clock,
        y: np.ndarray,
        y_dot: np.ndarray,
        t_end: float,
        control: StepControl,
    ) -> DaeSolver:
        atol = np.full(layout.n, control.rtol)
        if not self.lambda_in_error_test:
            atol[layout.lam] = OUT_OF_TEST

        def residual(t: float, y: np.ndarray, y_dot: np.ndarray) -> np.ndarray:
            clock.check()
            return form.residual(y, y_dot, t)

        def jacobian(t: float, y: np.ndarray, y_dot: np.ndarray) -> tuple:
            if self.accelerations == "mass_matrix":
                y_dot = np.zeros_like(y_dot)  # F = E(y) y' - f(y): what is left of dF/dy is -df/dy
            of_y, of_y_dot = form.jacobian(y, y_dot, t)
            return of_y.copy(), of_y_dot.copy()

        nothing = sp.csc_matrix((layout.n, layout.n))
        method = self._method(
            residual, 0.0, y, y_dot, t_end, max_step=control.max_step or np.inf, rtol=control.rtol, atol=atol,
            jac=(nothing, nothing),
        )  # fmt: skip
        _set_functions(method, residual, jacobian, form.pattern)
        return method

    def _method(self, *equations: Any, **settings: Any) -> DaeSolver:
        kind = Ndf if self.norm == "rms" else MaximumNormNdf
        return kind(*equations, **settings, NDF_strategy="efficiency")


def _step(ndf: DaeSolver, lam: slice) -> tuple[float, np.ndarray, np.ndarray]:
    try:
        message = ndf.step()
    except (RuntimeError, np.linalg.LinAlgError) as error:  # SuperLU's "Factor is exactly singular"
        raise StepFailure(Status.SINGULAR, f"the Jacobian could not be factorised ({error})") from None
    except ValueError as error:  # LAPACK's wrappers on NaN or infinity
        raise StepFailure(Status.DIVERGED, f"the linear system is not finite ({error})") from None
    if ndf.status == "failed":
        raise StepFailure(Status.STEP_UNDERFLOW, str(message).rstrip(".").lower())
    return ndf.t, ndf.y, ndf.y[lam]
