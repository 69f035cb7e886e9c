"""ODE-GC's step by the full Newton method (compiled): residual (74), (75), correction (78), (79), tests (80), (81).

With nu = M_bar mu, P = (m r_dot, R J Omega), D nu the spatial wrench of the rows and D_dot nu its rate (B of Eq. 71)::

    (74)  P1 - P0 - (D1 nu1 - D0 nu0) + dt/2 (D_dot0 nu0 + D_dot1 nu1) - dt/2 (w0 + w1) = 0
    (75)  phi_dot1 + [dt/2 ((C_bar phi_dot + K_bar phi)_0 + (...)_1) - sigma0] / M_bar1 = 0

w is the applied wrench plus D G with G = C_bar mu + K_bar lam - f_bar; nu0 = gauge nu1 + nu_start; rotational rows of
(74) are rotated back by R1^T. The linear system is the proximal saddle ``[[J_vv, -D'], [A, (Xi M_bar)^-1]]``: with Xi
infinite it is that of Sect. 4.2; with a finite penalty it is one correction and one augmentation (84), (85) of Sect.
4.3 at once.
"""

import math

import numpy as np

from ..compiled.algebra import clear, copy, evaluate_sine_ratios, multiply, multiply_transposed, turn_rotation
from ..compiled.entries import compile_inline, compile_separately, run
from ..compiled.marching import NOT_FINITE, STUCK
from .choices import AFTER_CORRECTION, CORRECTED
from .gc_step import move_poses

CONVERGED, LOOSE, SLOW, INFINITE, SINGULAR_MATRIX = range(5)
NEAR = 3.0  # decades of the determinant below its largest, where rows that lose rank look like redundant ones
SINKING = -0.05  # decades a step: a determinant that falls so fast may approach zero, and is computed in each step
MOST_PASSES = 6  # passes of the filter of redundant rows; with a penalty of 1e3 each reduces the rest a hundredfold
SMALL_LEAK = 0.1  # share of the tolerance: phi_dot that the next pass of the filter would remove
ENOUGH = 0.25  # an augmentation that leaves more of phi_dot raises xi (Powell; Bertsekas)

TERMS = (  # values of all rows, in the kernel's order; suffix 0: at the start of the step, 1: at its end
    "nu",
    "nu_start",  # nu0 = gauge nu + nu_start
    "lam0",
    "mu0",
    "sigma0",
    "phi0",
    "phi_dot0",
    "f_bar0",
    "c_bar0",
    "k_bar0",
    "phi1",
    "phi_dot1",
    "m_bar",
    "f_bar1",
    "c_bar1",
    "k_bar1",
    "G0",
    "G1",
    "dG",  # dG1/dnu1
    "p",
    "z",  # factors of D1 in (74), of D_dot1
    "stiff",  # -dp/dnu1
    "on_rate",
    "on_phi",  # factors of phi_dot1 and phi1 in (75)
    "nu_kept",  # multiplier of the nested loop
    "left",  # the part of (75) that no velocity can change, see ``leave_redundant``
    "softness",  # (Xi M_bar)^-1
    "off",  # (75) over M_bar
    "old",
    "increment",  # nu of the last step, its change over the step before (0 after a change of the step)
)
ARRAYS = {
    "plan": "3",  # dt/2, B, gauge
    "c": "2 nr 6",  # c_R on both ends, 0 on the ground
    "y": "n",  # a vector like ``lu.x``
    "passed": "nr",  # nu before a pass of the filter of redundant rows
    "T": "nb 9",
    "r0": "nb 3",
    "R0": "nb 3 3",
    "v0": "nb 6",
    "force0": "nb 6",
    "known": "nb 6",  # the part of (74) that the end does not change, in space
    "off": "nb 6",  # residual (74)
    "old_v": "nb 6",  # velocities one step before the present ones
}
PARTS = (  # parts in order of making: each calls those before it
    "complete",
    "evaluate",
    "assemble",
    "begin_step",
    "estimate",
    "refresh",
    "leave_redundant",
    "correct",
    "correct_pose",
    "keep_end",
)


