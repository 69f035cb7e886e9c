"""ODE-GC with fixed steps by the full Newton method: its arrays and entries for one mechanism, and its integration."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Problem, StepControl, Trajectory
from ..compiled.block_lu import factor, solve
from ..compiled.bundles import make_bundle, make_record
from ..compiled.entries import BoundFunction
from ..compiled.host import Method, integrate
from ..compiled.kernel import Kernel, Loops, list_places
from ..compiled.kernel import Step as Call
from ..compiled.marching import NOT_FINITE
from ..compiled.saddle_pattern import analyse_saddle
from ..generated import Program
from ..rows.kept_code import load_newton_code
from . import gc_newton
from .choices import DIAGNOSTICS, Settings
from .gc_newton import ARRAYS, PARTS, TERMS

COUNTERS = ("iterations", "residuals", "factorisations", "solves", "cuts", "augmentations", "loose_steps")


def integrate_newton(problem: Problem, control: StepControl, method: Method) -> Trajectory:
    """Integrate by ``method``, and convert the mean reactions over steps to reactions at the nodes."""
    return move_reactions_to_nodes(integrate(problem, control, method))


def move_reactions_to_nodes(out: Trajectory) -> Trajectory:
    """Return a copy of the trajectory with reactions at the nodes instead of means over the steps before them.

    A trajectory without reactions is returned as it is.
    """
    if out.reaction is None:  # the run was refused
        return out
    return replace(out, reaction=interpolate_to_nodes(np.diff(out.t), out.reaction[1:]))


def interpolate_to_nodes(dt: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Return values at the nodes from means over the steps between them (second order), linear at the ends.

    ``dt`` [s] are the lengths of the steps; without any step, the result is one row of NaN.
    """
    n = len(dt)
    if n == 0:
        return np.full((1, mean.shape[1]), np.nan)
    if n == 1:
        return np.repeat(mean, 2, axis=0)
    w = (dt[1:] / (dt[:-1] + dt[1:]))[:, None]
    inner = w * mean[:-1] + (1.0 - w) * mean[1:]
    slope_first = (mean[1] - mean[0]) / (dt[0] + dt[1])
    slope_last = (mean[-1] - mean[-2]) / (dt[-1] + dt[-2])
    return np.concatenate(((mean[0] - dt[0] * slope_first)[None], inner, (mean[-1] + dt[-1] * slope_last)[None]))


def make_newton_method(system: MultibodySystem, settings: Settings, max_cuts: int, max_turn: float, mu0: str) -> Method:
    """Make ODE-GC's method by full Newton iterations with these choices, for ``host.integrate``.

    ``max_turn`` [rad] limits the rotation of a body in a step, 0: no limit; with ``mu0`` "velocity" the first mu is the
    velocity along c_R. A step is halved ``max_cuts`` times at most.
    """
    of_system = partial(
        make_step, system=system, settings=settings, max_turn=max_turn or np.inf, velocity=mu0 == "velocity"
    )
    return Method(
        of_system,
        gc_newton.step,
        gc_newton.finish,
        gc_newton.start,
        counters=COUNTERS,
        most_cuts=max_cuts,
        diagnostic_names=DIAGNOSTICS if settings.active else DIAGNOSTICS[:4],
        explain=partial(explain, most_cuts=max_cuts),
        needs=NEEDED,
    )


NEEDED = ("applied_forces", "applied_slopes", "spring_slopes")
ENTRIES = (*PARTS, "measure", "direction", "begin", "balance", "slopes", "factor_saddle", "solve_saddle")


def make_step(
    k: Kernel,
    control: np.ndarray,
    *,
    system: MultibodySystem,
    settings: Settings,
    max_turn: float = np.inf,
    velocity: bool = False,
) -> Any:
    """Make the bundle of one step: its arrays and entries; no step is taken.

    ``velocity``: the first mu is the velocity along c_R; ``max_turn`` [rad] limits the rotation of a body in a step.
    """
    nb, nr, direction, couple = len(k.mass), len(k.lam), settings.direction, bool(settings.couple)
    pushes = any(len(getattr(system, f"{kind}_i")) for kind in ("spring", "torsion", "load", "user"))
    scheme = make_record(
        **settings.numbers(),
        max_turn=max_turn,
        velocity=velocity,
        pushed=pushes,
        # the present step: its length, penalty, length of the factor's step (0: none), norms (80) and (81), log10 of
        # the determinant, its change, its largest; length of the last step (0: none)
        h=0.0,
        xi=settings.penalty,
        factored=0.0,
        norm=0.0,
        slip=0.0,
        log_det=0.0,
        fall=0.0,
        highest=-np.inf,
        last=0.0,
        nested=0,
        outcome=0,
        corrections=0,  # before the last try; nested: inside the nested loop; outcome: of the last try
    )
    pair_at = {(int(a), int(b)): n for n, (a, b) in enumerate(k.pair)}
    pushed = {
        (int(a), int(b))
        for kind in ("spring", "torsion", "user")
        for one in zip(getattr(system, f"{kind}_i"), getattr(system, f"{kind}_j"), strict=True)
        for a, b in (one, one[::-1])
        if a != b and min(a, b) >= 0
    }
    apart = np.arange(nb, len(k.pair)) if couple else np.array(sorted(pair_at[p] for p in pushed), dtype=np.int64)
    saddle, lu = analyse_saddle(k.body, k.row, k.pair, apart)
    couples = [[[pair_at.get((int(a), int(b)), -1) for b in ends] for a in ends] for ends in k.body]
    step = make_bundle(
        "Step",
        ARRAYS,
        {"nb": nb, "nr": nr, "n": len(lu.x)},
        ENTRIES,
        control=control,
        kernel=k,
        scheme=scheme,
        diagnostics=np.zeros(len(DIAGNOSTICS) if settings.active else 4),
        terms=make_bundle("Terms", dict.fromkeys(TERMS, "nr"), {"nr": nr}),
        # pairs of the kernel: load of end e by the motion of end o; places of rows in ``lu.x``
        couple=np.array(couples, dtype=np.int64).reshape(-1, 2, 2),
        saddle=saddle,
        lu=lu,
        row_at=np.repeat(lu.joint_at - k.row[:-1], np.diff(k.row)) + np.arange(nr),
    )
    loops = NewtonLoops(system, k)
    loops.step, loops.couple, loops.choice = step, couple, direction
    entries: dict[str, Any] = dict(loops.entries())
    entries |= {"factor_saddle": BoundFunction(factor, lu), "solve_saddle": BoundFunction(solve, lu)}
    step = step._replace(**entries)
    optional = {"leave_redundant": settings.redundant, "correct_pose": settings.closes_pose}
    for name in PARTS:
        entered = optional.get(name, 1)
        entry: dict[str, Any] = {name: BoundFunction(getattr(gc_newton, name), step) if entered else Program([])}
        step = step._replace(**entry)
    return step


