"""Integrate motions that wind a torsional spring beyond half a turn from rest, in pieces with shifted laws.

A state does not show how often a body has turned, so that the law of a torsional spring holds only within half a turn
of one angle. If a motion leaves that range, its rows before that are right, and the solver continues from the last of
them with the law rewritten about the spring's angle there. A motion that stays within is returned as the solver
returned it, bit for bit.
"""

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ..mechanics.consistency import project
from ..mechanics.state import State, States
from ..mechanics.system import MultibodySystem
from ..mechanics.time_functions import shift_time
from ..mechanics.torsion import count_determined_rows, rewind_springs
from ..mechanics.types import Problem, Status, StepControl, Trajectory

AHEAD = 2.0  # greatest length of a piece relative to the last one, as all beyond the next turn is discarded
PIECES = 10_000  # most pieces of a motion, each a solve with its own start: a spring may turn for ever

Solve = Callable[[Any, Problem, StepControl], Trajectory]


def continue_past_half_turn(solve: Solve) -> Solve:
    """Wrap a method ``solve`` such that it follows torsional springs through any number of turns, and return it.

    The wrapper calls ``solve`` once and, if a spring leaves half a turn, again for each further piece of the motion. A
    method that is wrapped already is returned as it is.
    """
    if getattr(solve, "counts_turns", False):
        return solve

    @functools.wraps(solve)
    def solve_all_pieces(self: Any, problem: Problem, control: StepControl) -> Trajectory:
        """Return the motion of the problem, continued in pieces if a torsional spring leaves half a turn."""
        found = solve(self, problem, control)
        if not isinstance(found, Trajectory):  # reported by the caller
            return found
        right = _count_valid_rows(problem.system, found)
        if right == len(found.t):
            return found
        return _continue_motion(functools.partial(solve, self), problem, control, found, right)

    solve_all_pieces.counts_turns = True  # type: ignore[attr-defined]
    return solve_all_pieces


def _count_valid_rows(system: MultibodySystem, found: Trajectory) -> int:
    """Count the rows, from the start, up to which every torsional spring stays within half a turn from rest.

    All rows count if the motion has a wrong number of bodies, which the caller reports.
    """
    if found.states.nb != system.nb:
        return len(found.t)
    return count_determined_rows(system, np.asarray(found.t, dtype=float), found.states)


def _continue_motion(
    solve: Callable[[Problem, StepControl], Trajectory],
    problem: Problem,
    control: StepControl,
    found: Trajectory,
    right: int,
) -> Trajectory:
    """Return the whole motion, joined from pieces; the first piece is the first ``right`` rows of ``found``.

    Each further piece is solved from the end of the previous one, with the laws of torsional springs rewritten about
    their angles there. A system with user forces has no further piece, since these may depend on time. If no further
    piece can be solved, the motion ends as stalled, or with the status of the last piece.
    """
    parts, t = [_cut_piece(found, right, 0.0)], float(found.t[right - 1])
    costs, system, last, span = [found], problem.system, found.states[right - 1], float(found.t[right - 1])
    status, message = Status.SUCCESS, found.message
    if len(system.user_i):
        words = f"stopped at t = {t:.6g} s: a torsional spring leaves half a turn, and user forces may depend on time"
        return replace(parts[0], status=Status.STALLED, message=words)
    alone = replace(control, spool=None)
    while t < problem.t_end * (1.0 - 1e-12):
        if right < 2 or len(parts) >= PIECES:
            status = Status.STALLED
            message = f"stopped at t = {t:.6g} s: a step turns a torsional spring by more than half a turn"
            break
        system = rewind_springs(system, last)
        span = min(problem.t_end - t, _round_to_steps(AHEAD * span, control.dt))
        start = State(last.r, last.R, last.v, last.Omega)
        here = _begin_at(system, t)
        steps_left = control.max_steps - sum(len(c.t) - 1 for c in costs)
        if steps_left < 1:
            status, message = Status.STALLED, f"stopped at t = {t:.6g} s: its {control.max_steps} steps are used up"
            break
        piece = replace(problem, system=here, initial=project(here, start), t_end=span, reference_from=None)
        more = solve(piece, replace(alone, max_steps=steps_left))
        right = _count_valid_rows(here, more)
        costs.append(more)
        parts.append(_cut_piece(more, right, t))
        t, last, span = t + float(more.t[right - 1]), more.states[right - 1], float(more.t[right - 1])
        if right == len(more.t) and more.status is not Status.SUCCESS:
            status, message = more.status, f"{more.message} (of a piece that ends at t = {t:.6g} s)"
            break
    return _join_pieces(parts, costs, status, message, problem.t_end)