def start(s):
    """Compute the terms of the equations at the start, with its mu."""
    k, g, o = s.kernel, s.scheme, s.terms
    clear(o.nu)
    run(s.complete)
    if g.velocity:  # mu0 = c . M v / M_bar: the velocity along c_R
        run(s.direction)
        for j in range(len(k.body)):
            for a in range(k.row[j], k.row[j + 1]):
                total = 0.0
                for e in range(2):
                    b = k.body[j, e]
                    if b >= 0:
                        c, v, J = s.c[e, a], k.v[b], k.J[b]
                        for q in range(3):
                            total += k.mass[b] * c[q] * v[q]
                            total += c[3 + q] * (J[q, 0] * v[3] + J[q, 1] * v[4] + J[q, 2] * v[5])
                o.mu0[a] = total / o.m_bar[a]
                o.nu_start[a] = total
    run(s.keep_end)


def step(s):
    """Take one step of ``control.h``; a step that fails leaves the kernel at its start.

    ``control.status`` becomes STUCK where it fails, or where a body would turn further than the limit and the step may
    still be cut; NOT_FINITE where the residual is not finite.
    """
    c, g, k = s.control, s.scheme, s.kernel
    g.corrections = c.iterations
    if math.sqrt(_fastest_square(k)) * c.h > g.max_turn and c.level < c.most_cuts:
        c.status = STUCK
    else:
        g.h = c.h
        copy(k.r, s.r0)
        copy(k.R, s.R0)
        copy(k.v, s.v0)
        _attempt(s)
        if g.outcome > LOOSE:
            g.factored = 0.0
            copy(s.r0, k.r)
            copy(s.R0, k.R)
            copy(s.v0, k.v)
            k.t[0] = c.t
            c.status = STUCK if np.isfinite(g.norm) else NOT_FINITE


def finish(s):
    """Accept the end of the step; set ``lam`` to the mean row force of the step, and its diagnostics.

    mu, lam and sigma are carried where the settings say so.
    """
    c, g, k, o = s.control, s.scheme, s.kernel, s.terms
    if g.outcome == LOOSE:
        c.loose_steps += 1
        g.factored = 0.0
        if not g.always_nested:  # a step of the nested loop is loose when it runs out of augmentations, too
            g.max_turn = min(g.max_turn, g.singular_turn)
    if g.factored != 0.0 and g.closes_pose:
        run(s.correct_pose)
    same = g.last == g.h
    for a in range(len(o.nu)):
        nu0 = g.gauge * o.nu[a] + o.nu_start[a]
        k.lam[a] = (o.nu[a] - nu0) / g.h + 0.5 * (o.G0[a] + o.G1[a])
        if g.keep_nu:
            o.increment[a] = o.nu[a] - o.nu_start[a]
            o.nu_start[a] = o.nu[a]
        else:
            o.increment[a] = o.nu[a] - o.old[a] if same else 0.0
        o.old[a] = o.nu[a]
        if g.corrective:
            mu1 = o.nu[a] / o.m_bar[a]
            o.lam0[a] += 0.5 * g.h * (o.mu0[a] + mu1)  # (67)
            o.mu0[a] = mu1
        if g.carry_sigma:
            o.sigma0[a] = o.m_bar[a] * o.phi_dot1[a]  # (62)
    copy(s.v0, s.old_v)
    g.last = g.h
    run(s.keep_end)
    s.diagnostics[0], s.diagnostics[1], s.diagnostics[2], s.diagnostics[3] = (
        c.iterations - g.corrections,
        c.level,
        g.norm,
        g.slip,
    )
    if g.active:
        s.diagnostics[4], s.diagnostics[5] = g.xi, g.log_det


def keep_end(s):
    """Make the end of the step the start of the next one: forces and terms of suffix 1 are copied to suffix 0."""
    o = s.terms
    copy(s.kernel.force, s.force0)
    copy(o.phi1, o.phi0)
    copy(o.phi_dot1, o.phi_dot0)
    copy(o.f_bar1, o.f_bar0)
    copy(o.c_bar1, o.c_bar0)
    copy(o.k_bar1, o.k_bar0)


@compile_inline
def _fastest_square(k):
    """Return the largest |Omega|^2 of all bodies [rad^2/s^2]."""
    square = 0.0
    for b in range(len(k.v)):
        square = max(square, k.v[b, 3] ** 2 + k.v[b, 4] ** 2 + k.v[b, 5] ** 2)
    return square


