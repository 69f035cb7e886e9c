"""Augmented Lagrangian of index 3 with mass-orthogonal projections, for systems that are not stiff.

Bayo and Ledesma (1996), Nonlinear Dyn. 9; Cuadrado, Cardenal and Bayo (1997), Multibody Syst. Dyn. 1; Dopico et al.
(2014). Trapezoidal rule, M vdot = f + A^T lam, with lam := lam + alpha phi repeated until phi = 0; then velocities and
accelerations are projected onto A v = 0 and A vdot = -gamma along M^-1 A^T. With M eliminated, the matrix
M + alpha A^T A becomes A M^-1 A^T + 1/alpha; here 1/alpha is ``regularisation`` times its diagonal. No redundant row is
dropped: redundant rows share the reaction. The projections dissipate energy. Stiff springs limit the step as in
``generalized_alpha``.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import (
    WITH_PLAIN,
    HolonomicMarchedSolver,
    Method,
    code_option,
    refuse_unused,
    run_plainly,
)
from .formulations.methods.alpha import make_alpha_method
from .plain import generalized_alpha


@solver("al_index3")
@dataclass(frozen=True)
class AlIndex3(HolonomicMarchedSolver):
    """Augmented Lagrangian of index 3, trapezoidal rule, projected velocities and accelerations."""

    regularisation: float = option(
        1e-7, "1/penalty, relative to the diagonal of A M^-1 A^T", at_least=1e-8, at_most=1e-2
    )
    tolerance: float = option(
        1e-12, "tolerance on phi and pose corrections, at least 16 roundings (angles in rad)", "m", above=0.0
    )
    code: str = code_option(*WITH_PLAIN)
    order: ClassVar[float] = 2.0

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: a regularisation, which plain steps ignore, rows without phi, or code=mechanism where none can be made.
        """
        return refuse_unused(self, "regularisation") or super().refuses(problem, control)

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return the method of generalised alpha with the parameters of the trapezoidal rule, and projections."""
        method = make_alpha_method(
            problem, self.tolerance, beta=0.25, gamma=0.5, shift=self.regularisation, projected=True
        )
        return replace(method, code=self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the same steps in plain NumPy."""
        scheme = {"beta": 0.25, "gamma": 0.5, "projected": True}
        return run_plainly(generalized_alpha.integrate, problem, control, self.tolerance, **scheme)
