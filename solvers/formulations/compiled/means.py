"""Entries of a kernel for mean-value steps: rows and forces between the poses at the start and at the end (compiled).

``rows`` gives phi at the end, and X, Y and way of the mean rows; ``forces`` gives the mean loads less Omega x J Omega
at the mean velocity.
"""

from typing import Any

import numpy as np

from ....harness.base.generated import Program
from ....harness.mechanics.system import MultibodySystem
from ..rows.kept_code import load_or_make_code, load_row_code
from ..rows.means import BODY
from .bundles import make_bundle
from .kernel import ElementGroup, Kernel, Loops, Step, list_places


def make_means(system: MultibodySystem, k: Kernel) -> Any:
    """Make the bundle of a mean-value step: its length h [s], its start poses, and programs for mean rows and forces.

    ``mean_rows`` and ``mean_forces`` take the poses at the end from the kernel ``k`` and store their results there.
    Raises ValueError for rows without a discrete gradient.
    """
    h, r0, R0 = np.zeros(1), np.zeros((system.nb, 3)), np.zeros((system.nb, 3, 3))
    loops = MeanLoops(system, k)
    loops.start = h, r0, R0
    rows, forces = (Program(steps, (loops, k)) for steps in (loops.rows(), loops.forces()))
    return make_bundle("Means", {}, {}, h=h, r0=r0, R0=R0, mean_rows=rows, mean_forces=forces)


class MeanLoops(Loops):
    """The loops of ``rows`` and ``forces`` for the mean of two poses; ``start`` are h [s], r and R of the start."""

    start: tuple[np.ndarray, np.ndarray, np.ndarray]

    def rows(self) -> list[Step]:
        """Return the steps that compute phi at the end of the step, and X, Y and way of the mean constraint rows."""
        k = self._k
        steps: list[Step] = []
        for group in self._groups:
            code, rows, ends = load_or_make_code("means.make_row_loops", *group.key), group.rows, group.ends
            stored = [k.phi[rows], *(k.X[e, rows] for e in ends), *(k.Y[e, rows] for e in ends)]
            stored += [] if load_row_code(*group.key).way is not None else [k.way[rows]]
            given = [group.members, self.start[0], group.numbers, *self._list_both_ends(group), *stored]
            steps.append((code.address("rows"), given))
            self._keeps.append(code)
        return steps

    def _make_load_steps(self, bodies: str) -> list[Step]:
        """Return the steps that set ``force`` to the mean loads.

        ``bodies`` is "forces" (weight and gyroscopic torque) or "applied" (weight).
        """
        k = self._k
        steps: list[Step] = [self._make_body_step(bodies)]
        for kind, group in self._iterate_force_groups():
            code = load_or_make_code("means.make_load_loops", kind, group.ends == [0])
            given = [group.members, k.t, self.start[0], group.numbers, *self._list_both_ends(group)]
            steps.append((code.address("push"), [*given, *list_places(group, (k.force, 6))]))
            self._keeps.append(code)
        return steps

    def _list_both_ends(self, group: ElementGroup) -> list[np.ndarray]:
        """Return the arrays of ``BODY``, each with the index of each member's body, as arguments of a group's loop."""
        k, (_, r0, R0) = self._k, self.start
        arrays = {"r0": r0, "R0": R0, "r": k.r, "R": k.R, "v": k.v, "J_inv": k.J_inv}
        return list(list_places(group, *((arrays[name], size) for name, size in BODY)))
