"""ODE-GC with fixed steps by the simplified method, and by the full one where the former does not converge.

Reactions are means over the steps.
"""

import math
from typing import Any

import numpy as np

from ....harness.base.code_meter import collect_garbage, making_code
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Problem, StepControl, Trajectory
from ...plain import ode_gc
from ..compiled.algebra import orthogonalise_rotations
from ..compiled.bundles import make_bundle
from ..compiled.entries import BoundFunction, run
from ..compiled.host import Marcher, Method
from ..compiled.kernel import Kernel
from ..compiled.marching import FULL, STUCK, Record
from .choices import DIAGNOSTICS, GaugeChoices, Settings, find_unsupported
from .gc_newton_arrays import integrate_newton, make_newton_method, move_reactions_to_nodes
from .gc_step import NEEDED, accept_step, begin_march, begin_step, make_step, take_step

ROUNDING = 1e-14  # share of the square of the largest velocity below which accelerations and loads are rounding
PATIENCE, MOST_PATIENCE = 8, 1024  # steps of the full method after one that the simplified method does not solve


def integrate_weak_form(
    problem: Problem, control: StepControl, choices: GaugeChoices, settings: Settings
) -> Trajectory:
    """Integrate by the simplified method where it applies, else by the full one, or by plain steps with code=plain."""
    if choices.code == "plain":
        return move_reactions_to_nodes(ode_gc.integrate(problem, control, choices, settings))
    method = make_newton_method(problem.system, settings, choices.max_cuts, choices.max_turn, choices.mu0)
    if not (choices.max_turn or find_unsupported(settings, problem.system)):
        method = make_simplified_method(problem.system, settings, method)
    return integrate_newton(problem, control, method)


def make_simplified_method(system: MultibodySystem, choices: Settings, full: Method) -> Method:
    """Make the simplified method, for ``host.integrate``, with ``full`` for stretches where it does not converge."""

    def prepare(kernel: Kernel, control: np.ndarray) -> Any:
        """Make the bundle of a step for this kernel and control."""
        one = make_step(system, kernel, control, choices)
        diagnostics, penalty = one.diagnostics if choices.active else one.diagnostics[:4], np.array([choices.penalty])
        plain = make_bundle("Plain", {}, {}, ("begin_next",), step=one, diagnostics=diagnostics, penalty=penalty)
        return plain._replace(begin_next=BoundFunction(begin_next, plain))

    def make_fallback(problem: Problem, marcher: Marcher) -> Any:
        """Return the march that changes to the full method where the simplified one does not converge."""
        return FallbackMarcher(problem, marcher, full, bool(choices.active))

    return Method(
        prepare,
        step,
        finish,
        start,
        counters=full.counters,
        diagnostic_names=DIAGNOSTICS if choices.active else DIAGNOSTICS[:4],
        needs=(*NEEDED, *(("push",) if choices.closes_pose else ())),
        make_fallback=make_fallback,
        notes=("code of the mechanism",) if choices.whole else (),
    )


