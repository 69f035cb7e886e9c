"""ODE-GC: the three-field weak form with geometrically consistent steps, Natsiavas, Passas, Paraskevopoulos (2022).

Sect. 4.2, Eqs. (61) to (81), and the loop of Sect. 4.3, Eqs. (84), (85). A step goes from node m (suffix 0) to m + 1
(suffix 1)::

    (66)  q1 = q0 o exp(dt/2 (v0 + v1))                autoparallels of SO(3): rotations about a fixed axis
    (67)  lam1 = lam0 + dt/2 (mu0 + mu1)
    (74)  [A (p - A^T M_bar mu)]_0^1 - dt/2 (A0 L0 + A1 L1) = 0
    (71)  L = f + A^T (C_bar mu + K_bar lam - f_bar) - B^T M_bar mu
    (75)  [M_bar phi_dot]_0^1 + dt/2 ((C_bar phi_dot + K_bar phi)_0 + (...)_1) = 0

with the operator script-A (body to space) contained in D = script-A A^T, D_dot = script-A B^T. Unknowns are v1 and nu1
= M_bar mu1. Options are the choices that the paper leaves open: c_R of (31), mu0, the first estimate of a step, the
iterate that ends it, the tolerance. Two more replace what is printed, where mu and sigma are carried from step to step:
with C_bar = K_bar = 0 only increments of mu act, so that a step may begin at mu = 0 (gauge zero), or at minus the mu of
its end (gauge symmetric, which makes it reversible); and sigma may begin at 0, which requires phi_dot = 0 at the end.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.mechanics import so3
from ...harness.mechanics.types import Problem, StepControl, Trajectory
from .march import Grid, march
from .mechanics import Mechanism, Rows

DIFFERENCE = 1e-7  # change of the unknowns in Jacobians by differences
ENOUGH = 0.25  # share of phi_dot: an augmentation that leaves more raises the penalty


class Node(NamedTuple):
    """All quantities at one end of a step."""

    t: float
    r: Float[np.ndarray, "nb 3"]
    R: Float[np.ndarray, "nb 3 3"]
    v: Float[np.ndarray, "nb 6"]
    rows: Rows
    p: Float[np.ndarray, " n"]  # script-A p, in space; pi of Eq. (61) is p - D nu
    f: Float[np.ndarray, " n"]  # script-A f, in space
    M_bar: Float[np.ndarray, " nr"]
    f_bar: Float[np.ndarray, " nr"]
    C_bar: Float[np.ndarray, " nr"]
    K_bar: Float[np.ndarray, " nr"]


class CarriedState(NamedTuple):
    """Quantities that a step passes on to the next one, in addition to its node."""

    nu: Float[np.ndarray, " nr"]  # nu at the end where it is carried on, else 0
    mu: Float[np.ndarray, " nr"]
    lam: Float[np.ndarray, " nr"]
    sigma: Float[np.ndarray, " nr"]
    v_old: Float[np.ndarray, "nb 6"]  # v at the node before, for the first estimate
    nu_old: Float[np.ndarray, " nr"]  # nu of the last step, and its change
    nu_change: Float[np.ndarray, " nr"]
    dt: float  # size of the last step; 0 before the first


class Estimate(NamedTuple):
    """Quantities that follow from an estimate of the unknowns v1 and nu1."""

    node: Node  # m + 1
    nu: Float[np.ndarray, " nr"]
    mu: Float[np.ndarray, " nr"]
    lam: Float[np.ndarray, " nr"]
    reaction: Float[np.ndarray, " nr"]  # mean force of the rows over the step
    R_v: Float[np.ndarray, " n"]  # residual of (74), in the frames of the bodies
    R_mu: Float[np.ndarray, " nr"]  # residual of (75)


class Step:
    """The step for one problem.

    ``choices`` are the options of ``solvers.gc_weak_form`` or ``solvers.gc_augmented_lagrangian``; ``settings`` are
    the ``Settings`` that follow from them. Read here are ``keep_nu`` and ``carry_sigma``: mu and sigma are carried on
    (as printed); ``gauge``: -1 symmetric, else 0; ``corrective``: C_bar or K_bar is not zero; ``by_forces``: by Eq.
    (32); ``active``: Sect. 4.3; ``tolerance`` of (80), (81); ``accept``: norm (81) at which a step is accepted where
    the loop of Sect. 4.3 reaches its limit of rounds [sqrt(J)].
    """

    def __init__(self, problem: Problem, choices: Any, settings: Any) -> None:
        self.mechanism, self.choices, self.settings = Mechanism(problem.system), choices, settings
        self.xi = 0.0  # xi of Eq. (84), in Sect. 4.3
        self.counters = {"newton_iterations": 0, "residuals": 0, "augmentations": 0}

    def start(self, problem: Problem) -> tuple[Node, CarriedState, np.ndarray]:
        """Return the first node, the state carried to the first step, and NaN: reactions are means over steps."""
        state, m = problem.initial, self.mechanism
        node = self.make_node(state.t, state.r, state.R, np.concatenate((state.v, state.Omega), axis=1))
        mu, none = np.zeros(m.nr), np.zeros(m.nr)
        if self.choices.mu0 == "velocity":  # mu0 = c . M v / M_bar: the velocity along c_R
            c = self.directions(node.rows)
            mu = c @ m.turn_to_bodies(node.R, node.p) / node.M_bar
        return node, CarriedState(node.M_bar * mu, mu, none, none, node.v, none, none, 0.0), np.full(m.nr, np.nan)

    def make_node(self, t: float, r: np.ndarray, R: np.ndarray, v: np.ndarray) -> Node:
        """Return the node at a time and state: constraint rows, momenta, loads and the coefficients (30) to (32)."""
        m, choices = self.mechanism, self.choices
        rows, f = m.rows(t, r, R, v), m.loads(t, r, R, v).ravel()
        c = self.directions(rows)
        M_bar = np.array([np.sum(one * m.multiply_by_inertia(one)) for one in c])  # (30)
        f_bar = c @ m.turn_to_bodies(R, f) if choices.f_bar else np.zeros(m.nr)  # (30)
        C_bar, K_bar = choices.c_bar * M_bar, choices.k_bar * M_bar
        if self.settings.by_forces:
            by_rate, by_pose = m.spring_slopes(r, R, v, c)
            C_bar, K_bar = C_bar - by_rate, K_bar + np.maximum(-by_pose, 0.0)  # (32); K_bar < 0 would drive phi away
        return Node(t, r, R, v, rows, m.momentum(R, v), f, M_bar, f_bar, C_bar, K_bar)

    def directions(self, rows: Rows) -> Float[np.ndarray, "nr n"]:
        """Return c_R of Eq. (31), a . c = 1, in the velocities of the bodies."""
        m, a = self.mechanism, rows.A
        if self.choices.direction == "translation":  # (e_k, 0) of body i, of spherical joints
            c = np.zeros_like(a)
            for row, joint in enumerate(np.repeat(np.arange(m.system.nj), np.diff(m.system.row_start))):
                at = slice(6 * m.system.joint_i[joint], 6 * m.system.joint_i[joint] + 3)
                c[row, at] = a[row, at]
            return c
        by_mass = self.choices.direction == "mass"
        along = np.array([m.divide_by_inertia(one) for one in a]).reshape(a.shape) if by_mass else a
        return along / np.sum(a * along, axis=1)[:, None]

    def residual(
        self, dt: float, a: Node, old: CarriedState, v1: np.ndarray, nu1: np.ndarray, kept: Any = None
    ) -> Estimate:
        """Return the ``Estimate`` of v1 and nu1: node m + 1, and the residuals of (74) and (75) there.

        With the fixed multiplier ``kept`` of Sect. 4.3, nu1 follows from v1 by (84) instead, and (75) is left to (85).
        """
        half, m = 0.5 * dt, self.mechanism
        r1 = a.r + half * (a.v[:, :3] + v1[:, :3])  # (66)
        R1 = a.R @ so3.exp(half * (a.v[:, 3:] + v1[:, 3:]))
        b = self.make_node(a.t + dt, r1, R1, v1)
        if kept is not None:
            nu1 = kept - self.xi * b.M_bar * b.rows.phi_dot  # (84): mu - xi psi
        mu1 = nu1 / b.M_bar
        lam1 = old.lam + half * (old.mu + mu1)  # (67)
        nu0 = self.settings.gauge * nu1 + old.nu  # carried on; 0; or - nu1
        xi = self.xi if kept is not None and self.choices.lambda_bar else 0.0
        B = float(self.choices.b_term)
        G0 = a.C_bar * old.mu + a.K_bar * (old.lam - xi * a.rows.phi) - a.f_bar  # (84): lam - xi phi
        G1 = b.C_bar * mu1 + b.K_bar * (lam1 - xi * b.rows.phi) - b.f_bar
        L0 = a.f + a.rows.D @ G0 - B * a.rows.D_dot @ nu0  # (71)
        L1 = b.f + b.rows.D @ G1 - B * b.rows.D_dot @ nu1
        R_v = (b.p - b.rows.D @ nu1) - (a.p - a.rows.D @ nu0) - half * (L0 + L1)  # (74)
        sigma1 = b.M_bar * b.rows.phi_dot  # (62)
        sigma0 = old.sigma if self.settings.carry_sigma else np.zeros(m.nr)
        before, after = (x.C_bar * x.rows.phi_dot + x.K_bar * x.rows.phi for x in (a, b))  # (73)
        R_mu = sigma1 - sigma0 + half * (before + after)  # (75)
        self.counters["residuals"] += 1
        return Estimate(b, nu1, mu1, lam1, (nu1 - nu0) / dt + 0.5 * (G0 + G1), m.turn_to_bodies(R1, R_v), R_mu)

    def measure_residual(self, x: Estimate) -> float:
        """Return the norm of an estimate's residual, Eq. (80) [sqrt(J)]; in Sect. 4.3 it does not include (75)."""
        by_rows = 0.0 if self.settings.active else np.sum(x.R_mu**2 / x.node.M_bar)
        return float(np.sqrt(x.R_v @ self.mechanism.divide_by_inertia(x.R_v) + by_rows))

    def measure_slip(self, x: Estimate) -> float:
        """Return the norm of phi_dot of an estimate, Eq. (81) [sqrt(J)]."""
        return float(np.sqrt(np.sum(x.node.M_bar * x.node.rows.phi_dot**2)))

    def newton(
        self, dt: float, a: Node, old: CarriedState, v1: np.ndarray, nu1: np.ndarray, kept: Any = None
    ) -> Estimate | None:
        """Return the end of a step, by Newton's method (76) to (81) from (v1, nu1), or None where it does not converge.

        With ``kept`` the multiplier is fixed, as in Sect. 4.3.
        """
        n, x = v1.size, np.concatenate((v1.ravel(), nu1 if kept is None else []))

        def eta(x: np.ndarray) -> Estimate:  # (76), of the unknowns (77)
            return self.residual(dt, a, old, x[:n].reshape(-1, 6), x[n:], kept)

        def whole(y: Estimate) -> np.ndarray:
            """Return the residual vector of an estimate: (74), and (75) over M_bar unless the multiplier is fixed."""
            return y.R_v if kept is not None else np.concatenate((y.R_v, y.R_mu / y.node.M_bar))

        # (80) implies (81) where sigma is not carried, and with C_bar or K_bar (81) cannot hold
        asks_slip = self.settings.carry_sigma and not self.settings.corrective and kept is None
        final = self.choices.final_iterate
        for iteration in range(self.choices.max_newton + 1):
            found = eta(x)
            if not np.all(np.isfinite(found.R_v)):
                return None
            passes = self.measure_residual(found) < self.settings.tolerance
            passes = passes and (not asks_slip or self.measure_slip(found) < self.settings.tolerance)
            if passes and final != "corrected" and iteration >= (final == "after_correction"):
                return found
            if iteration == self.choices.max_newton and not passes:
                return None
            R = whole(found)
            J = np.array([whole(eta(x + d)) - R for d in DIFFERENCE * np.eye(len(x))]).T / DIFFERENCE
            try:
                x = x - np.linalg.solve(J, R)  # (78), (79)
            except np.linalg.LinAlgError:
                return None
            self.counters["newton_iterations"] += 1
            if passes:
                return eta(x)
        return None

    def augment(self, dt: float, a: Node, old: CarriedState, v1: np.ndarray, nu1: np.ndarray) -> Estimate | None:
        """Return the end of a step by the loop of Sect. 4.3, or None where it does not converge.

        Newton's method at fixed multipliers and the update (85) alternate until (81) holds; after the last round the
        norm (81) has to be below ``accept``. ``xi`` is set to the penalty, and grows with it.
        """
        kept, before, found = nu1, np.inf, None
        self.xi = self.choices.penalty
        for _ in range(self.choices.max_augmentations):
            found = self.newton(dt, a, old, v1, nu1, kept)
            if found is None:
                return None
            kept, v1 = found.nu, found.node.v  # (85): mu - xi psi is the next multiplier
            self.counters["augmentations"] += 1
            if self.measure_slip(found) < self.settings.tolerance:
                return found
            if self.measure_slip(found) > ENOUGH * before:
                self.xi *= self.choices.penalty_growth
            before = self.measure_slip(found)
        return found if before < self.settings.accept else None

    def __call__(self, dt: float, a: Node, old: CarriedState) -> tuple[Node, CarriedState, np.ndarray] | None:
        """Step from node ``a`` over ``dt`` [s]; return the end node, the state to carry on, and the mean reaction.

        Return None where the iteration does not converge, so that the step has to be halved.
        """
        ratio = dt / old.dt if self.choices.estimate == "extrapolated" and old.dt > 0.0 else 0.0
        v1 = a.v + ratio * (a.v - old.v_old)
        if self.settings.keep_nu:
            nu1 = old.nu + ratio * old.nu_change
        else:
            nu1 = ratio * (old.nu_old + ratio * old.nu_change)
        found = (self.augment if self.settings.active else self.newton)(dt, a, old, v1, nu1)
        if found is None:
            return None
        b, nu1, same = found.node, found.nu, old.dt == dt
        change = nu1 - old.nu if self.settings.keep_nu else (nu1 - old.nu_old if same else np.zeros_like(nu1))
        nu = nu1 if self.settings.keep_nu else np.zeros_like(nu1)
        sigma1 = b.M_bar * b.rows.phi_dot  # (62)
        mu, lam = (found.mu, found.lam) if self.settings.corrective else (old.mu, old.lam)
        return b, CarriedState(nu, mu, lam, sigma1, a.v, nu1, change, dt), found.reaction


def integrate(problem: Problem, control: StepControl, choices: Any, settings: Any) -> Trajectory:
    """Integrate by ODE-GC from the start to ``t_end``, and return the trajectory; reactions are means over steps."""
    grid = Grid(problem.t_end, float(control.dt or 0.0), choices.max_cuts)
    return march(problem, control, Step(problem, choices, settings), grid)
