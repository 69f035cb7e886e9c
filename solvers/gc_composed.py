"""ODE-GC composed to orders 4, 6 and 8: sub-steps of ``gc_weak_form`` in the symmetric gauge, some backward in time.

The symmetric gauge makes the step of Eqs. (66), (74), (75) its own inverse, and mu, of which only increments are
physical, starts anew in each sub-step, so symmetric compositions raise the order by two each time (Suzuki 1990, Kahan,
Li 1997; Hairer, Lubich, Wanner, Geometric Numerical Integration, II.4, V.3.2). Redundant rows get no multiplier. phi is
not corrected: it falls with the order of the composition.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.system import MultibodySystem
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import code_option, integrate
from .formulations.methods.choices import CHOICES
from .formulations.methods.compositions import COMPOSITIONS, RATE
from .formulations.methods.gc_composed import make_composed_method
from .gc_weak_form import GcWeakForm

SPRINGS = "takes gravity as the only applied force: springs and dampers carry mu from step to step; use gc_weak_form"
JOINTS = "its kernels have spherical and revolute joints only; use gc_weak_form"


@solver("gc_composed")
@dataclass(frozen=True)
class GcComposed:
    """ODE-GC's reversible step of fixed size, composed to higher order."""

    composition: str = option(
        "suzuki4",
        "Suzuki's five steps (order 4), Kahan and Li's nine (6) or seventeen (8), or plain (2)",
        choices=("suzuki4", "kahan_li6", "kahan_li8", "plain"),
    )
    rate: float = option(0.0, RATE, "rad/s", at_least=0.0)
    direction: str = option("a", "c_R of Eq. (31), as in gc_weak_form", choices=CHOICES)
    tolerance: float = option(1e-12, "tolerance of test (80) in each sub-step", "sqrt(J)", above=0.0)
    code: str = code_option("kernel", "mechanism")

    name: ClassVar[str]
    control: ClassVar[str] = "dt"

    @property
    def order(self) -> float:
        """Order of the composition."""
        return float(COMPOSITIONS[self.composition][1])

    @property
    def paper_label(self) -> str:
        """Label in tables; the paper has no composed method."""
        return f"ODE-GC (composed, order {self.order:g})"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: forces other than gravity, joints other than spherical and revolute ones, a direction that the joints do
        not have, or code=mechanism where none can be made.
        """
        return (
            refuse_system(problem.system)
            or self._weak_form.refuses_direction(problem)
            or self._weak_form.refuses_code(problem)
        )

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with the fixed step ``control.dt`` and return the trajectory."""
        settings, gamma = self._weak_form.make_settings(problem), COMPOSITIONS[self.composition][0]
        return integrate(problem, control, make_composed_method(problem.system, settings, gamma, self.rate))

    @property
    def _weak_form(self) -> GcWeakForm:
        """Solver of the weak form with the same options, whose steps are the sub-steps."""
        return GcWeakForm(direction=self.direction, tolerance=self.tolerance, code=self.code)


def refuse_system(system: MultibodySystem) -> str | None:
    """Return why the simplified step cannot integrate the system, or None: other forces or joints than it has."""
    if len(system.spring_k) or len(system.torsion_k) or len(system.load_i) or len(system.user_i):
        return SPRINGS
    return None if system.is_pinned else JOINTS