@compile_separately
def _attempt(s):
    """Try one step from its start to its end, first estimate included; set ``outcome``.

    Augmented Lagrangian: the proximal saddle does Newton's correction and the augmentation at once. Near a singular
    configuration it may not converge, as the violation phi = O(dt^2) makes phi_dot = 0 inconsistent along the direction
    that is being lost. There the step is repeated by the nested loop, with a penalty so low that this direction is left
    to the multiplier carried from earlier steps, and it counts as done at ``accept``.
    """
    g, k = s.scheme, s.kernel
    omega2 = _fastest_square(k)
    run(s.begin_step)
    run(s.estimate)
    if g.xi != g.penalty:  # the last step was a soft one: its factor is not that of this step
        g.factored = 0.0
    g.xi = g.penalty
    nested = g.always_nested
    if not nested:
        g.nested = 0
        _newton(s)
        if g.outcome != CONVERGED and g.active:
            nested = 1
            run(s.estimate)
            g.factored = 0.0
            if omega2 > 0.0:  # above about 0.3 of xi (omega dt)^2 the penalised matrix turns indefinite
                g.xi = min(g.penalty, g.soft / (omega2 * g.h * g.h))
    if nested:
        _nested_loop(s)


@compile_inline
def _nested_loop(s):
    """Run the paper's nested loop: Newton to convergence at a fixed multiplier, then (85), until phi_dot is small.

    Set ``outcome``: LOOSE where the rounds end below ``accept``, SLOW above it.
    """
    g, o, before = s.scheme, s.terms, np.inf
    copy(o.nu, o.nu_kept)
    g.nested = 1
    for _ in range(g.max_augmentations):
        _newton(s)
        if g.outcome != CONVERGED:
            return
        copy(o.nu, o.nu_kept)  # (85): mu - xi psi
        s.control.augmentations += 1
        if g.slip < g.tolerance:
            return
        if g.growth > 1.0 and g.slip > ENOUGH * before:
            g.xi *= g.growth
            g.factored = 0.0
        before = g.slip
    g.outcome = LOOSE if g.slip < g.accept else SLOW


@compile_separately
def _newton(s):
    """Correct the end of the step until the residual is below the tolerance; set ``outcome``.

    A kept factorisation is renewed when it no longer contracts. ``final`` says which iterate is the step's end: the
    first that passes the tests, the same corrected once more by (79), or the first that passes after a correction.
    """
    g, o, before = s.scheme, s.terms, np.inf
    # without sigma (80) implies (81), with C_bar or K_bar (81) cannot hold, and Sect. 4.3 asks (81) after (85)
    both = g.carry_sigma and not g.corrective and not g.nested
    redundant = g.redundant and not g.nested
    clear(o.left)
    g.outcome = SLOW
    least = 1 if g.final == AFTER_CORRECTION else 0
    for iteration in range(g.max_newton + 1):
        run(s.evaluate)
        if not np.isfinite(g.norm):
            g.outcome = INFINITE
            return
        if iteration >= least and g.norm < g.tolerance and (not both or g.slip < g.tolerance):
            if g.final == CORRECTED:
                if g.factored != g.h or g.refresh <= 0.0:
                    run(s.refresh)
                    if s.lu.state.singular:
                        g.outcome = SINGULAR_MATRIX
                        return
                run(s.correct)
                run(s.evaluate)
                if not np.isfinite(g.norm):
                    g.outcome = INFINITE
                    return
            g.outcome = SLOW if redundant and not g.slip < g.accept else CONVERGED
            return
        if iteration == g.max_newton:
            break
        stale = g.factored != g.h or g.refresh <= 0.0 or g.norm > g.refresh * before
        stale = stale or (iteration == 0 and g.fall < SINKING)
        if stale:
            run(s.refresh)
            if s.lu.state.singular:
                g.outcome = SINGULAR_MATRIX
                return
        before = g.norm
        run(s.correct)
    g.factored = 0.0


def begin_step(s):
    """Compute G0, and the part of (74) that the end of the step does not change."""
    g, k, o = s.scheme, s.kernel, s.terms
    half = 0.5 * g.h
    s.plan[0], s.plan[1], s.plan[2] = half, half * g.b_term, g.gauge
    for a in range(len(o.nu)):
        o.G0[a] = -g.use_f_bar * o.f_bar0[a]
        if g.corrective:
            lam_bar = o.lam0[a] - (g.penalty * o.phi0[a] if g.lambda_bar else 0.0)
            o.G0[a] += o.c_bar0[a] * o.mu0[a] + o.k_bar0[a] * lam_bar
    for b in range(len(k.mass)):
        v, f, out = s.v0[b], s.force0[b], s.known[b]
        p = multiply(k.J[b], v[3], v[4], v[5])
        L = multiply(s.R0[b], p[0] + half * f[3], p[1] + half * f[4], p[2] + half * f[5])
        for q in range(3):
            out[q], out[3 + q] = -k.mass[b] * v[q] - half * f[q], -L[q]
    k.t[0] = s.control.t
    run(s.begin)


