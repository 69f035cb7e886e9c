"""DOP853 on the coordinates of a tree, error-controlled, each accepted step projected onto its loops (compiled).

Tolerances are ``rtol (1 + |x|)`` of slides and velocities, vectors by their length, ``rtol`` of angles and half of it
of quaternions. The kernel takes over where a pivot falls to ``LEAST_PIVOT`` of its start, as it does where the rank of
the rows changes, where rows that were left out open, and where a step is cut ``MOST_CUTS`` times.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from ....harness.clock import cpu_seconds
from ....harness.types import Problem, States, Status, StepControl, Trajectory
from ..compiled import host as kernel
from ..compiled.algebra import copy
from ..compiled.entries import Bound, inner, run
from ..compiled.host import ENDS, FIRST_STEP, NAMES, UNTOLD, Method, _march
from ..compiled.marching import STUCK, March, Record, empty_record, march, new_control
from ..generated import Program
from ..methods.rkmk import explicit_pair
from ..methods.tableaux import DOPRI853
from ..recording import no_trajectory
from .code import MOST_OPERATIONS, least_operations, make_code, too_large
from .tree import Tree, spanning_tree

LEAST_PIVOT = 1e-6
OPEN = 1e-6  # of the size of the mechanism: rows that were left out
MOST_CUTS = 10


class Bodies(NamedTuple):
    """What is recorded of an accepted step; the names are those of a kernel."""

    r: Any  # (nb, 3)
    R: Any  # (nb, 3, 3)
    v: Any  # (nb, 6)
    v_dot: Any  # (nb, 6)
    lam: Any  # (nrows,) reactions
    order: Any  # (nrows,)


class Stages(NamedTuple):
    """Room for one step."""

    control: Any
    t: Any  # (1,)
    a: Any  # tableau: (s, s)
    b: Any  # (s,)
    c: Any  # (s,)
    estimate: Any  # (2, s + 1)
    start: Any  # (n,)
    y: Any  # (n,)
    y_dot: Any  # (n,)
    after: Any  # (n,) projected
    slopes: Any  # (s, n)
    sums: Any  # (2, n)
    block: Any  # (m, 3): first number, how many, and 0 of what has a length, else twice the tolerance of an angle
    guard: Any  # (2,) as code leaves it
    limits: Any  # (3,) least pivot, largest gap, rejections at the last accepted step
    accelerate: int
    finish: int
    record: int


def step(s: Any) -> None:
    """Stages and the error of a step of ``control.h``."""
    c, n = s.control, len(s.b)
    if c.rejected - s.limits[2] >= MOST_CUTS:
        c.status = STUCK
        return
    for i in range(1, n):
        _combine(s, s.a[i], i, s.y, c.h)
        s.t[0] = c.t + c.h * s.c[i]
        run(s.accelerate)
        c.evaluations += 1
        copy(s.y_dot, s.slopes[i])
    _combine(s, s.b, n, s.y, c.h)
    s.t[0] = c.t + c.h
    c.error = _error(s, c.h, c.rtol)


def finish(s: Any) -> None:
    """Project; the accelerations at what came in are the next step's first."""
    c = s.control
    run(s.finish)
    c.evaluations += 1
    c.factorisations = c.evaluations
    copy(s.after, s.y)
    copy(s.after, s.start)
    copy(s.y_dot, s.slopes[0])
    s.limits[2] = c.rejected
    if not (s.guard[0] > s.limits[0] and s.guard[1] < s.limits[1]):
        s.limits[2] = c.rejected - MOST_CUTS  # the next step is none
    run(s.record)


@inner
def _combine(s: Any, weights: Any, n: int, out: Any, h: float) -> None:
    """out = start + h sum weights slopes"""
    copy(s.start, out)
    for i in range(n):
        w = h * weights[i]
        if w != 0.0:
            slope = s.slopes[i]
            for k in range(len(out)):
                out[k] += w * slope[k]


