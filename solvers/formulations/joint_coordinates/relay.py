"""Marches in joint coordinates: what both kinds of steps share, and the change to other pivots where one is stuck."""

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ....harness.base.code_meter import Stopwatch, collect_garbage, making_code
from ....harness.mechanics.joint_tree import Tree
from ....harness.mechanics.types import Problem, Status, StepControl, Trajectory
from ..compiled import host as kernel
from ..compiled.entries import BoundFunction
from ..compiled.host import ENDS, NO_DIAGNOSTICS, Method, _march, list_interpreter_notes
from ..compiled.marching import FULL, STUCK, March, Record, allocate_record, march
from ..recording import no_trajectory
from ..recursion.evaluation import TreeEvaluation, TreeMechanism
from .code import JointCode
from .counting import build_tree
from .elimination import EliminationOrder
from .evaluation import Evaluation
from .pivots import LostRank

# Half and twice of both change no bit of gauss_joint and dop853_joint on Bricard's, Bennett's and a planar linkage, and
# on two four-bar cells.
FAIR = 0.03  # ratio of the least pivot to that at the start: above it an earlier order continues
OPEN = 1e-6  # gap of rows that were left out, as a share of the mechanism's size
ROOM, MOST_AT_ONCE = 1_000_000, 1000  # bytes and steps that are recorded before Python takes them over


class Bodies(NamedTuple):
    """The record of an accepted step; its names are those of a kernel."""

    r: Any  # (nb, 3)
    R: Any  # (nb, 3, 3)
    v: Any  # (nb, 6)
    v_dot: Any  # (nb, 6)
    lam: Any  # (nrows,) reactions
    order: Any  # (nrows,)