def _round_to_steps(span: float, dt: float | None) -> float:
    """Return ``span`` [s] rounded up to whole steps ``dt`` [s], at least two; unchanged without a fixed step."""
    return span if dt is None else dt * max(2.0, np.ceil(span / dt - 1e-9))


def _begin_at(system: MultibodySystem, t: float) -> MultibodySystem:
    """Return the system with its functions of time shifted, so that its time 0 is the former time ``t`` [s]."""
    return replace(
        system,
        joint_motion=_freeze(shift_time(system.joint_motion, t)),
        load_factor=_freeze(shift_time(system.load_factor, t)),
    )


def _freeze(a: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return a read-only copy of an array."""
    out = np.array(a)
    out.setflags(write=False)
    return out


def _cut_piece(found: Trajectory, rows: int, since: float) -> Trajectory:
    """Return the first ``rows`` rows of a piece that begins at ``since`` [s], with the times of the whole motion."""
    few = slice(0, rows)
    return replace(
        found,
        t=np.asarray(found.t)[few] + since,
        states=found.states.at(few).with_times(found.t[few] + since),
        reaction=None if found.reaction is None else found.reaction[few],
        diagnostics={k: a[few] for k, a in found.diagnostics.items()},
    )


def _join_pieces(
    parts: list[Trajectory], costs: list[Trajectory], status: Status, message: str, t_end: float
) -> Trajectory:
    """Return all pieces as one motion with ``status`` and ``message``; a successful one ends at ``t_end`` [s] exactly.

    ``costs`` are the pieces as solved, with discarded rows: their counters and CPU times are summed.
    """
    rest = [_drop_first_row(part) for part in parts[1:]]
    all_parts = [parts[0], *(part for part in rest if part is not None)]
    t = np.concatenate([part.t for part in all_parts])
    if status is Status.SUCCESS:
        t[-1] = t_end
    states = States(*(np.concatenate([getattr(p.states, k) for p in all_parts]) for k in ("r", "R", "v", "Omega")))
    reactions = [p.reaction for p in all_parts]
    counters = {k: sum(c.counters.get(k, 0) for c in costs) for k in costs[0].counters}
    shared = [k for k in parts[0].diagnostics if all(k in p.diagnostics for p in all_parts)]
    words = f"a torsional spring turns on: integrated in {len(parts)} pieces of at most a turn"
    return replace(
        parts[0],
        t=t,
        states=states.with_times(t),
        status=status,
        message=message,
        counters=counters,
        reaction=None if any(r is None for r in reactions) else np.concatenate([r for r in reactions if r is not None]),
        diagnostics={k: np.concatenate([p.diagnostics[k] for p in all_parts]) for k in shared},
        notes=(*parts[0].notes, words),
        cpu_time=sum(c.cpu_time for c in costs),
        setup_time=sum(c.setup_time for c in costs),
    )


def _drop_first_row(part: Trajectory) -> Trajectory | None:
    """Return a later piece without its start, which is the end of the piece before; None if nothing is left."""
    if len(part.t) < 2:
        return None
    rows = slice(1, None)
    return replace(
        part,
        t=part.t[rows],
        states=part.states.at(rows),
        reaction=None if part.reaction is None else part.reaction[rows],
        diagnostics={k: a[rows] for k, a in part.diagnostics.items()},
    )