def explain(s: Any, outcome: int, *, most_cuts: int) -> str:
    """Return the message for an ``outcome`` of a march that failed: the tolerance that was missed, and by how much."""
    cut = f"with the step cut {most_cuts} times"
    if outcome == NOT_FINITE:
        return f"not a finite number {cut}"
    tolerance, residual, phi_dot = (float(s.scheme[name]) for name in ("tolerance", "norm", "slip"))
    return (
        f"Newton's method does not reach {tolerance:g} sqrt(J) {cut} "
        f"(residual {residual:.3g}, constraint norm {phi_dot:.3g})"
    )


class NewtonLoops(Loops):
    """The loops of ``rows.newton`` on the arrays of a kernel and of a step."""

    step: Any  # the step of ``gc_newton``
    couple: bool
    choice: int  # choice of c in Eq. (31)

    def entries(self) -> dict[str, Any]:
        """Return a program for each function of ``rows.newton``, over all groups of joints."""
        s, k = self.step, self._k
        o, system, symmetric = s.terms, self._system, bool(s.scheme["gauge"] != 0.0)
        inertia = np.concatenate((system.mass[:, None], k.J.reshape(-1, 9), k.J_inv.reshape(-1, 9)), axis=1)
        use_f_bar = bool(s.scheme["use_f_bar"])
        calls: dict[str, list[Call]] = {name: [] for name in ("measure", "direction", "begin", "balance", "slopes")}
        for group in self._groups:
            own, ends, n = group.rows, group.ends, int(group.members[0])
            six = slice(6 * own.start, 6 * own.stop)
            code = load_newton_code(
                *group.key, self.choice, symmetric=symmetric, use_f_bar=use_f_bar, couple=self.couple
            )
            pose, more = ((k.r, 3), (k.R, 9), (k.v, 6)), ((k.force, 6), (inertia, 19))
            kept = np.zeros((n, 6 * len(ends) * (own.stop - own.start) // max(n, 1)))
            room = [kept] if symmetric else []
            blocks = [(a, b) for a in ends for b in ends if self.couple or a == b]
            to: list[np.ndarray] = []
            for a, b in blocks:
                to += [s.saddle.bodies, 36 * np.array([self._place[int(x[a]), int(x[b])] for x in group.body])]
            sloped = (*pose, *more, (s.T, 9)) if self.couple and use_f_bar else (*pose, (s.T, 9))
            given = {
                "measure": [
                    k.t,
                    group.numbers,
                    *list_places(group, *pose, *more),
                    o.phi1[own],
                    o.phi_dot1[own],
                    o.m_bar[own],
                    o.f_bar1[own],
                ],
                "direction": [k.t, group.numbers, *list_places(group, *pose, *more), *(s.c[e, own] for e in ends)],
                "begin": [
                    k.t,
                    s.plan,
                    group.numbers,
                    o.nu_start[own],
                    o.G0[own],
                    *list_places(group, *pose),
                    *room,
                    *list_places(group, (s.known, 6)),
                ],
                "balance": [
                    k.t,
                    s.plan,
                    group.numbers,
                    *room,
                    o.nu[own],
                    o.p[own],
                    o.z[own],
                    *list_places(group, *pose),
                    *list_places(group, (s.off, 6)),
                ],
                "slopes": [
                    k.t,
                    s.plan,
                    group.numbers,
                    *room,
                    o.nu[own],
                    o.p[own],
                    o.z[own],
                    o.stiff[own],
                    o.on_rate[own],
                    o.on_phi[own],
                    *list_places(group, *sloped),
                    *(s.saddle.column[e, six] for e in ends),
                    *(s.saddle.row[e, six] for e in ends),
                    *to,
                ],
            }
            for name, arrays in given.items():
                calls[name].append((code.address(name), [group.members, *arrays]))
            self._keeps.append(code)
        return {name: Program(some, (self._keeps, inertia)) for name, some in calls.items()}
