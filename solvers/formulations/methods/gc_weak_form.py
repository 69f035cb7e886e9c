"""ODE-GC with fixed steps by the simplified method, and by the full one where the former does not converge.

Reactions are means over the steps.
"""

import math
from functools import partial
from typing import Any

import numpy as np

from ....harness.base.code_meter import collect_garbage, making_code
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Problem, StepControl, Trajectory
from ...plain import ode_gc
from ..compiled.algebra import orthogonalise_rotations
from ..compiled.entries import run
from ..compiled.host import ENDS, Marcher, Method, integrate
from ..compiled.marching import FULL, NOT_FINITE, STUCK, Record
from ..recording import move_reactions_to_nodes
from .choices import DETERMINANT, ITERATIONS, PENALTY, RESIDUAL, SLIP, GaugeChoices, Settings, find_unsupported
from .gc_newton import COUNTERS, make_newton_method
from .gc_step import NEEDED, accept_step, begin_march, begin_step, find_end, make_step

ROUNDING = 1e-14  # share of the square of the largest velocity below which accelerations and loads are rounding
# steps of the full method after one that the simplified method does not solve, first and at most. Half of the first
# tries the simplified one sooner and takes 1 to 3 % more iterations at long steps; twice changes them by one.
PATIENCE, MOST_PATIENCE = 8, 1024


def integrate_weak_form(
    problem: Problem, control: StepControl, choices: GaugeChoices, settings: Settings
) -> Trajectory:
    """Integrate by the simplified method where it applies, else by the full one, or by plain steps with code=plain.

    Reactions of the trajectory are interpolated from the means over the steps.
    """
    if choices.code == "plain":
        return move_reactions_to_nodes(ode_gc.integrate(problem, control, choices, settings))
    method = make_newton_method(problem.system, settings)
    if not find_unsupported(settings, problem.system):
        method = make_simplified_method(problem.system, settings, method)
    return move_reactions_to_nodes(integrate(problem, control, method))


def make_simplified_method(system: MultibodySystem, settings: Settings, full: Method) -> Method:
    """Make the simplified method, for ``host.integrate``, with ``full`` for steps on which it does not converge."""

    def make_fallback(problem: Problem, simple: Marcher) -> Marcher | FallbackMarcher:
        """Return a marcher of both methods, or of the full one alone where the simplified one must not be used.

        It must not where rows are redundant, unless the augmented Lagrangian form is asked for, whose motion it gives
        by leaving rows out; nor where nothing accelerates and no row bears a load, as with a body in uniform rotation:
        there the full method takes no correction and adds no rounding.
        """
        k = simple.kernel
        dropped = not settings.active and int(k.state["rank"]) < len(k.lam)
        largest = max(np.max(np.abs(k.v_dot), initial=0.0), np.max(np.abs(k.lam), initial=0.0))
        if not dropped and largest > ROUNDING * np.max(k.v**2, initial=0.0):
            return FallbackMarcher(problem, simple, full)
        simple.state["most_cuts"] = full.most_cuts
        with making_code:
            return Marcher(problem, full, simple.state)

    return Method(
        partial(make_step, system, settings=settings),
        take_step,
        finish,
        start,
        counters=COUNTERS,
        diagnostic_names=settings.diagnostic_names,
        needs=(*NEEDED, *(("close_joints",) if settings.closes_pose else ())),
        make_fallback=make_fallback,
        explain=full.explain,
        notes=("code of the mechanism",) if settings.whole else (),
    )