def estimate(s):
    """Estimate velocities and nu at the end: extrapolated from the last two steps, or those of the start."""
    g, k, o = s.scheme, s.kernel, s.terms
    ratio = g.extrapolate * g.h / g.last if g.last > 0.0 else 0.0
    for b in range(len(k.mass)):
        for q in range(6):
            k.v[b, q] = s.v0[b, q] + ratio * (s.v0[b, q] - s.old_v[b, q])
    for a in range(len(o.nu)):
        if g.keep_nu:
            o.nu[a] = o.nu_start[a] + ratio * o.increment[a]
        else:
            o.nu[a] = ratio * (o.old[a] + ratio * o.increment[a])


def complete(s):
    """Compute the forces and the terms of suffix 1 from the poses and velocities of the kernel."""
    k, g, o = s.kernel, s.scheme, s.terms
    run(k.applied_forces)
    run(s.measure)
    if g.by_forces:
        run(k.spring_slopes)
        run(s.direction)
        for j in range(len(k.body)):
            for a in range(k.row[j], k.row[j + 1]):
                by_rate, by_pose = 0.0, 0.0
                for e in range(2):
                    for i in range(2):
                        pair = s.couple[j, e, i]
                        if pair >= 0:
                            for q in range(6):
                                for p in range(6):
                                    weight = s.c[e, a, q] * s.c[i, a, p]
                                    by_rate -= weight * k.by_rate[pair, q, p]
                                    by_pose -= weight * k.by_pose[pair, q, p]
                # a negative K_bar drives phi away exponentially
                o.c_bar1[a] = by_rate + g.c_bar * o.m_bar[a]
                o.k_bar1[a] = max(by_pose, 0.0) + g.k_bar * o.m_bar[a]
    elif g.corrective:
        for a in range(len(o.nu)):
            o.c_bar1[a] = g.c_bar * o.m_bar[a]
            o.k_bar1[a] = g.k_bar * o.m_bar[a]


def evaluate(s):
    """Compute the residual of the present estimate, and its norms [sqrt(J)].

    (80): sqrt(R_v . M^-1 R_v + R_mu . M_bar R_mu), R_mu being (75) over M_bar; (81): sqrt(phi_dot . M_bar phi_dot).
    """
    g, k, o, half = s.scheme, s.kernel, s.terms, 0.5 * s.scheme.h
    k.t[0] = s.control.t + g.h
    move_poses(s)
    run(s.complete)
    xi, by_lam = (g.penalty, 2.0) if g.lambda_bar else (0.0, 1.0)  # the nested loop has -xi dphi1 = dt/2 dmu1, too
    total, slip = 0.0, 0.0
    for a in range(len(o.nu)):
        m = o.m_bar[a]
        slip += m * o.phi_dot1[a] * o.phi_dot1[a]
        if g.nested:  # (84): mu - xi psi in place of mu
            o.nu[a] = o.nu_kept[a] - g.xi * m * o.phi_dot1[a]
        o.G1[a] = -g.use_f_bar * o.f_bar1[a]
        o.dG[a], o.on_rate[a], o.on_phi[a] = 0.0, 1.0, 0.0
        off = o.phi_dot1[a]
        if g.carry_sigma:
            off -= o.sigma0[a] / m
        if g.corrective:
            mu1 = o.nu[a] / m
            lam1 = o.lam0[a] + half * (o.mu0[a] + mu1)  # (67)
            o.G1[a] += o.c_bar1[a] * mu1 + o.k_bar1[a] * (lam1 - xi * o.phi1[a])
            o.dG[a] = (o.c_bar1[a] + by_lam * half * o.k_bar1[a]) / m
            o.on_rate[a] = 1.0 + half * o.c_bar1[a] / m
            o.on_phi[a] = half * o.k_bar1[a] / m
            before = o.c_bar0[a] * o.phi_dot0[a] + o.k_bar0[a] * o.phi0[a]
            after = o.c_bar1[a] * o.phi_dot1[a] + o.k_bar1[a] * o.phi1[a]
            off += half * (before + after) / m
        o.off[a] = 0.0 if g.nested else off - o.left[a]
        o.p[a] = -o.nu[a] - half * o.G1[a]
        o.z[a] = s.plan[1] * o.nu[a]
        o.stiff[a] = 1.0 + half * o.dG[a]
        total += m * o.off[a] * o.off[a]
    for b in range(len(k.mass)):
        v, f, out, w = k.v[b], k.force[b], s.off[b], s.known[b]
        back, p = multiply_transposed(k.R[b], w[3], w[4], w[5]), multiply(k.J[b], v[3], v[4], v[5])
        for q in range(3):
            out[q] = w[q] + k.mass[b] * v[q] - half * f[q]
            out[3 + q] = back[q] - half * f[3 + q] + p[q]
    run(s.balance)
    for b in range(len(k.mass)):
        out = s.off[b]
        turn = multiply(k.J_inv[b], out[3], out[4], out[5])
        for q in range(3):
            total += out[q] * out[q] / k.mass[b]
            total += out[3 + q] * turn[q]
    g.norm, g.slip = math.sqrt(total), math.sqrt(slip)
    s.control.residuals += 1