class FallbackMarcher:
    """A march by the simplified method, and by the full one for stretches in which that does not converge."""

    def __init__(self, problem: Problem, simple: Marcher, full: Method, saddle: bool) -> None:
        self._simple, self._full, self._problem, self._saddle = simple, full, problem, saddle
        self.state, self.kernel, self.reaction = simple.state, simple.kernel, simple.reaction
        self._other: Marcher | None = None
        self._patience, self._stuck = PATIENCE, False
        self._last_marcher: Marcher | None = None
        self._level, self._shift = 0.0, 0.0
        k = simple.kernel
        # Dropped pivots are the proximal saddle's motion; the plain weak form has none to offer. Where nothing
        # accelerates and no row bears a load (a body in uniform rotation), the full method takes no correction and adds
        # no rounding.
        dropped = not saddle and int(k.state["rank"]) < len(k.lam)
        rounding = ROUNDING * np.max(k.v**2, initial=0.0)
        loads = np.max(np.abs(k.v_dot), initial=0.0) > rounding or np.max(np.abs(k.lam), initial=0.0) > rounding
        self._simple_excluded = dropped or not loads
        if self._simple_excluded:
            self._hand_over()
            self.reaction = self._full_marcher.reaction

    @property
    def _full_marcher(self) -> Marcher:
        """The march of the full method, made when it is first needed."""
        if self._other is None:
            with making_code:
                self._other = Marcher(self._problem, self._full, self.state)
            collect_garbage()
        return self._other

    def explain(self, outcome: int) -> str:
        """Return the full method's message for an ``outcome`` of the march."""
        return self._full_marcher.explain(outcome)

    def stretch(self, n: int) -> Record:
        """March up to ``n`` steps by one of the methods; return the record of those accepted.

        The full method's steps begin and end anywhere, the simplified one's on the grid of dt.
        """
        c = self.state
        if self._simple_excluded or self._stuck or c["place"] or c["level"] or self._is_turn_limited:
            return self._march_full(n)
        c["most_cuts"] = 0
        record = self._simple.stretch(n)
        done = len(record.t)
        self._join_determinants(self._simple, record)
        if c["outcome"] == STUCK:
            c["outcome"], self._stuck = FULL, True
            c["cuts"] -= 1
            self._hand_over()
        if done > PATIENCE:
            self._patience = PATIENCE
        return record

    @property
    def _is_turn_limited(self) -> bool:
        """Flag of a limit on rotations in the full method's march, which the simplified one does not have."""
        return self._other is not None and bool(np.isfinite(self._other.bundle.scheme["max_turn"]))

    def _march_full(self, n: int) -> Record:
        """March up to ``n`` steps by the full method, and pass its state back to the simplified one, if that is used.

        In the latter case the limit on the number of steps doubles from call to call.
        """
        c, other = self.state, self._full_marcher
        c["most_cuts"] = self._full.most_cuts
        record = other.stretch(n if self._simple_excluded else min(n, self._patience))
        self._patience, self._stuck = min(2 * self._patience, MOST_PATIENCE), False
        if not self._simple_excluded:
            self._return_to_simplified()
        self._join_determinants(other, record)
        return record

    def _join_determinants(self, teller: Marcher, record: Record) -> None:
        """Change the determinants of ``record`` in place, so that those of both methods form one series without a jump.

        The methods drop different redundant rows, so the ratio of their determinants changes. ``teller`` is the march
        of the record.
        """
        if self._saddle and len(record.t):
            diagnostics = record.diagnostics[:, 5]
            if self._last_marcher not in (None, teller):
                self._shift = self._level - diagnostics[0]
            self._last_marcher = teller
            diagnostics += self._shift
            self._level = diagnostics[-1]

    def _hand_over(self) -> None:
        """Make the full method's march; if the simplified one is stuck, pass on its state and its last steps."""
        s, other, c = self._simple.bundle.step, self._full_marcher, self.state
        k, f, h = other.kernel, other.bundle, float(c["dt"])
        if self._stuck:
            k.r[:], k.R[:], k.v[:], k.t[0] = s.r0, s.R0, s.v0, c["t"]
            other.start()
            f.terms.nu_start[:] = s.nu_start
            f.scheme["factored"], f.scheme["last"] = 0.0, h
            last, before = ((int(s.scheme["known"]) - a) % len(s.middle) for a in (1, 2))
            f.old_v[:] = s.v0 - h * s.acceleration[last]
            if s.scheme["keep_nu"]:
                f.terms.increment[:] = h * s.impulse[last]
            else:
                scale = h / (1.0 - float(s.scheme["gauge"]))
                f.terms.old[:] = scale * s.impulse[last]
                f.terms.increment[:] = f.terms.old - scale * s.impulse[before] if s.scheme["known"] > 1 else 0.0

    def _return_to_simplified(self) -> None:
        """Copy pose, velocity, nu_start and time from the full method to the simplified one, with its last step.

        That becomes the only known past step: its acceleration is (v - old_v) / h, its impulse per time increment / h
        where nu is kept, else (1 - gauge) old / h, the inverse of ``_hand_over``.
        """
        s, f, c = self._simple.bundle.step, self._full_marcher.bundle, self.state
        k, o, h, g = s.kernel, f.kernel, float(f.scheme["last"]), s.scheme
        k.r[:], k.R[:], k.v[:], k.t[0] = o.r, o.R, o.v, o.t[0]
        s.nu_start[:] = f.terms.nu_start
        g["known"], g["factored"], g["begun"] = 1, 0, 0  # one past step, no factor of S, the next step not begun
        s.acceleration[0] = (k.v - f.old_v) / h
        s.middle[0] = c["t"] - 0.5 * h
        s.impulse[0] = f.terms.increment / h if g["keep_nu"] else (1.0 - float(g["gauge"])) * f.terms.old / h


def start(m):
    """Compute acceleration and multipliers of index 1 at the start, from which the first step is estimated."""
    begin_march(m.step)


def begin_next(m):
    """Begin the next step, of ``control.h``: ``begin_step`` as a separate entry."""
    begin_step(m.step, m.step.control.h)


def step(m):
    """Take one step of ``control.h``; set ``control.status`` to STUCK where it does not converge.

    Its start stays in ``r0``, ``R0``, ``v0``.
    """
    s, c = m.step, m.step.control
    s.diagnostics[0] = c.iterations
    if not (s.scheme.begun and s.plan[0] == 0.5 * c.h):
        run(m.begin_next)
    s.scheme.begun = 0
    s.diagnostics[2] = take_step(s, c.h, c.t + 0.5 * c.h)
    if s.diagnostics[2] < 0.0:
        c.status = STUCK


def finish(m):
    """Correct the poses of the end, store the step for later estimates, and set ``lam`` to its mean reaction.

    The next step is begun here, since its f_bar at the start is the one at this step's end.
    """
    s, c, k = m.step, m.step.control, m.step.kernel
    run(s.correct)
    orthogonalise_rotations(k.R)
    accept_step(s, c.h, c.t + 0.5 * c.h)
    d = (s.scheme.known - 1) % len(s.middle)
    for a in range(len(k.lam)):
        k.lam[a] = s.impulse[d, a] - 0.5 * s.f_bar0[a]
    k.t[0] = c.t + c.h
    run(m.begin_next)
    s.scheme.begun = 1
    total = 0.0
    for a in range(len(k.lam)):
        k.lam[a] -= 0.5 * s.f_bar0[a]
        total += s.slip[a]
    s.diagnostics[0] = c.iterations - s.diagnostics[0]
    s.diagnostics[3] = math.sqrt(total)
    s.diagnostics[4] = m.penalty[0]
    s.diagnostics[5] = s.scheme.log_det
