"""Hamilton's equations of a tree by recursion as programs, in place of a ``HamiltonCode``."""

from typing import Any

import numpy as np

from ....harness.base.generated import Program
from ..compiled.entries import BoundFunction
from ..joint_coordinates.spins import find_spins
from .evaluation import TreeEvaluation, TreeMechanism
from .hamilton import Phase, close_phase, enter_phase, factor_phase, find_gaps, find_row_force, find_slopes, solve_phase
from .limbs import bind_sweeps, select_rows

NONE = np.zeros(0)
FUNCTIONS: dict[str, tuple[Any, tuple[str, ...]]] = {  # functions by name, and their arrays
    "stage": (find_slopes, ("t", "q", "p", "q_dot", "p_dot")),
    "gaps": (find_gaps, ("t", "q", "out")),
    "push": (find_row_force, ("t", "q", "lam", "out")),
    "enter": (enter_phase, ("q", "u", "p")),
}


class TreePhase:
    """Hamilton's equations of a mechanism by recursion over its bodies."""

    operations = 0  # none are made

    def __init__(self, made: TreeMechanism, *, radial: bool) -> None:
        """Allocate the arrays; with ``radial``, quaternions get rows |x|^2 = 1, and ``close`` adds free spins."""
        of, tree, limbs = made.mechanism, made.tree, made.mechanism.limbs
        n = len(tree.limbs)
        inertia, soft, spin, axis = limbs.inertia.copy(), np.zeros(n), np.zeros(n), np.zeros((n, 3))
        place = {limb.body: k for k, limb in enumerate(tree.limbs)}
        spins = find_spins(made.system, tree) if radial else []
        for one in spins:
            k = place[one.limb.body]
            e = tree.frames[one.limb.body].T @ one.axis
            inertia[k] += one.added * np.outer(e, e)
            spin[k], axis[k] = 1.0 / one.inertia - 1.0 / (one.inertia + one.added), one.axis
        balls = [k for k, limb in enumerate(tree.limbs) if limb.ball and radial]
        for k in balls:
            about_P = np.trace(inertia[k]) + 2.0 * limbs.mass[k] * float(np.sum(limbs.centre[k] ** 2))
            soft[k] = 0.75 / about_P  # a quaternion of the mean inertia about all axes has 4 I along x
        self.made, self.rows, self.spins = made, made.rows + len(balls), len(spins)
        turning = bind_sweeps(limbs._replace(inertia=inertia))
        self.phase = Phase(
            turning,
            of.closing,
            int(of.applied),
            soft,
            spin,
            axis,
            np.zeros(tree.nu),
            np.zeros(tree.nu),
            *(NONE for _ in range(8)),
        )

    @property
    def words(self) -> str:
        """Note for the trajectory, which says that a recursion evaluates the mechanism."""
        return self.made.words

    def bind(self, name: str, *arrays: np.ndarray) -> Program:
        """Return the program that calls the function ``name`` of ``FUNCTIONS`` with these arrays; nothing is run.

        ``enter`` takes (q, u) as one array, and no inertia added for spins.
        """
        function, names = FUNCTIONS[name]
        phase = self.phase
        if name == "enter":
            arrays = *np.split(arrays[0], [self.made.tree.nq]), *arrays[1:]
            phase = phase._replace(limbs=self.made.mechanism.limbs)  # without the inertia added for spins
        given: dict[str, Any] = dict(zip(names, arrays, strict=True))
        return BoundFunction(function, phase._replace(**given))


class TreeClosing:
    """Closing rows at the end of a step, which project velocities there, and then correct lam of the next step."""

    def __init__(self, evaluation: TreeEvaluation, own: TreePhase) -> None:
        """Select the rows of the order of ``evaluation``; ``kept``: their indices, then those of quaternion lengths."""
        order, made = evaluation.order, own.made
        self._nq, closing = made.tree.nq, select_rows(made.mechanism.closing, evaluation.order.rows, order.pivots)
        self._phase = own.phase._replace(closing=closing)
        self.kept = np.array([*sorted(order.rows), *range(made.rows, own.rows)], dtype=np.int64)

    def factor(self, t: np.ndarray, z: np.ndarray) -> Program:
        """Return the program that factorises H and S at the time ``t`` and the coordinates ``z[0]``."""
        return BoundFunction(factor_phase, self._phase._replace(t=t, q=z[0], p=z[1]))

    def close(self, t: np.ndarray, z: np.ndarray, y: np.ndarray, rows: np.ndarray) -> Program:
        """Return the program that projects velocities onto phi_dot = 0 at the end ``z`` = (q, p) of a step.

        It sets ``y`` = (q, u), and ``rows`` to the multipliers of that projection, impulses of the last node.
        """
        q, u = np.split(y, [self._nq])
        return BoundFunction(close_phase, self._phase._replace(t=t, q=z[0], p=z[1], q_dot=q, u=u, out=rows))

    def solve(self, rows: np.ndarray, solved: np.ndarray) -> Program:
        """Return the program that sets ``solved`` to S^-1 ``rows`` with the last factor of S."""
        return BoundFunction(solve_phase, self._phase._replace(lam=rows, out=solved))