def assemble(s):
    """Assemble the matrix of Eq. (79) at the present estimate."""
    k, g, o, half = s.kernel, s.scheme, s.terms, 0.5 * s.scheme.h
    K = s.saddle.bodies
    clear(K)
    for b in range(len(k.mass)):
        _set_differential(
            half * (s.v0[b, 3] + k.v[b, 3]),
            half * (s.v0[b, 4] + k.v[b, 4]),
            half * (s.v0[b, 5] + k.v[b, 5]),
            half,
            s.T[b],
        )
        J, T, v = k.J[b], s.T[b], k.v[b]
        p0, p1, p2 = multiply(J, v[3], v[4], v[5])
        for q in range(3):
            K[b, q, q] = k.mass[b]
            x, y, z = T[q], T[3 + q], T[6 + q]  # d(R J Omega) = R (J dOmega - J Omega x theta)
            K[b, 3, 3 + q] = J[0, q] - (p1 * z - p2 * y)
            K[b, 4, 3 + q] = J[1, q] - (p2 * x - p0 * z)
            K[b, 5, 3 + q] = J[2, q] - (p0 * y - p1 * x)
    run(s.slopes)
    for j in range(len(k.body)):
        n = k.row[j + 1] - k.row[j]
        for a in range(n):
            o.softness[k.row[j] + a] = 1.0 / (g.xi * o.m_bar[k.row[j] + a]) if g.active else 0.0
            s.saddle.joint[j, a * n + a] = o.softness[k.row[j] + a]
    if g.pushed:
        run(k.applied_slopes)
        for p in range(len(k.pair)):
            b = k.pair[p, 1]
            T, f, by_pose, by_rate = s.T[b], k.force[b], k.by_pose[p], k.by_rate[p]
            if b == k.pair[p, 0]:  # turned back after differentiation: R^T d(R torque) = d torque - torque x theta
                by_pose[3, 4] += f[5]
                by_pose[3, 5] -= f[4]
                by_pose[4, 3] -= f[5]
                by_pose[4, 5] += f[3]
                by_pose[5, 3] += f[4]
                by_pose[5, 4] -= f[3]
            for a in range(6):
                x, y, z = by_pose[a, 3], by_pose[a, 4], by_pose[a, 5]
                for q in range(3):
                    K[p, a, q] -= half * (half * by_pose[a, q] + by_rate[a, q])
                    K[p, a, 3 + q] -= half * (x * T[q] + y * T[3 + q] + z * T[6 + q] + by_rate[a, 3 + q])


