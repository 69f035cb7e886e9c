"""Newton's iterations of scipy_dae's methods on an ``ImplicitForm``, each iteration one call of machine code.

They replace functions of scipy_dae with the same signature. They need no separate test for values that are not finite:
the norm of a correction is then not finite, and the iteration fails.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy_dae.integrate import BDFDAE, RadauDAE

from ...harness.base.code_meter import making_code
from ...harness.base.generated import Code, Loop, compile_functions
from ...harness.base.generated.steps import take
from ...harness.base.iteration import FAILED, GO_ON, SETTLED, iterate
from ...harness.base.private_interfaces import replace_names_in_step
from ...harness.mechanics.types import StepControl
from .dae import ImplicitForm
from .linear import Factors, make_solve_call
from .recording import Clock

DaeSolver = Any  # BDFDAE or RadauDAE
MOST_ITERATIONS = 4  # of an NDF step, from which scipy_dae also finds the next one's length

Norm = Callable[[Float[np.ndarray, " n"]], float]
Newton = Callable[[DaeSolver, ImplicitForm, tuple[Factors, Factors], Norm, Clock], Callable]


def root_mean_square(x: Float[np.ndarray, " n"]) -> float:
    """Return the root mean square of ``x``, corrections over their tolerances: scipy_dae's norm."""
    return math.sqrt(float(x.dot(x)) / len(x))


def maximum(x: Float[np.ndarray, " n"]) -> float:
    """Return the largest absolute entry of ``x``, corrections over their tolerances: the norm of MATLAB's ode15s."""
    return float(np.max(np.abs(x)))


