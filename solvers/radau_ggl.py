"""Radau IIA of order 5 on stabilised index 2 (Gear, Gupta, Leimkuhler), with error control, on the rotation group.

Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.8 and VII.4; Gear, Gupta and Leimkuhler (1985),
J. Comput. Appl. Math. 12: phi = 0 and A v = 0 hold together at each stage, where a second multiplier eta corrects the
poses. Redundant rows get a multiplier of zero. Stiffness and damping along springs are in the matrix of the iteration,
so that stiff springs do not reduce the step: a ball on one of 1e12 N/m takes 133 steps, on one of 1e9 N/m 130. Slender
bodies that rotate do reduce it (``flyball_governor``: 723 steps for its first second at rtol 1e-6, 690 with soft
springs; 2,407 with springs left out of the matrix). The error estimate is of order 3, hence pessimistic.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import HolonomicMarchedSolver, Method, code_option, run_plainly
from .formulations.methods.radau import choose_newton_tolerance, make_radau_method
from .plain import radau_ggl


@solver("radau_ggl")
@dataclass(frozen=True)
class RadauGgl(HolonomicMarchedSolver):
    """Radau IIA of order 5 on the rotation group, stabilised index 2, error control."""

    code: str = code_option("kernel", "mechanism", "plain")

    control: ClassVar[str] = "rtol"

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return the Radau method with the solver's options."""
        assert control.rtol is not None  # checked by the catalogue
        return make_radau_method(problem, control.rtol, self.code)

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the same steps in plain NumPy."""
        assert control.rtol is not None
        return run_plainly(radau_ggl.integrate, problem, control, choose_newton_tolerance(control.rtol))