@compile_inline
def _set_differential(x, y, z, scale, out):
    """Set out (9,) := scale dexp(a), a = (x, y, z), by rows: exp(a + d) = exp(a) exp(dexp d) to first order.

    dexp = 1 - (1 - cos a)/a^2 hat(a) + (a - sin a)/a^3 hat(a)^2; series where a^2 < 1e-2, cut at a^10.
    """
    s = x * x + y * y + z * z
    f, g = evaluate_sine_ratios(s)
    if s < 1e-2:
        h = (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0
    else:
        h = (1.0 - f) / s
    d = 1.0 - h * s
    g, h, d = scale * g, scale * h, scale * d
    out[0], out[1], out[2] = d + h * x * x, h * x * y + g * z, h * x * z - g * y
    out[3], out[4], out[5] = h * x * y - g * z, d + h * y * y, h * y * z + g * x
    out[6], out[7], out[8] = h * x * z + g * y, h * y * z - g * x, d + h * z * z


def refresh(s):
    """Assemble and factorise the matrix of Eq. (79) at the present estimate; ``lu.state.singular`` tells a failure.

    With a penalty, its determinant is monitored.
    """
    g = s.scheme
    run(s.assemble)
    s.control.factorisations += 1
    run(s.factor_saddle)
    g.factored = 0.0 if s.lu.state.singular else g.h
    if g.active and g.xi == g.penalty:  # soft steps weigh the redundant rows differently
        total = _log_determinant(s)
        g.fall = total - g.log_det
        g.log_det = total
        g.highest = max(g.highest, total)


@compile_inline
def _log_determinant(s):
    """Return log10 of the product of the constraint rows' |pivots| times M_bar.

    It is det(A M^-1 D' + (Xi M_bar)^-1) in scaled rows: a constant 1/xi for each redundant row times the squares of the
    singular values, so near a loss of rank it falls by sigma^2 whatever the elimination order.
    """
    total = 0.0
    for a in range(len(s.row_at)):
        total += math.log10(s.lu.pivot[s.row_at[a]] * s.terms.m_bar[a])
    return total


def correct(s):
    """Apply Newton's correction (78) to velocities and nu, with the kept factorisation."""
    g, k, lu, x = s.scheme, s.kernel, s.lu, s.lu.x
    for b in range(len(k.mass)):
        for q in range(6):
            x[lu.body_at[b] + q] = -s.off[b, q]
    for a in range(len(s.row_at)):
        x[s.row_at[a]] = -s.terms.off[a]
    run(s.solve_saddle)
    s.control.solves += 1
    if g.redundant and not g.nested and g.log_det > g.highest - NEAR:
        run(s.leave_redundant)
    for b in range(len(k.mass)):
        for q in range(6):
            k.v[b, q] += x[lu.body_at[b] + q]
    for a in range(len(s.row_at)):
        s.terms.nu[a] += x[s.row_at[a]]
    s.control.iterations += 1


def leave_redundant(s):
    """Remove from a correction the nu of redundant rows, which A^T maps to zero; their residual goes to ``left``.

    Such rows agree on the constraint manifold only: off it, by phi = O(dt^3) within a step, they require velocities
    that do not exist. Each correction would raise their nu by xi phi_dot in vain, and D1 nu = 0 would leave (D0 + D1)
    nu = O(dt) nu, a spurious force that brakes the motion. The saddle itself yields that part: with (Xi M_bar)^-1 dnu
    as the only right side it returns dnu where A^T dnu = 0, and almost nothing elsewhere. How little depends on xi: the
    result is filtered again until this changes phi_dot by less than the tolerance, since otherwise a low penalty would
    leave phi_dot that velocities can remove.
    """
    g, lu, o = s.scheme, s.lu, s.terms
    copy(lu.x, s.y)
    clear(lu.x)
    for a in range(len(s.row_at)):
        lu.x[s.row_at[a]] = s.y[s.row_at[a]]
    for _ in range(MOST_PASSES):
        for a in range(len(s.row_at)):
            s.passed[a] = lu.x[s.row_at[a]]
        clear(lu.x)
        for a in range(len(s.row_at)):
            lu.x[s.row_at[a]] = o.softness[a] * s.passed[a]
        run(s.solve_saddle)
        s.control.solves += 1
        change = 0.0
        for a in range(len(s.row_at)):
            off = o.softness[a] * (lu.x[s.row_at[a]] - s.passed[a])
            change += o.m_bar[a] * off * off
        if math.sqrt(change) < SMALL_LEAK * g.tolerance:
            break
    for a in range(len(s.row_at)):
        o.left[a] -= o.softness[a] * lu.x[s.row_at[a]]
    for a in range(len(lu.x)):
        lu.x[a] = s.y[a] - lu.x[a]


def correct_pose(s):
    """Correct the poses of the end, by the least change that reduces phi to zero to first order.

    It is one correction with the kept factorisation. At a singular configuration phi = O(dt^2) is not harmless: with
    phi along the lost direction the mechanism cannot pass it, and misses by sqrt(phi).
    """
    k, lu = s.kernel, s.lu
    clear(lu.x)
    for a in range(len(s.row_at)):
        lu.x[s.row_at[a]] = -s.terms.phi1[a]
    run(s.solve_saddle)
    for b in range(len(k.mass)):
        x = lu.x[lu.body_at[b] : lu.body_at[b] + 6]
        for q in range(3):
            k.r[b, q] += x[q]
        turn_rotation(k.R[b], x[3], x[4], x[5], k.R[b])
    s.control.solves += 1
    run(s.complete)
