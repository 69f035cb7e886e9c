"""Choice of the evaluation of a mechanism: code made for it or, where there is none, the recursion over its bodies."""

from ....harness.mechanics.joint_tree import Tree
from ....harness.mechanics.state import State
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Problem
from ..recursion.evaluation import MOST_ROWS, TreeEvaluation, TreeMechanism, refuse_rows
from ..recursion.phases import TreePhase
from .code import CodeTooLarge, JointCode, make_code
from .counting import build_tree, refuse_code
from .elimination import EliminationOrder
from .evaluation import Evaluation
from .hamilton import HamiltonCode, make_hamilton_code


def choose_code(problem: Problem, tree: Tree) -> JointCode | TreeMechanism:
    """Return code made for the mechanism, in the coordinates of its joints, or the recursion over its bodies.

    The recursion is chosen where code would be too large, and for user forces. Raises ValueError where neither is
    possible.
    """
    if refuse_code(problem) is None:
        try:
            return make_code(problem.system, tree)
        except CodeTooLarge:
            pass
    return TreeMechanism(problem.system, tree)


def choose_phase(
    problem: Problem, tree: Tree, *, radial: bool
) -> tuple[JointCode | TreeMechanism, HamiltonCode | TreePhase]:
    """Return the accelerations and Hamilton's equations of a mechanism: both as code, or both by recursion.

    The choice is that of ``choose_code``. ``radial`` includes the energy and the rows that keep quaternions at length
    one (module ``hamilton``).
    """
    if refuse_code(problem) is None:
        try:
            made = make_code(problem.system, tree, whole=False)
            return made, make_hamilton_code(problem.system, tree, radial=radial)
        except CodeTooLarge:
            pass
    mechanism = TreeMechanism(problem.system, tree)
    return mechanism, TreePhase(mechanism, radial=radial)


def make_evaluation(
    made: JointCode | TreeMechanism, nq: int, chosen: EliminationOrder | None = None
) -> Evaluation | TreeEvaluation:
    """Allocate and return the arrays and programs that evaluate a mechanism; nothing is evaluated yet.

    ``made`` is its code or recursion, ``nq`` the number of coordinates. Rows are eliminated in the order ``chosen``, by
    default that of the start.
    """
    return made.make_evaluation(chosen) if isinstance(made, TreeMechanism) else Evaluation(made, nq, chosen)


def refuse_loop_rows(problem: Problem) -> str | None:
    """Return the refusal of a mechanism that gets no code and has more than ``MOST_ROWS`` loop rows, or None."""
    if refuse_code(problem) is None:
        return None
    rows = count_rows(problem.system, problem.initial)
    return refuse_rows(rows) if rows > MOST_ROWS else None


def count_rows(system: MultibodySystem, start: State) -> int:
    """Return the number of constraint rows of the joints that close the loops of a spanning tree."""
    return sum(int(system.joint_rows[k]) for k in build_tree(system, start).cuts)
