"""What evaluates a mechanism: code made for it or, where that is none, the recursion over its bodies."""

from ....harness.mechanics.state import State
from ....harness.mechanics.system import MultibodySystem
from ....harness.types import Problem
from ..recursion.evaluation import MOST_ROWS, TreeEvaluation, TreeMechanism, too_many_rows
from ..recursion.phases import TreePhase
from .code import JointCode, TooLarge, make_code
from .counting import refuse_code
from .elimination import Order
from .evaluation import Evaluation
from .hamilton import HamiltonCode, make_hamilton_code
from .tree import Tree, spanning_tree


def choose_code(problem: Problem, tree: Tree) -> JointCode | TreeMechanism:
    """Return code of a mechanism; above its limit, and with user forces, the recursion. ValueError: neither."""
    if refuse_code(problem) is None:
        try:
            return make_code(problem.system, tree)
        except TooLarge:
            pass
    return TreeMechanism(problem.system, tree)


def choose_phase(
    problem: Problem, tree: Tree, *, radial: bool
) -> tuple[JointCode | TreeMechanism, HamiltonCode | TreePhase]:
    """Return the same for Hamilton's equations: both parts are code, or neither is."""
    if refuse_code(problem) is None:
        try:
            made = make_code(problem.system, tree, whole=False)
            return made, make_hamilton_code(problem.system, tree, radial=radial)
        except TooLarge:
            pass
    mechanism = TreeMechanism(problem.system, tree)
    return mechanism, TreePhase(mechanism, radial=radial)


def evaluate(made: JointCode | TreeMechanism, nq: int, chosen: Order | None = None) -> Evaluation | TreeEvaluation:
    """Return what evaluates a mechanism, rows in the order ``chosen`` or in that of the start."""
    return made.evaluate(chosen) if isinstance(made, TreeMechanism) else Evaluation(made, nq, chosen)


def refusal(problem: Problem) -> str | None:
    """Refuse mechanisms that are too large for code and have too many rows of loops for the recursion."""
    if refuse_code(problem) is None:
        return None
    rows = count_rows(problem.system, problem.initial)
    return too_many_rows(rows) if rows > MOST_ROWS else None


def count_rows(system: MultibodySystem, start: State) -> int:
    """Return how many rows close the loops of a tree."""
    return sum(int(system.joint_rows[k]) for k in spanning_tree(system, start).cuts)