class FallbackMarcher:
    """A march by the simplified method, and by the full one from each step on which that does not converge."""

    def __init__(self, problem: Problem, simple: Marcher, full: Method) -> None:
        """Begin with the simplified method's marcher, whose control and start this march shares."""
        self._problem, self._simple, self._full = problem, simple, full
        self.state, self.kernel, self.reaction = simple.state, simple.kernel, simple.reaction
        self._other: Marcher | None = None
        self._last_marcher: Marcher | None = None
        self._patience, self._stuck = PATIENCE, False
        self._level, self._shift = 0.0, 0.0

    def explain(self, outcome: int) -> str:
        """Return the message for an ``outcome`` of the march: the full method's, once that was used."""
        if self._other is None and outcome != NOT_FINITE:  # the simplified step has no norms to tell
            return ENDS[outcome][1]
        return (self._other or self._simple).explain(outcome)

    def stretch(self, n: int) -> Record:
        """March up to ``n`` steps by one of the methods; return the record of those accepted.

        The full method's steps may be cut, the simplified one's are those of the grid of dt. The number of steps that
        the full method takes in a row doubles from call to call, as long as the simplified one fails soon after. Where
        the full method limits rotations, which the simplified one does not, it goes on to the end.
        """
        control, other = self.state, self._other
        limited = other is not None and np.isfinite(other.bundle.scheme["max_turn"])
        if other is not None and (self._stuck or control["place"] or control["level"] or limited):
            control["most_cuts"] = self._full.most_cuts
            record = other.stretch(min(n, self._patience))
            self._patience, self._stuck = min(2 * self._patience, MOST_PATIENCE), False
            self._return_to_simplified(other.bundle)
            self._join_determinants(other, record)
            return record
        control["most_cuts"] = 0
        record = self._simple.stretch(n)
        self._join_determinants(self._simple, record)
        if len(record.t) > PATIENCE:
            self._patience = PATIENCE
        if control["outcome"] == STUCK:
            control["outcome"], self._stuck = FULL, True
            control["cuts"] -= 1
            self._hand_over()
        return record

    def _join_determinants(self, marcher: Marcher, record: Record) -> None:
        """Change the logarithms of determinants in ``record`` by a constant, so that both methods give one series.

        The methods drop different redundant rows, so their determinants differ by a factor. Without a penalty there are
        no determinants.
        """
        log_det = record.diagnostics[:, DETERMINANT:]  # none without a penalty
        if log_det.size:
            if self._last_marcher not in (None, marcher):
                self._shift = self._level - log_det[0, 0]
            self._last_marcher = marcher
            log_det += self._shift
            self._level = log_det[-1, 0]

    def _hand_over(self) -> None:
        """Set the full method to the start of the step that the simplified one did not solve, with its last two steps.

        The full method's marcher is made at the first call.
        """
        if self._other is None:
            with making_code:
                self._other = Marcher(self._problem, self._full, self.state)
            collect_garbage()
        simple, full, h = self._simple.bundle, self._other.bundle, float(self.state["dt"])
        k, terms = full.kernel, full.terms
        k.r[:], k.R[:], k.v[:], k.t[0] = simple.r0, simple.R0, simple.v0, self.state["t"]
        self._other.start()
        terms.nu_start[:] = simple.nu_start
        full.scheme["factored"], full.scheme["last"] = 0.0, h
        known, steps = int(simple.scheme["known"]), len(simple.middle)
        last, before = (known - 1) % steps, (known - 2) % steps
        full.v_old[:] = simple.v0 - h * simple.acceleration[last]
        if simple.scheme["keep_nu"]:
            terms.nu_change[:] = h * simple.impulse[last]
        else:
            scale = h / (1.0 - float(simple.scheme["gauge"]))
            terms.nu_old[:] = scale * simple.impulse[last]
            terms.nu_change[:] = terms.nu_old - scale * simple.impulse[before] if known > 1 else 0.0

    def _return_to_simplified(self, full: Any) -> None:
        """Copy pose, velocity, nu_start and time from ``full``, the full method's bundle, to the simplified method.

        The last step becomes the only known past step: its acceleration is (v - v_old) / h, its impulse per time is
        nu_change / h where nu is kept, else (1 - gauge) nu_old / h, the inverse of ``_hand_over``.
        """
        simple, terms, h = self._simple.bundle, full.terms, float(full.scheme["last"])
        k, end = simple.kernel, full.kernel
        k.r[:], k.R[:], k.v[:], k.t[0] = end.r, end.R, end.v, end.t[0]
        simple.nu_start[:] = terms.nu_start
        simple.scheme["known"], simple.scheme["factored"], simple.scheme["begun"] = 1, 0, 0
        simple.acceleration[0] = (k.v - full.v_old) / h
        simple.middle[0] = self.state["t"] - 0.5 * h
        gauge, keep_nu = float(simple.scheme["gauge"]), simple.scheme["keep_nu"]
        simple.impulse[0] = terms.nu_change / h if keep_nu else (1.0 - gauge) * terms.nu_old / h


def start(step):
    """Compute acceleration and multipliers of index 1 at the start, from which the first step is estimated."""
    begin_march(step)


def take_step(step):
    """Take one step of ``control.h``; set ``control.status`` to STUCK where it does not converge.

    The step is begun here unless ``finish`` has begun it. Its start stays in ``r0``, ``R0``, ``v0``.
    """
    control, scheme = step.control, step.scheme
    step.diagnostics[ITERATIONS] = control.iterations
    if not (scheme.begun and step.plan.half == 0.5 * control.h):
        begin_step(step, control.h)
    scheme.begun = 0
    step.diagnostics[RESIDUAL] = find_end(step, control.h, control.t + 0.5 * control.h)
    if step.diagnostics[RESIDUAL] < 0.0:
        control.status = STUCK


def finish(step):
    """Correct the poses of the end, store the step for later estimates, and set ``lam`` to its mean reaction.

    The next step is begun here, since the mean reaction needs f_bar at the end, which is that at the next start. The
    diagnostics of the step are set.
    """
    control, scheme, kernel, total = step.control, step.scheme, step.kernel, 0.0
    run(step.correct)
    orthogonalise_rotations(kernel.R)
    accept_step(step, control.h, control.t + 0.5 * control.h)
    last = (scheme.known - 1) % len(step.middle)
    for a in range(len(kernel.lam)):
        kernel.lam[a] = step.impulse[last, a] - 0.5 * step.f_bar0[a]
    kernel.t[0] = control.t + control.h
    begin_step(step, control.h)
    scheme.begun = 1
    for a in range(len(kernel.lam)):
        kernel.lam[a] -= 0.5 * step.f_bar0[a]
        total += step.slip[a]
    step.diagnostics[ITERATIONS] = control.iterations - step.diagnostics[ITERATIONS]
    step.diagnostics[SLIP] = math.sqrt(total)
    if scheme.active:
        step.diagnostics[PENALTY] = scheme.penalty
        step.diagnostics[DETERMINANT] = scheme.log_det
