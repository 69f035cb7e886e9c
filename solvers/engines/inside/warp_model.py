"""Read results of MuJoCo Warp, in single precision, as arrays of NumPy."""

from typing import Any

import numpy as np


def read_dynamics(model: Any, data: Any, cuts: int) -> dict[str, np.ndarray]:
    """Return the mass matrix (nv, nv), accelerations without constraints, and the Jacobian (3 cuts, nv) of loops.

    ``cuts`` is the number of points of cut joints; rows of one that MuJoCo leaves out are zero.
    """
    nv = model.nv
    lower = _make_dense(data.M, model.M_rownnz, model.M_rowadr, model.M_colind, nv, nv)
    efc, n = data.efc, int(data.nefc.numpy()[0])
    J = (
        _make_dense(efc.J, efc.J_rownnz, efc.J_rowadr, efc.J_colind, n, nv)
        if model.is_sparse
        else efc.J.numpy()[0][:n, :nv]
    )
    which, rows = efc.id.numpy()[0][:n], np.zeros((cuts, 3, nv))
    for cut in np.unique(which):
        rows[cut] = J[which == cut]  # MuJoCo leaves out a cut whose rows vanish
    return {
        "mass_matrix": lower + np.tril(lower, -1).T,
        "rates": np.array(data.qacc_smooth.numpy()[0], dtype=float),
        "constraints": rows.reshape(-1, nv),
    }


def _make_dense(values: Any, lengths: Any, first: Any, columns: Any, n: int, nv: int) -> np.ndarray:
    """Return the dense matrix (n, nv) of a sparse one whose rows are stored one after the other.

    Row k has ``lengths[k]`` entries from ``first[k]`` on in ``values`` and ``columns``.
    """
    stored, length, at, column = (a.numpy().ravel() for a in (values, lengths, first, columns))
    out = np.zeros((n, nv))
    for k in range(n):
        here = slice(int(at[k]), int(at[k] + length[k]))
        out[k, column[here]] = stored[here]
    return out
