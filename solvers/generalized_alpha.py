"""Generalised-alpha on the rotation group, index 3 or stabilised, for systems that are not stiff.

Chung and Hulbert (1993), J. Appl. Mech. 60, in the Lie-group form of Bruls, Cardona and Arnold (2012), Mech. Mach.
Theory 48; stabilised index 2, phi = 0 and A v = 0 together, as in Arnold, Bruls and Cardona (2015), Numer. Math. 129.
``rho_inf`` is the spectral radius at infinite frequency: below 1 the scheme damps frequencies that it cannot resolve,
and dissipates energy. At 1 the stabilised form still loses energy, and index 3 is weakly unstable. Redundant rows get a
multiplier of zero. The matrix of a step's iteration contains M, not springs and dampers: stiff ones need steps below
their own period, or the iteration fails.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import WITH_PLAIN, HolonomicMarchedSolver, Method, code_option, run_plainly
from .formulations.methods.alpha import make_alpha_method
from .plain import generalized_alpha


@solver("generalized_alpha")
@dataclass(frozen=True)
class GeneralizedAlpha(HolonomicMarchedSolver):
    """Generalised-alpha on the rotation group with fixed steps and numerical damping."""

    rho_inf: float = option(
        0.9, "spectral radius at infinite frequency: the smaller, the more is damped", at_least=0.0, at_most=1.0
    )
    form: str = option("stabilised", "phi and A v, or phi alone", choices=("stabilised", "index3"))
    tolerance: float = option(
        1e-12, "tolerance on phi and pose corrections, at least 16 roundings (angles in rad)", "m", above=0.0
    )
    code: str = code_option(*WITH_PLAIN)
    order: ClassVar[float] = 2.0

    @property
    def _scheme(self) -> dict[str, Any]:
        """Keyword arguments of the scheme: the parameters of Chung and Hulbert for ``rho_inf``, and the form."""
        rho = self.rho_inf
        alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        beta = 0.25 * (gamma + 0.5) ** 2
        return {
            "alpha_m": alpha_m,
            "alpha_f": alpha_f,
            "beta": beta,
            "gamma": gamma,
            "stabilised": self.form == "stabilised",
        }

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return the method of generalised alpha with the solver's options."""
        return replace(make_alpha_method(problem, self.tolerance, **self._scheme), code=self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the same steps in plain NumPy."""
        return run_plainly(generalized_alpha.integrate, problem, control, self.tolerance, **self._scheme)
