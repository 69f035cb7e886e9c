"""Singular passages of a finished run: times at which A nearly lost rank, and the solver's effort there."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ....harness.mechanics.jacobian import compute_singular_values
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.types import Trajectory

DENSE_ROWS = 1000  # singular values need dense algebra: beyond this size passages are not searched for
# Tried with the augmented Lagrangian form on two four-bar cells, a grid, Bricard's and Bennett's linkages, and a
# mechanism with joints declared twice. Twice of DECADES reports 1 of 5 passages of the cells; all else changes none.
DECADES = (
    2.0  # a dip of det(A M^-1 A^T) by less is not taken for a passage: sigma^2 falls by a tenth in 0.1 rad already
)
LOST = 0.02  # smallest singular value, relative to the start's, below which a dip counts as a loss of rank
AROUND = 5  # steps on both sides whose penalty, cuts and corrections are reported; nearer dips are one passage


def find_passages(system: MultibodySystem, run: Trajectory) -> tuple[Mapping[str, Any], ...]:
    """Return one entry for each singular passage of a finished run.

    There is none where passages cannot be searched for: with more than ``DENSE_ROWS`` rows, in less than four times, or
    without determinants. Keys: kind ("singular passage"), t [s], smallest_singular_value there and, over ``AROUND``
    steps on both sides, lowest_penalty, cuts, most_corrections and worst_constraint_norm. Passages are dips of the
    determinant of the factorisations, confirmed by the singular values of A at the dip.
    """
    # plain steps record none
    if system.nrows > DENSE_ROWS or len(run.t) < 4 or "log_determinant" not in run.diagnostics:
        return ()
    from scipy.signal import find_peaks  # imported here, as it adds a third of a second to every start of the program

    depth = -run.diagnostics["log_determinant"][1:]
    dips, _ = find_peaks(depth, prominence=DECADES, distance=AROUND)
    if len(dips) == 0:
        return ()
    at_start = compute_singular_values(system, run.states[0])
    last = int(np.sum(at_start > 1e-9 * at_start[0])) - 1
    found = []
    for k in map(int, dips + 1):
        sigma = float(compute_singular_values(system, run.states[k])[last])
        if sigma > LOST * at_start[last]:
            continue
        near = slice(max(1, k - AROUND), k + AROUND + 1)
        found.append(
            {
                "kind": "singular passage",
                "t": float(run.t[k]),
                "smallest_singular_value": sigma,
                "lowest_penalty": float(np.min(run.diagnostics["penalty"][near])),
                "cuts": int(np.max(run.diagnostics["cut_level"][near])),
                "most_corrections": int(np.max(run.diagnostics["newton_iterations"][near])),
                "worst_constraint_norm": float(np.max(run.diagnostics["constraint_norm"][near])),
            }
        )
    return tuple(found)