@inner
def _error(s: Any, h: float, rtol: float) -> float:
    """RMS of the error estimate over the tolerances."""
    first = second = 0.0
    for e in range(2):
        total = s.sums[e]
        for k in range(len(total)):
            total[k] = 0.0
        for i in range(len(s.b)):
            w = s.estimate[e, i]
            if w != 0.0:
                slope = s.slopes[i]
                for k in range(len(total)):
                    total[k] += w * slope[k]
    for m in range(len(s.block)):
        low, high = s.block[m, 0], s.block[m, 0] + s.block[m, 1]
        before = after = 0.0
        for k in range(low, high):
            before += s.start[k] * s.start[k]
            after += s.y[k] * s.y[k]
        scale = rtol * (1.0 + math.sqrt(max(before, after))) if s.block[m, 2] == 0 else 0.5 * rtol * s.block[m, 2]
        for k in range(low, high):
            first += (s.sums[0, k] / scale) ** 2
            second += (s.sums[1, k] / scale) ** 2
    if first == 0.0 and second == 0.0:
        return 0.0
    return h * first / math.sqrt((first + 0.01 * second) * len(s.y))


class Marcher:
    """The code of a problem's mechanism at work, from its start; ValueError where none can be made."""

    def __init__(self, problem: Problem, state: np.ndarray) -> None:
        system, tree = problem.system, spanning_tree(problem.system, problem.initial)
        self.code = make_code(system, tree)
        nb, n, tableau = system.nb, len(tree.start), DOPRI853
        self.state = state
        self.kernel = bodies = Bodies(
            np.zeros((nb, 3)), np.zeros((nb, 3, 3)), np.zeros((nb, 6)), np.zeros((nb, 6)), np.zeros(system.nrows),
            np.arange(system.nrows),
        )  # fmt: skip
        t, y, y_dot, after, lam, guard = (np.zeros(k) for k in (1, n, n, n, self.code.rows, 2))
        address = self.code.code.address
        self._programs = [
            Program([(address("accelerate"), [t, y, y_dot])], self.code),
            Program([(address("finish"), [t, y, after, y_dot, lam, guard])], self.code),
            Program([(address("record"), [t, after, y_dot, lam, *bodies[:5]])], self.code),
        ]
        reach = max(float(np.max(np.abs(a), initial=0.0)) for a in (problem.initial.r, system.joint_s_i))
        self.stages = Stages(
            state, t, tableau.a, tableau.b, tableau.c, tableau.error, tree.start.copy(), y, y_dot, after,
            np.zeros((len(tableau.b), n)), np.zeros((2, n)), _blocks(tree), guard,
            np.array([LEAST_PIVOT, OPEN * (reach or 1.0), 0.0]), *(program.entry for program in self._programs),
        )  # fmt: skip
        y[:] = tree.start
        self._entries = Bound(step, self.stages), Bound(finish, self.stages)
        self._entries[1]()
        y[:], self.stages.start[:] = tree.start, tree.start
        self.reaction = bodies.lam.copy()[None]
        self.stretch(0)

    def stretch(self, n: int) -> Record:
        """Up to ``n`` steps from where it stands; ``state`` says why it has ended."""
        nb, nrows = len(self.kernel.r), len(self.kernel.lam)
        record = empty_record(n, nb, nrows)
        bundle = March(self.state, self.kernel, record, UNTOLD, *(e.entry for e in self._entries))  # type: ignore[arg-type]
        Bound(march, bundle)()
        return Record(*(a[: self.state["recorded"]] for a in record))

    def explain(self, outcome: int) -> str:
        """Why the march has ended."""
        if outcome != STUCK:
            return ENDS[outcome][1]
        pivot, gap = self.stages.guard
        return (
            f"the constraints are near a change of rank (least pivot {pivot:.2g} of its start, rows left out open by "
            f"{gap:.2g})"
        )


