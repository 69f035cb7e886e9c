"""Energy-momentum conserving steps with Cayley's map on index 3, for systems that are not stiff.

Simo and Wong (1991), Int. J. Numer. Meth. Eng. 31, for the rotations; rows and springs by discrete gradients after
Gonzalez (1996), J. Nonlinear Sci. 6, so that joints do no work in a step and a spring returns all of its energy. Energy
and the components of momentum on which gravity does not act are conserved to the tolerance of the iteration in steps of
any length; a damper dissipates c (dd/dt)^2. phi = 0 holds at the ends of steps, A v = 0 at their midpoints; at the ends
A v is of the order of dt^2. Redundant rows get a multiplier of zero. The matrix of a step's iteration contains M, not
springs: stiff springs need steps below their own period, or the iteration fails.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import MarchedSolver, Method, code_option, run_plainly
from .formulations.methods.energy_momentum import make_mean_value_method
from .formulations.refusals import refuse_without_gradient
from .plain import energy_momentum


@solver("energy_momentum")
@dataclass(frozen=True)
class EnergyMomentum(MarchedSolver):
    """Mean-value steps of fixed size that conserve energy and momentum."""

    tolerance: float = option(
        1e-12, "tolerance on phi and pose corrections, at least 16 roundings (angles in rad)", "m", above=0.0
    )
    code: str = code_option("kernel", "mechanism", "plain")
    order: ClassVar[float] = 2.0

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: rows or forces without discrete gradients, or code=mechanism where none can be made.
        """
        return refuse_without_gradient(problem.system) or super().refuses(problem, control)

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return the mean-value method with the solver's options."""
        return make_mean_value_method(problem, self.tolerance, self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the same steps in plain NumPy."""
        return run_plainly(energy_momentum.integrate, problem, control, self.tolerance)
