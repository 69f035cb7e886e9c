"""The free choices of ODE-GC, which the paper leaves open: options shared with its augmented Lagrangian version.

Compiled code reads them as ``Settings``.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ....harness.catalogue.options import option
from ....harness.mechanics.motion import applied_loads, kinetic_energy
from ....harness.mechanics.state import States
from ....harness.mechanics.system import GROUND, MultibodySystem
from ....harness.mechanics.types import Problem, StepControl
from ..compiled import mechanism
from ..compiled.host import code_option, refuse_unused
from ..compiled.kernel import allocate_kernel

CHOICES = ("a", "mass", "translation")  # choices of c_R
FINAL_ITERATES = ("passing", "corrected", "after_correction")  # which Newton iterate ends a step
PASSING, CORRECTED, AFTER_CORRECTION = range(3)


class Settings(NamedTuple):
    """The choices of docs/notation.md on which compiled code branches; the defaults are the plain weak form."""

    gauge: float = -1.0  # -1 symmetric, 0 zero and accumulate
    keep_nu: int = 0  # 1: nu is carried from step to step (accumulate, or C_bar, K_bar != 0)
    direction: int = 0  # index in ``CHOICES``
    use_f_bar: int = 1
    corrective: int = 0  # 1: C_bar, K_bar are not zero; mu, lam and sigma carried
    by_forces: int = 0  # 1: C_bar, K_bar by Eq. (32)
    c_bar: float = 0.0  # [1/s] added to C_bar, per M_bar
    k_bar: float = 0.0  # [1/s2] added to K_bar, per M_bar
    carry_sigma: int = 0  # 1: sigma0 of (75) is that of (62) at the last step, else 0
    b_term: float = 1.0  # 0 drops the B term of Eq. (71), which costs the order (a planted error)
    tolerance: float = 1e-8  # [sqrt(J)], Eqs. (80), (81)
    max_newton: int = 20
    refresh: float = 0.2  # a kept factorisation is renewed when a correction shrinks the residual by less than this
    couple: int = 1  # 1: body-to-body blocks of the Jacobian are kept
    extrapolate: float = 1.0  # 0: the first estimate of a step is its start
    final: int = PASSING  # index in ``FINAL_ITERATES``
    velocity: int = 0  # 1: the first mu is the velocity along c_R, else 0
    max_cuts: int = 16  # halvings of a step that fails
    max_turn: float = np.inf  # [rad] a step in which a body would turn further is halved
    simplified: int = 0  # 1: the simplified Newton method where it applies
    whole: int = 0  # 1: with code for the mechanism
    active: int = 0  # 1: augmented Lagrangian, which alone reads what follows
    always_nested: int = 0  # 1: the paper's nested loop, Newton to convergence, then (85)
    penalty: float = 1.0  # xi
    max_augmentations: int = 1  # rounds of the nested loop
    accept: float = 0.0  # [sqrt(J)] (81) at which a step counts as done though (81) does not reach the tolerance
    closes_pose: int = 0  # 1: poses corrected to phi = 0 after every step
    soft: float = 1.0  # xi (omega dt)^2 of the nested loop at singular configurations
    lambda_bar: int = 0  # 1: lam - xi phi of Eq. (84) in the nested loop
    growth: float = 1.0  # factor on xi after an augmentation that does not reduce phi_dot enough
    singular_turn: float = np.inf  # [rad] limit on the turn in a step once a singular configuration has been met
    redundant: int = 0  # 1: rows are redundant, and the part of phi_dot that no velocity can change is left

    @property
    def diagnostic_names(self) -> tuple[str, ...]:
        """Names of the diagnostics of each step: with a penalty all of ``DIAGNOSTICS``, else the first four."""
        return DIAGNOSTICS if self.active else DIAGNOSTICS[:4]

    def numbers(self) -> dict[str, float]:
        """Return the settings by name as numbers for a record, each of the type of its default, int or float."""
        return {name: type(self._field_defaults[name])(x) for name, x in self._asdict().items()}


def find_unsupported(settings: Settings, system: MultibodySystem) -> str:
    """Return in words what ``settings`` and ``system`` need and the simplified method lacks; empty where it applies."""
    if settings.max_turn < np.inf:
        return "max_turn"
    if any(len(a) for a in (system.spring_k, system.torsion_k, system.load_i, system.user_i)):
        return "forces beside gravity"
    if settings.corrective or settings.carry_sigma or settings.always_nested:
        return "C_bar, K_bar, a carried sigma or nested loops"
    if settings.simplified != 1:
        return "newton = exact, another estimate than extrapolated, another final_iterate than passing, or mu0"
    return "" if system.is_pinned else "joints other than spherical and revolute ones"


DIAGNOSTICS = (
    "newton_iterations",
    "cut_level",
    "residual_norm",
    "constraint_norm",
    "penalty",
    "log_determinant",
)  # diagnostics of each step
ITERATIONS, LEVEL, RESIDUAL, SLIP, PENALTY, DETERMINANT = range(6)  # their places
# share of the root of the energy, 45 roundings: a residual has a few, no smaller tolerance can be met. At the default
# tolerance half and twice change no bit of eight runs: it is far above both.
ROUNDINGS = 1e-14
GAUGES = {"symmetric": "symmetric", "zero": "zero gauge", "accumulate": "accumulating"}


def estimate_energy(problem: Problem) -> float:
    """Return the scale of energy [J] of a problem; 1 if it is at rest without forces.

    It is the kinetic energy at the start, plus the sizes of the applied forces there times the largest joint arm or
    radius of gyration, plus the sizes of the applied torques times 1 rad.
    """
    system, start = problem.system, States.one(problem.initial)
    arms = np.concatenate((system.joint_s_i, system.joint_s_j[system.joint_j != GROUND]))
    size = np.max(np.concatenate((system.gyration, np.linalg.norm(arms, axis=1))))
    force, torque = np.split(np.linalg.norm(applied_loads(system, start)[0].reshape(-1, 2, 3), axis=2), 2, axis=1)
    found = float(kinetic_energy(system, start)[0] + np.sum(force) * size + np.sum(torque))
    return found or 1.0  # at rest and without forces nothing will move


@dataclass(frozen=True)
class GaugeChoices:
    """Options of a geometric solver; the first of each list is the default, for reasons in docs/notation.md."""

    gauge: str = option(
        "symmetric",
        "value of mu at a step's start, of which only increments are physical: minus its end value "
        "(time-reversible), zero, or carried on as printed",
        choices=tuple(GAUGES),
    )
    mu0: str = option(
        "zero", "first mu of the accumulate gauge: zero or the velocity along c_R", choices=("zero", "velocity")
    )
    sigma0: str = option("zero", "sigma of (75): zero, or carried from (62)", choices=("zero", "carried"))
    direction: str = option("a", "c_R of Eq. (31): a/(a.a), M^-1 a/(a.M^-1 a), or (e_k, 0)", choices=CHOICES)
    f_bar: bool = option(True, "f_bar of Eq. (30) taken out of nu")
    corrective: bool = option(True, "C_bar, K_bar of Eq. (32) where springs or dampers make them non-zero")
    c_bar: float = option(
        0.0, "given C_bar of Eq. (37) in every row, per M_bar; added to that of (32)", "1/s", at_least=0.0
    )
    k_bar: float = option(
        0.0, "given K_bar of Eq. (37) in every row, per M_bar; added to that of (32)", "1/s2", at_least=0.0
    )
    b_term: bool = option(True, "B term of Eq. (71); without it the scheme loses its order (a planted error)")
    tolerance: float = option(
        1e-8,
        "tolerance of tests (80), (81); times the root of the energy where that is below 1 J",
        "sqrt(J)",
        above=0.0,
    )
    max_newton: int = option(20, "corrections of the full Newton method before the step is cut", "", at_least=1)
    newton: str = option(
        "simplified",
        "simplified: on A M^-1 A^T, where gravity is the only force, sigma0 and mu0 are zero, no loop is nested, "
        "the estimate is extrapolated and the passing iterate final, else as kept; kept: Jacobian renewed when it no "
        "longer contracts by 5; exact: that of each iterate, Eq. (79), in the unknowns v and M_bar mu and without the "
        "slopes of M_bar, which is constant for translations",
        choices=("simplified", "kept", "exact"),
    )
    estimate: str = option(
        "extrapolated",
        "first estimate of a step, which the paper leaves open: extrapolated from the steps before, or "
        "the step's start",
        choices=("extrapolated", "start"),
    )
    final_iterate: str = option(
        "passing",
        "Newton iterate that ends a step, which the paper leaves open: the first that passes (80), (81), be "
        "it the estimate itself; that one corrected once more by (79); or the first that passes after one correction",
        choices=FINAL_ITERATES,
    )
    code: str = code_option("kernel", "mechanism", "plain")
    max_cuts: int = option(16, "halvings of dt before the run ends in step underflow", "", at_least=0, at_most=40)
    max_turn: float = option(
        0.0, "cut the step where a body would turn further in it; 0: no limit", "rad", at_least=0.0
    )

    variant: ClassVar[str] = ""  # variant of ODE-GC, named before the gauge
    has_plain: ClassVar[bool] = False  # a form in solvers/plain

    @property
    def follows_paper(self) -> bool:
        """True if the options agree with all that the paper's Sect. 4.2 prints.

        Left open there, and not compared, are c_R, mu0, the tolerance, the first estimate and the final iterate.
        """
        return (
            (self.gauge, self.sigma0, self.newton) == ("accumulate", "carried", "exact")
            and (self.f_bar, self.corrective, self.b_term) == (True, True, True)
            and (self.c_bar, self.k_bar, self.max_turn) == (0.0, 0.0, 0.0)
        )

    @property
    def paper_label(self) -> str:
        """Label of ODE-GC with these choices: as printed, or with the gauge and the quantities carried."""
        if self.follows_paper:
            return f"ODE-GC ({self.variant}as printed)"
        words = [GAUGES[self.gauge]]
        if self.sigma0 == "carried":
            words.append("sigma carried")
        if self.c_bar or self.k_bar:
            words = ["C_bar, K_bar given"]  # mu is then physical and has no gauge
        return f"ODE-GC ({self.variant}{', '.join(words)})"

    def make_settings(self, problem: Problem) -> Settings:
        """Return the options as ``Settings`` for a problem.

        Where C_bar or K_bar is not zero, given or by springs, mu, lam and sigma are carried, whatever the gauge.
        """
        by_forces = self.corrective and len(problem.system.spring_k) > 0
        corrective = by_forces or self.c_bar > 0.0 or self.k_bar > 0.0
        exact = self.newton == "exact"
        return Settings(
            gauge=-1.0 if self.gauge == "symmetric" and not corrective else 0.0,
            keep_nu=self.gauge == "accumulate" or corrective,
            direction=CHOICES.index(self.direction),
            use_f_bar=self.f_bar,
            corrective=corrective,
            by_forces=by_forces,
            c_bar=self.c_bar,
            k_bar=self.k_bar,
            carry_sigma=self.sigma0 == "carried" or corrective,
            b_term=float(self.b_term),
            tolerance=self.scale_tolerance(self.tolerance, problem),
            max_newton=self.max_newton,
            refresh=0.0 if exact else 0.2,
            couple=exact,
            extrapolate=float(self.estimate == "extrapolated"),
            final=FINAL_ITERATES.index(self.final_iterate),
            velocity=self.mu0 == "velocity",
            max_cuts=self.max_cuts,
            max_turn=self.max_turn or np.inf,
            simplified=(self.newton, self.estimate, self.mu0, self.final_iterate)
            == ("simplified", "extrapolated", "zero", "passing"),
            whole=self.code == "mechanism",
        )

    @staticmethod
    def scale_tolerance(tolerance: float, problem: Problem) -> float:
        """Return ``tolerance`` [sqrt(J)] times the root of the problem's energy [J] where that is below 1.

        The result is at least ``ROUNDINGS`` of that root, the rounding of a residual.
        """
        root = float(np.sqrt(estimate_energy(problem)))
        return max(tolerance * min(root, 1.0), ROUNDINGS * root)

    def notes(self, problem: Problem) -> tuple[str, ...]:
        """Return notes on options that have no effect on the problem, at most one."""
        if self.make_settings(problem).corrective and self.gauge != "accumulate":
            return (f"mu is carried on as printed, for C_bar or K_bar is not zero: gauge = {self.gauge} has no effect",)
        return ()

    def refuses_choice(self, problem: Problem, control: StepControl) -> str | None:
        """Return why these options do not fit the problem or the step control, or None."""
        if control.dt is None:
            return "takes a fixed step: give dt, not rtol"
        steps = problem.t_end / control.dt
        if steps > control.max_steps:
            return (
                f"dt = {control.dt:g} s needs {steps:.3g} steps to t = {problem.t_end:g} s, "
                f"more than max_steps = {control.max_steps}"
            )
        return self.refuses_direction(problem) or self.refuses_code(problem)

    def refuses_code(self, problem: Problem) -> str | None:
        """Return why code of the mechanism, or plain code, cannot solve the problem where it is chosen, or None."""
        if self.code == "kernel":
            return None
        if self.code == "plain":
            lacks = "" if self.has_plain else "plain steps know no extrapolation and no composition"
            lacks = lacks or ("plain steps keep no Jacobian: set newton = exact" if self.newton == "kept" else "")
            return lacks or refuse_unused(self, "max_turn")
        more = find_unsupported(self.make_settings(problem), problem.system)
        if more:
            return f"code for the mechanism is the simplified method's, which does not take {more}: use code = kernel"
        return mechanism.find_code_refusal(problem.system, allocate_kernel(problem.system))

    def refuses_direction(self, problem: Problem) -> str | None:
        """Return why the direction c_R does not exist for some joint of the problem, or None."""
        if self.direction == "translation" and not np.all(problem.system.joint_rows == problem.system.joint_points):
            return "direction 'translation' needs spherical joints: other rows have no translation of their own"
        return None