class JointMarcher(ABC):
    """A march in a mechanism's joint coordinates; ValueError where neither code nor recursion is possible."""

    tree: Tree
    code: JointCode | TreeMechanism
    evaluation: Evaluation | TreeEvaluation
    stages: Any  # bundle of a step; ``guard`` has its least pivot, and the largest gap of rows left out
    reaction: np.ndarray  # (1, nrows) at the start
    _entries: tuple[BoundFunction, BoundFunction]
    _room: tuple[Record, BoundFunction] | None = None

    def __init__(self, problem: Problem, state: np.ndarray, before: "JointMarcher | None") -> None:
        """Allocate the record of a step for ``problem``; take the tree of the marcher ``before``, if there is one.

        ``state`` is the control of the compiled march, shared by all marchers of a run.
        """
        system, nb = problem.system, problem.system.nb
        self.problem, self.state = problem, state
        self.tree = before.tree if before else build_tree(system, problem.initial)
        self.kernel = Bodies(
            np.zeros((nb, 3)),
            np.zeros((nb, 3, 3)),
            np.zeros((nb, 6)),
            np.zeros((nb, 6)),
            np.zeros(system.nrows),
            np.arange(system.nrows),
        )
        self.reach = max(float(np.max(np.abs(a), initial=0.0)) for a in (problem.initial.r, system.joint_s_i))

    def stretch(self, n: int) -> Record:
        """March up to ``n`` steps, or as many as the record has room for; return the record of those accepted.

        ``state["outcome"]`` says why the march ended. Only a record that is full is a copy; the memory of others is
        used again by the next call.
        """
        if self._room is None:
            bytes_of_a_step = 8 * (1 + 18 * len(self.kernel.r) + len(self.kernel.lam))
            self._room = self._make_record(min(1 + ROOM // bytes_of_a_step, MOST_AT_ONCE))
        record, march_on = self._room if n >= len(self._room[0].t) else self._make_record(n)
        march_on()
        taken = Record(*(a[: self.state["recorded"]] for a in record))
        return Record(*(a.copy() for a in taken)) if self.state["outcome"] == FULL else taken

    def _make_record(self, n: int) -> tuple[Record, BoundFunction]:
        """Allocate a record of ``n`` steps; return it and the compiled march that fills it."""
        record = allocate_record(n, len(self.kernel.r), len(self.kernel.lam))
        for a in record:
            a.fill(0.0)  # the system provides pages as they are touched
        bundle = March(self.state, self.kernel, record, NO_DIAGNOSTICS, *self._entries)  # type: ignore[arg-type]
        return record, BoundFunction(march, bundle)

    @property
    @abstractmethod
    def present_state(self) -> np.ndarray:
        """Coordinates and velocities y at the end of the last step."""

    @property
    def has_poor_pivots(self) -> bool:
        """Flag of pivots with which a march that is stuck cannot continue."""
        return True

    @abstractmethod
    def restart(self, order: EliminationOrder | None) -> "JointMarcher":
        """Return a marcher at the present state with this order of elimination; None stands for that of the start."""

    @abstractmethod
    def continue_without_pivots(self) -> "tuple[kernel.Marcher, str] | None":
        """Continue where no order has safe pivots: return a march by the kernel and a note, or change this marcher.

        None in the second case. If neither is possible, ``state["outcome"]`` stays as it is and the march ends.
        """

    def explain(self, outcome: int) -> str:
        """Return the message for an ``outcome`` of the march; where it is stuck, with the least pivot and the gap."""
        if outcome != STUCK:
            return ENDS[outcome][1]
        pivot, gap = self.stages.guard
        return (
            f"the constraints are near a change of rank (least pivot {pivot:.2g} of its start, rows left out open by "
            f"{gap:.2g})"
        )

    @property
    def notes(self) -> list[str]:
        """Notes on the evaluation of the mechanism and on its loops."""
        n, used = self.code.rows, self.code.rows_in_use
        return [
            self.code.words,
            *([f"{used} of {n} rows of the loops hold, the others depend on them"] if n else []),
        ]

    @property
    def counters(self) -> dict[str, int]:
        """Counts of the march beside those of its method."""
        return {}


class Relay:
    """A march in joint coordinates; where it is stuck, other pivots continue, or what its marcher has instead."""

    def __init__(self, marcher: JointMarcher) -> None:
        """Begin with ``marcher``, in the order of elimination of the start."""
        self.state, self.kernel, self.reaction = marcher.state, marcher.kernel, marcher.reaction
        self.changes, self._notes = list[float](), list[str]()
        self.runner, self._orders = marcher, list[EliminationOrder | None]([None])
        self._fallback: kernel.Marcher | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the times at which pivots were chosen anew, and on a change to the kernel."""
        times = ", ".join(f"{t:g}" for t in self.changes[:3]) + (", ..." if len(self.changes) > 3 else "")
        return (*([f"pivots chosen anew at t = {times} s"] if self.changes else []), *self._notes)

    def stretch(self, n: int) -> Record:
        """March up to ``n`` steps and return their record, with reactions in the system's order of rows.

        Where the march is stuck, change to another order of elimination, or else as the marcher itself provides.
        """
        if self._fallback:
            record: Record = self._fallback.stretch(n)
            return record._replace(lam=record.lam[:, self._fallback.kernel.order])
        record = self.runner.stretch(n)
        if self.state["outcome"] == STUCK:
            record = Record(*(a.copy() for a in record))  # its memory may be reused
            with making_code:
                if not self._choose_pivots():
                    self.state["outcome"] = STUCK  # the marchers tried have changed it
                    if instead := self.runner.continue_without_pivots():
                        self._fallback, note = instead
                        self._notes.append(note)
            collect_garbage()
        return record

    def _choose_pivots(self) -> bool:
        """Change to an order of elimination whose pivots are safe at the present state; return whether this was done.

        An earlier order is preferred. Nothing is changed where pivots are not poor, or at the time of the last change.
        """
        t = float(self.state["t"])
        if not self.runner.has_poor_pivots or (self.changes and not t > self.changes[-1]):
            return False
        for order in self._orders:
            other = self.runner.restart(order)
            if other.stages.guard[0] > FAIR:  # its least pivot is safe here
                break
        else:
            before = self.runner
            try:
                order = before.evaluation.find_order(t, before.present_state, before.tree.start)
            except LostRank:
                return False
            other = self.runner.restart(order)
            self._orders.append(order)
        self.runner = other
        self.changes.append(t)
        return True

    def explain(self, outcome: int) -> str:
        """Return the message for an ``outcome`` of the march, preceded by the notes on changes."""
        return "; ".join([*self.notes, (self._fallback or self.runner).explain(outcome)])


def integrate_by_relay(
    problem: Problem, control: StepControl, method: Method, make_marcher: Callable[[], JointMarcher]
) -> Trajectory:
    """Integrate to the end, a limit or a failure by the marcher of ``make_marcher``; return the trajectory.

    Its status is a refusal if ``make_marcher`` raises ValueError. Notes and counters are those of marcher and relay.
    """
    watch = Stopwatch()
    try:
        marcher = make_marcher()
    except ValueError as error:
        return no_trajectory(problem, Status.REFUSED, str(error))
    relay = Relay(marcher)
    out = _march(problem, control, method, relay, watch)
    counters = {**out.counters, **relay.runner.counters}
    return dataclasses.replace(out, notes=(*marcher.notes, *relay.notes, *list_interpreter_notes()), counters=counters)