class Scheme(NamedTuple):
    """A method of scipy_dae: class, name of its Newton iteration, our replacement of that, and settings."""

    kind: type[DaeSolver]
    name: str
    newton: Newton
    settings: dict[str, Any]

    def set_up_method(
        self,
        form: ImplicitForm,
        start: tuple[float, np.ndarray, np.ndarray],
        t_end: float,
        control: StepControl,
        atol: Float[np.ndarray, " n"],
        norm: Norm,
        clock: Clock,
        *,
        keep_y_dot: bool,
    ) -> DaeSolver:
        """Return the method of scipy_dae set up on ``form``, ready to step.

        ``start`` is (t [s], y, y'), ``atol`` the absolute tolerance of each unknown, ``norm`` that of the error and
        Newton tests. Jacobians are evaluated at y' = 0 unless ``keep_y_dot``. The method's Newton iteration is replaced
        by ``newton``. The method counts evaluations, factorisations and solutions. Jacobians are passed as nonzeros of
        the form's pattern, of which scipy_dae only forms sums.
        """
        factors = Factors(form.pattern), Factors(form.pattern, complex)

        def residual(t: float, y: np.ndarray, y_dot: np.ndarray) -> np.ndarray:
            """Return F(t, y, y'); raise ``StepFailure`` where the CPU limit is reached."""
            clock.check()
            return form.residual(y, y_dot, t)

        def count_residual(t: float, y: np.ndarray, y_dot: np.ndarray) -> np.ndarray:
            """Return F(t, y, y') and count it as an evaluation."""
            method.nfev += 1
            return residual(t, y, y_dot)

        def jacobian(t: float, y: np.ndarray, y_dot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Return copies of the nonzeros of dF/dy and dF/dy', and count one Jacobian."""
            method.njev += 1
            of_y, of_y_dot = form.jacobian(y, y_dot if keep_y_dot else np.zeros_like(y_dot), t)
            return of_y.copy(), of_y_dot.copy()

        def lu(data: np.ndarray) -> Factors:
            """Factorise the matrix of these nonzeros, real or complex, and return its factors."""
            method.nlu += 1
            own = factors[np.iscomplexobj(data)]
            own.factorise(data)
            return own

        def solve_lu(own: Factors, right: np.ndarray) -> np.ndarray:
            """Return the solution for the right side ``right``, both in the order of the unknowns, and count it."""
            _add_counts(method, evaluations=0, solutions=1)
            own.x[:] = right[own.order]
            own.solve()
            return own.x[own.place]

        nothing = sp.csc_matrix(form.pattern.shape)
        method = self.kind(
            residual,
            *start,
            t_end,
            max_step=control.max_step or np.inf,
            rtol=control.rtol,
            atol=atol,
            jac=(nothing, nothing),
            **self.settings,
        )
        method.fun, method.jac, method.lu, method.solve_lu = count_residual, jacobian, lu, solve_lu
        method.solutions = 0
        method.Jy, method.Jyp = jacobian(method.t, method.y, method.yp)
        replace_names_in_step(method, {"norm": norm, self.name: self.newton(method, form, factors, norm, clock)})
        return method


def make_ndf_newton(
    method: DaeSolver, form: ImplicitForm, factors: tuple[Factors, Factors], norm: Norm, clock: Clock
) -> Callable:
    """Return Newton's iteration of one BDF or NDF step, a replacement of scipy_dae's ``solve_bdf_system``.

    The function returned takes scipy_dae's arguments and returns (converged, iterations, y, y', d), with d the sum of
    the corrections. ``factors`` are those of real and of complex matrices; this method uses the real ones.
    """
    n, own, code = len(form.y), factors[0], _compile_ndf_loops()
    c, d, psi, inverse_scale, scaled = np.zeros(1), *(np.zeros(n) for _ in range(4))
    every, count = np.arange(n), np.array([n])
    before = [
        (code.address("rate"), [count, c, d, psi, form.y_dot]),
        form.evaluate.step,
        take(form.F, own.order, own.x),
    ]
    update = [count, inverse_scale, own.x, own.place, scaled, form.y, every, d, every]
    run = make_solve_call(before, [own], [(code.address("update"), update)], (code, form))

    def correct() -> float:
        """Correct y and y' once, and return the norm of the scaled correction."""
        clock.check()
        run()
        _add_counts(method, evaluations=1, solutions=1)
        return norm(scaled)

    def solve(
        fun: Callable,
        t: float,
        y: np.ndarray,
        c_new: float,
        psi_new: np.ndarray,
        LU: Any,
        solve_lu: Callable,
        scale: np.ndarray,
        tol: float,
    ) -> tuple[bool, int, np.ndarray, np.ndarray, np.ndarray]:
        """Iterate from the predictor ``y`` until the rate of convergence promises an error below ``tol``.

        y' = ``c_new`` d + ``psi_new``; ``scale`` are the tolerances of the unknowns. The other arguments are unused.
        """
        form.y[:], form.t[0], c[0], psi[:] = y, t, c_new, psi_new
        np.divide(1.0, scale, out=inverse_scale)
        d.fill(0.0)
        converged, iterations, _ = _iterate_newton(correct, MOST_ITERATIONS, tol)
        return converged, iterations, form.y.copy(), form.y_dot.copy(), d.copy()

    return solve


def make_radau_newton(
    method: DaeSolver, form: ImplicitForm, factors: tuple[Factors, Factors], norm: Norm, clock: Clock
) -> Callable:
    """Return Newton's iteration of one three-stage Radau IIA step, a replacement of ``solve_collocation_system``.

    The function returned takes scipy_dae's arguments and returns (converged, iterations, stages Y (3, n), their rates
    Y', Y - y, rate of convergence). ``factors`` are those of the real system and of the pair of complex ones.
    """
    n, (real, pair), code = len(form.y), factors, _compile_radau_loops()
    every, count, stages = np.arange(n), np.array([n]), np.arange(3) * n
    Y, Yp, F, scaled, tau, inverse_scale = *(np.zeros((3, n)) for _ in range(4)), np.zeros(3), np.zeros(n)
    TI, T, hA = (np.ascontiguousarray(matrix.T) for matrix in (method.TI, method.T, method.A))  # by columns
    before = []
    for k in range(3):
        before += [take(Y[k], every, form.y), take(Yp[k], every, form.y_dot), take(tau[k : k + 1], every[:1], form.t)]
        before += [form.evaluate.step, take(form.F, every, F[k])]
    parts, at = pair.x.view(float), every[:, None] + stages
    before.append((code.address("transform"), [count, TI, F, real.order[:, None] + stages, real.x, parts]))
    update = [count, T, hA, inverse_scale, real.x, real.place, parts, 2 * pair.place[:, None] + np.arange(2)]
    after = [(code.address("update"), [*update, scaled, Yp, at, Y, at.copy()])]
    run = make_solve_call(before, factors, after, (code, form))

    def correct() -> float:
        """Correct all stages once, and return the norm of the scaled correction."""
        clock.check()
        run()
        _add_counts(method, evaluations=3, solutions=2)
        return norm(scaled.ravel())

    def solve(
        fun: Callable,
        t: float,
        y: np.ndarray,
        h: float,
        Yp0: np.ndarray,
        scale: np.ndarray,
        tol: float,
        LU_real: Any,
        LU_complex: Any,
        solve_lu: Callable,
        C: np.ndarray,
        T: np.ndarray,
        TI: np.ndarray,
        A: np.ndarray,
        most: int,
    ) -> tuple[bool, int, np.ndarray, np.ndarray, np.ndarray, float | None]:
        """Iterate from the stage rates ``Yp0`` until the rate of convergence promises an error below ``tol``.

        ``h`` is the step, ``scale`` are the tolerances of the unknowns, ``most`` is the number of iterations allowed.
        ``Yp0`` is overwritten by the last rates. Factors, ``T`` and ``TI`` are known already.
        """
        Yp[:], tau[:], hA[:] = Yp0, t + h * C, h * A.T
        np.add(y, h * A.dot(Yp), out=Y)
        np.divide(1.0, scale, out=inverse_scale)
        converged, iterations, rate = _iterate_newton(correct, most, tol)
        Yp0[:] = Yp  # as in scipy_dae, a second attempt begins there
        return converged, iterations, Y.copy(), Yp0, Y - y, rate

    return solve


def _iterate_newton(correct: Callable[[], float], most: int, tol: float) -> tuple[bool, int, float | None]:
    """Iterate until converged; return whether it is, the number of iterations and the rate of convergence.

    ``correct`` applies a correction and returns its norm. The rate is the quotient of the last two norms, None after
    one. It has converged where rate / (1 - rate) times the norm, the error left, is below ``tol``; it ends early where
    ``most`` iterations cannot reach that.
    """
    iterations = 0
    rate: float | None = None

    def classify(s: None, i: int, size: float, before: float) -> int:
        """Return SETTLED, FAILED or GO_ON by the norms ``size`` and ``before`` of the last two corrections."""
        nonlocal iterations, rate
        iterations, rate = i + 1, size / before if i else None
        if not math.isfinite(size):
            return FAILED
        if rate is not None and (rate >= 1.0 or rate ** (most - i) / (1.0 - rate) * size > tol):
            return FAILED
        return SETTLED if size == 0.0 or (rate is not None and rate / (1.0 - rate) * size < tol) else GO_ON

    return iterate(None, lambda s, i, stale: correct(), classify, most), iterations, rate


def _add_counts(method: DaeSolver, *, evaluations: int, solutions: int) -> None:
    """Add evaluations and solutions to the counters of scipy_dae's method."""
    method.nfev += evaluations
    method.solutions += solutions


@cache
@making_code
def _compile_ndf_loops() -> Code:
    """Compile the two loops of an NDF iteration: y' = c d + psi, and the update of y and d by the scaled correction."""
    c, d, psi, x, inverse_scale = (ca.SX.sym(name) for name in ("c", "d", "psi", "x", "inverse_scale"))
    rate = Loop(whole=[c], rows=[d, psi], stored=[c * d + psi])
    update = Loop(rows=[inverse_scale], gathered=[x], stored=[x * inverse_scale], added=[-x, -x])
    return compile_functions({"rate": rate, "update": update})


@cache
@making_code
def _compile_radau_loops() -> Code:
    """Compile the two loops of a Radau iteration.

    "transform" sets the right sides of the decoupled systems, -TI F; "update" transforms their solutions back by T, and
    adds them to the stages and their rates.
    """
    TI, T, hA = (ca.SX.sym(name, 3, 3) for name in ("TI", "T", "hA"))
    F, x, parts, inverse_scale = ca.SX.sym("F", 3), ca.SX.sym("x"), ca.SX.sym("parts", 2), ca.SX.sym("inverse_scale")
    G, dYp = TI @ F, T @ ca.vertcat(x, parts)
    dY = hA @ dYp
    transform = Loop(whole=[TI], gathered=[F], stored=[-G[0], -G[1:]])
    update = Loop(
        whole=[T, hA], rows=[inverse_scale], gathered=[x, parts], stored=[dY * inverse_scale], added=[dYp, dY]
    )
    return compile_functions({"transform": transform, "update": update})


NDF_SCHEME = Scheme(BDFDAE, "solve_bdf_system", make_ndf_newton, {"NDF_strategy": "efficiency"})
RADAU_SCHEME = Scheme(RadauDAE, "solve_collocation_system", make_radau_newton, {})
