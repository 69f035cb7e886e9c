"""ODE-GC with the augmented Lagrangian of Sect. 4.3 (Eqs. 82 to 85): redundant constraints and singular configurations.

Newton's correction and the augmentation mu := mu - xi psi (85), applied together, are one proximal saddle
``[[J_vv, -D'], [A, (Xi M_bar)^-1]]``, regular for any rank of A; the paper's nested loop is the option
``loop = "nested"``. Where the proximal loop does not converge (a configuration in which A loses rank), the step is
repeated by the nested loop at a low penalty. In redundant systems the poses are corrected to phi = 0 after each step,
because with phi = O(dt^2) a mechanism cannot pass its singular configurations (docs/decisions/singular-passages.md).
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..harness.base.clock import cpu_seconds
from ..harness.base.code_meter import making_code
from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, Status, StepControl, Trajectory
from .formulations.compiled.host import refuse_unused
from .formulations.methods.choices import GaugeChoices
from .formulations.methods.gc_weak_form import integrate_weak_form
from .formulations.methods.passages import find_passages
from .formulations.rank import rows_to_keep


@solver("gc_augmented_lagrangian")
@dataclass(frozen=True)
class GcAugmentedLagrangian(GaugeChoices):
    """Augmented Lagrangian weak form of fixed step: any rank of the constraints, singular passages included."""

    max_newton: int = option(12, "corrections until a step counts as singular or is cut", "", at_least=1)
    penalty: float = option(1e7, "xi of Eq. (84), per M_bar", "", above=0.0)
    loop: str = option(
        "proximal", "correction and augmentation at once, or the paper's nested loop", choices=("proximal", "nested")
    )
    lambda_bar: bool = option(
        False, "lam - xi phi of Eq. (84) in the nested loop, beside mu - xi psi; acts where K_bar is not zero"
    )
    penalty_growth: float = option(
        1.0, "factor on xi after an augmentation that does not quarter phi_dot; 1: xi stays", "", at_least=1.0
    )
    max_augmentations: int = option(12, "augmentations of the nested loop per step", "", at_least=1)
    accept: float = option(1e-3, "norm of Eq. (81) at which a singular step is accepted", "sqrt(J)", above=0.0)
    soft_penalty: float = option(0.1, "xi (omega dt)^2 of singular steps; indefinite above about 0.3", "", above=0.0)
    singular_turn: float = option(
        0.005,
        "largest rotation of a body per step after the first singular configuration, because passages "
        "amplify errors; 0: no limit",
        "rad",
        at_least=0.0,
    )
    correct_pose: str = option(
        "redundant",
        "when poses are corrected to phi = 0 after each step: in redundant systems, never, or always",
        choices=("redundant", "never", "always"),
    )

    name: ClassVar[str]
    variant: ClassVar[str] = "AL, "
    control: ClassVar[str] = "dt"
    order: ClassVar[float] = 2.0
    has_plain: ClassVar[bool] = True

    @property
    def follows_paper(self) -> bool:
        """True if all options follow Sect. 4.3 of the paper.

        That is: the choices of Sect. 4.2, the nested loop, lambda_bar, penalties that grow, no correction of poses, and
        no step accepted above the tolerance.
        """
        loop = self.loop == "nested" and self.lambda_bar and self.penalty_growth > 1.0
        return super().follows_paper and loop and self.correct_pose == "never" and self.accept <= self.tolerance

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the options contradict each other or do not suit the problem or step control, or None."""
        if self.loop != "nested" and (self.lambda_bar or self.penalty_growth > 1.0):
            return "lambda_bar and penalty_growth belong to the nested loop: set loop = nested"
        if self.loop == "nested" and self.code == "mechanism":
            return "the nested loop is not the simplified method's: use code = kernel"
        if self.code == "plain" and (self.loop != "nested" or self.correct_pose != "never"):
            return "plain steps are those of Sect. 4.3: set loop = nested and correct_pose = never"
        return refuse_unused(self, "soft_penalty", "singular_turn") or self.refuses_choice(problem, control)

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with the fixed step ``control.dt`` and return the trajectory, with singular passages as ``events``.

        Notes state the rank of the rows, whether poses are corrected, when ``singular_turn`` begins, and the number of
        passages.
        """
        began = cpu_seconds()
        with making_code:  # imported now for ``find_passages``, so that its time is set-up
            import scipy.signal  # noqa: F401  for ``find_passages``

        redundant = problem.system.nrows - len(rows_to_keep(problem.system, problem.initial))
        correct = self.correct_pose == "always" or (self.correct_pose == "redundant" and redundant > 0)
        settings = self.make_settings(problem)._replace(
            active=1,
            always_nested=self.loop == "nested",
            penalty=self.penalty,
            max_augmentations=self.max_augmentations,
            accept=self.scale_tolerance(self.accept, problem),
            closes_pose=correct,
            soft=self.soft_penalty,
            lambda_bar=self.lambda_bar,
            growth=self.penalty_growth,
            singular_turn=self.singular_turn or float("inf"),
            redundant=redundant > 0,
        )
        set_up = cpu_seconds() - began
        out = integrate_weak_form(problem, control, self, settings)
        if out.status is Status.REFUSED:
            return out
        rank = f"{problem.system.nrows} constraint rows of rank {problem.system.nrows - redundant} at the start"
        crossed = find_passages(problem.system, out)
        notes = [*out.notes, rank, *self.notes(problem)]
        if correct:
            notes.append("poses corrected to phi = 0 after every step, which Sect. 4.3 does not do")
        used = out.diagnostics.get("penalty", np.full(len(out.t), self.penalty))
        loose = np.flatnonzero(np.nan_to_num(used, nan=self.penalty) < self.penalty)
        if len(loose) and self.loop == "proximal" and self.singular_turn:
            after = out.t[loose[0]]
            notes.append(
                f"from t = {after:.6g} s on, steps cut where a body would turn further than {self.singular_turn:g} rad"
            )
        if crossed:
            notes.append(f"{len(crossed)} singular passages")
        return replace(out, setup_time=set_up + out.setup_time, events=crossed, notes=tuple(notes))