def _blocks(tree: Tree) -> np.ndarray:
    """(first, size, kind) of the parts of y."""
    out: list[tuple[int, int, int]] = []
    for limb in tree.limbs:
        for at, kind in ((limb.q_at, 2), (tree.nq + limb.u_at, 0)):
            ns, n = len(limb.slides), limb.sizes[0 if kind else 1]
            slides = [(at, ns)] if limb.ball and ns else [(at + k, 1) for k in range(ns)]
            out += [(*x, 0) for x in slides]
            out += [(at + ns, n - ns, kind // 2)] if limb.ball else [(at + k, 1, kind) for k in range(ns, n)]
    return np.array(out, dtype=np.int64).reshape(-1, 3)


METHOD = Method(
    lambda kernel, state: None, step, finish, order=float(DOPRI853.order),
    counters=("evaluations", "rejected", "factorisations"),
)  # fmt: skip


def refusal(problem: Problem) -> str | None:
    """Why no code can be made of a problem, as far as that is known beforehand."""
    if len(problem.system.user_i):
        return "writes out declared forces only, no user forces: use rkmk_dop853"
    operations = least_operations(spanning_tree(problem.system, problem.initial))
    return too_large(operations) if operations > MOST_OPERATIONS else None


def integrate(problem: Problem, control: StepControl) -> Trajectory:
    """March to the end or to a failure, which is a status."""
    began = cpu_seconds()
    state = new_control(
        t_end=problem.t_end, adaptive=True, order=METHOD.order, last_error=1e-4, rtol=control.rtol or 0.0,
        max_step=control.max_step or np.inf, next_step=min(FIRST_STEP, problem.t_end),
    )  # fmt: skip
    try:
        marcher = Marcher(problem, state)
    except ValueError as error:
        return no_trajectory(problem, Status.REFUSED, str(error))
    out = _march(problem, control, METHOD, marcher, cpu_seconds() - began)
    notes = [f"code of {marcher.code.operations} operations an evaluation"]
    if marcher.code.rows:
        notes.append(f"{marcher.code.kept} of {marcher.code.rows} rows of the loops hold, the others depend on them")
    out = dataclasses.replace(out, notes=tuple(notes))
    if state["outcome"] != STUCK:
        return out
    if problem.system.is_timed:  # the kernel's time begins at 0
        return dataclasses.replace(out, status=Status.SINGULAR, message=f"{out.message}: use rkmk_dop853")
    return _hand_over(problem, control, out)


def _hand_over(problem: Problem, control: StepControl, done: Trajectory) -> Trajectory:
    """The rest of the run by the kernel of rkmk_dop853, from the start of the last step on: its end is doubtful."""
    n = max(len(done.t) - 1, 1)
    assert done.reaction is not None
    reaction, states = done.reaction[:n], States(*(getattr(done.states, name)[:n] for name in NAMES))
    done = dataclasses.replace(done, t=done.t[:n], states=states, counters={**done.counters, "steps": n - 1})
    start, steps = float(done.t[-1]), n - 1
    used, why = done.cpu_time + done.setup_time, f"{done.message}; from there on by the kernel of rkmk_dop853"
    limit = None if control.cpu_limit is None else max(control.cpu_limit - used, 1e-3)
    left = dataclasses.replace(control, max_steps=control.max_steps - steps, cpu_limit=limit, spool=None)
    rest = dataclasses.replace(problem, initial=done.states[len(done.t) - 1], t_end=problem.t_end - start)
    out = kernel.integrate(rest, left, explicit_pair(DOPRI853))
    assert out.reaction is not None
    times = np.where(out.t == rest.t_end, problem.t_end, start + out.t)
    return dataclasses.replace(
        out, t=np.concatenate((done.t, times[1:])), notes=(*done.notes, why),
        states=States(*(np.concatenate((getattr(done.states, n), getattr(out.states, n)[1:])) for n in NAMES)),
        counters={name: count + out.counters[name] for name, count in done.counters.items()},
        reaction=np.concatenate((reaction, out.reaction[1:])), cpu_time=done.cpu_time + out.cpu_time,
        setup_time=done.setup_time + out.setup_time,
    )  # fmt: skip
