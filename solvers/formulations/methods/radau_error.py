"""The error of a step of Radau, and starts whose distance from the constraints alone is too large an error (compiled).

Hairer and Wanner 1996, Solving Ordinary Differential Equations II, IV.8, Eq. (8.19) without its factor for stiffness.
The stages meet the constraints. Where the start does not, and d is the change that closes it, the estimate has a part
gamma (sum e_i) d = -2.5 d, which no shorter step reduces. ``s`` is the bundle of a step, ``g`` its stages' kernels.
"""

import math

from ..compiled.algebra import clear, copy, find_largest
from ..compiled.entries import compile_inline, run
from .products import add_scaled, displace_poses

GAMMA = 1.0 / (3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0))  # the real eigenvalue of A
# multiple of a gap by which its closing may move a centre: it is 1.5 at most where the iteration's tolerance is to
# blame, and 1.7 to 1e4 before the singular pose of ``n_four_bar``, from where a run that goes on gains energy. At half
# of it the four-bar linkage 100 km away ends at rtol 3e-9, at twice more runs creep on before they end
FARTHEST = 2.0


@compile_inline
def estimate_error(s, h, rtol):
    """Return the step's error relative to its tolerance: an RMS over ``rtol (1 + |y|)``, for angles over ``rtol``.

    The estimate is gamma (h y'_0 + sum e_i (y_i - y_0)) for y = (r, theta, v); ``h`` is the step [s].
    """
    total, start, g = 0.0, s.kernel, s.stages
    for b in range(len(start.v)):
        for a in range(12):
            if a < 6:
                x = h * start.v[b, a]
                for i in range(3):
                    x += s.estimate[i] * s.y[i, b, a]
                size = max(abs(start.r[b, a]), abs(g.r[2, b, a])) if a < 3 else 0.0
            else:
                x = h * start.v_dot[b, a - 6]
                for i in range(3):
                    x += s.estimate[i] * (g.v[i, b, a - 6] - start.v[b, a - 6])
                size = max(abs(start.v[b, a - 6]), abs(g.v[2, b, a - 6]))
            total += (GAMMA * x / (rtol * (1.0 + size))) ** 2
    return math.sqrt(total / (12.0 * len(start.v)))


@compile_inline
def close_start(s):
    """Move the start onto phi = 0 and A v + phi_t = 0 if no step from it passes, however short; return whether it did.

    No step passes where one of length zero, which only closes the joints, has too large an error. Before a singular
    pose, where closing moves centres by more than ``FARTHEST`` gaps, nothing is moved. The factor is that of the step
    just tried; what it leaves, the next rejected step finds again.
    """
    k, g = s.kernel, s.stages
    g.t[1, 0] = s.control.t
    copy(k.r, g.r[1])
    copy(k.R, g.R[1])
    copy(k.v, g.v[1])
    copy(k.v, g.w[1])
    run(g.rows[1])
    run(g.slips[1])
    copy(g.x[1], g.rhs[1])
    near = _find_closing(g)
    for i in range(3):
        copy(k.v, g.v[i])
        for b in range(len(k.v)):
            add_scaled(1.0, g.w[1, b], g.v[i, b])
    clear(g.rhs[1])
    add_scaled(-1.0, g.phi[1], g.rhs[1])
    near = _find_closing(g) and near
    for i in range(3):
        copy(g.w[1], s.y[i])
    hopeless = estimate_error(s, 0.0, s.control.rtol) > 1.0
    if hopeless and near:
        copy(g.v[1], k.v)
        displace_poses(k.r, k.R, g.w[1], k.r, k.R)
    return hopeless and near


@compile_inline
def _find_closing(g):
    """Set w of the second stage to M^-1 A^T S^-1 rhs, which closes the gaps in its ``rhs``.

    Return whether no centre moves by more than ``FARTHEST`` times the largest gap.
    """
    gap, farthest = find_largest(g.rhs[1]), 0.0
    run(g.solve[1])
    copy(g.rhs[1], g.x[1])
    clear(g.w[1])
    run(g.push[1])
    for b in range(g.w.shape[1]):
        for a in range(3):
            farthest = max(farthest, abs(g.w[1, b, a]))
    return farthest <= FARTHEST * gap
