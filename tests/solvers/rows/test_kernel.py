"""The kernel made from declarations against the judge's equations: rows, loads, accelerations, projections."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics import motion, so3
from mbsbench.harness.mechanics.dynamics import accelerations
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.solvers.formulations.compiled.kernel import Kernel, make_kernel, set_state
from mbsbench.solvers.formulations.rows.means import make_row_loops as mean_rows

from ..arbitrary_joints import all_joints, moving_rows
from ..arbitrary_systems import arbitrary, consistent, linkage, rounding_of_rows, settle, with_user_forces

SYSTEMS = {
    "linkage": linkage(springs=True),
    "all joints": all_joints(),
    "moving rows": moving_rows(None),
    "user forces": with_user_forces(),
    "added inertia": make_problem("simple_pendulum", {"support": "link", "yaw": 0.4}).system,
}
each_system = pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
ROUNDING = 1e-12  # relative
STEP, SLOPES = 1e-5, 1e-8  # of central differences; relative to the largest slope


def at(system: MultibodySystem, state: State) -> Kernel:
    k = make_kernel(system)
    set_state(k, state)
    return k


def jacobian(k: Kernel) -> np.ndarray:
    """A (nrows, nb, 6) from X, way and pins."""
    A = np.zeros((len(k.phi), len(k.mass), 6))
    for j, ends in enumerate(k.body):
        rows = slice(k.row[j], k.row[j + 1])
        for e, b in enumerate(ends):
            if b >= 0:
                A[rows, b, :3] += (1 - 2 * e) * k.way[rows]
                A[rows, b, 3:] += k.X[e, rows]
    return A


@pytest.mark.sampled(1)
@each_system
def test_rows_and_loads_are_the_judges(system: MultibodySystem) -> None:
    """phi, A, phi_t, gamma, and the applied loads, at an arbitrary state."""
    s = arbitrary(system, 1)
    s = State(s.r, s.R, s.v, s.Omega, 0.4)
    k = at(system, s)
    k.rows.run()
    one = States.one(s)
    A = constraint_jacobian(system, s).toarray()
    assert np.max(np.abs(k.phi[k.order] - motion.constraint(system, one)[0])) < ROUNDING
    assert np.max(np.abs(jacobian(k)[k.order].reshape(A.shape) - A)) < ROUNDING
    v = np.concatenate((s.v, s.Omega), axis=1).ravel()
    assert np.max(np.abs(k.slip[k.order] + A @ v - motion.constraint_rate(system, one)[0])) < 10.0 * ROUNDING
    drift = motion.evaluate_acceleration_bias(system, one)[0]
    assert np.max(np.abs(k.gamma[k.order] - drift)) < 1e-8 * np.max(np.abs(drift))
    k.applied_forces.run()
    load = motion.applied_loads(system, one)[0]
    assert np.max(np.abs(k.force - load)) < ROUNDING * np.max(np.abs(load))


@each_system
def test_accelerations_are_the_judges(system: MultibodySystem) -> None:
    """Index 1 on S against the singular values of A M^-1/2; the judge's A_dot v is a difference, good to 1e-8.

    Lent inertia changes nothing where velocities are consistent.
    """
    s = consistent(system, 2)
    k = at(system, s)
    k.accelerate.run()
    judged = accelerations(system, s)
    found = np.concatenate((judged.v_dot, judged.Omega_dot), axis=1)
    assert k.state["rank"] == system.nrows
    assert np.max(np.abs(k.v_dot - found)) < 1e-7 * np.max(np.abs(found))
    assert np.max(np.abs(k.lam[k.order] - judged.reaction)) < 1e-7 * np.max(np.abs(judged.reaction))


@each_system
def test_projection_meets_the_constraints(system: MultibodySystem) -> None:
    """A few passes bring phi and phi_dot to rounding, since each leaves the square of what there was."""
    s = consistent(system, 1)
    k = at(system, State(s.r + 1e-4, s.R, s.v + 1e-4, s.Omega, s.t))
    for _ in range(4):
        k.rows.run()
        k.factorise.run()
        k.project.run()
    now = State(k.r, k.R, k.v[:, :3], k.v[:, 3:], k.t[0])
    for rows, rounding in zip((motion.constraint, motion.constraint_rate), rounding_of_rows(now), strict=True):
        assert np.max(np.abs(rows(system, States.one(now)))) < rounding


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(8))
@each_system
def test_a_consistent_start_is_near_and_moves_with_what_it_is_made_from(system: MultibodySystem, seed: int) -> None:
    """By 1e-12 m where that is moved by as much: no rounding, which is less, decides which solution it is."""
    s = arbitrary(system, seed)
    moved = replace(s, r=s.r + 1e-12 * np.random.default_rng(seed).standard_normal(s.r.shape))
    one, other = (settle(system, a) for a in (s, moved))
    assert np.max(np.abs(one.r)) < 10.0
    for name in ("r", "R", "v", "Omega"):
        assert np.max(np.abs(getattr(one, name) - getattr(other, name))) < 1e-9


@each_system
def test_slopes_are_derivatives(system: MultibodySystem) -> None:
    """Of forces, of A^T lam and of phi_dot, by poses and velocities of all bodies, by central differences."""
    s = arbitrary(system, 3)
    k = at(system, State(s.r, s.R, s.v, s.Omega, 0.3))
    k.lam[:] = np.cos(1.0 + np.arange(len(k.lam)))

    def values() -> np.ndarray:
        k.rows.run()
        k.forces.run()
        A = jacobian(k)
        rate = np.einsum("rbc,bc->r", A, k.v) + k.slip
        return np.concatenate((k.force.ravel(), np.einsum("rbc,r->bc", A, k.lam).ravel(), rate))

    k.force_slopes.run()
    force, by_rate = k.by_pose.copy(), k.by_rate.copy()
    k.load_slopes.run()
    k.rate_slopes.run()
    pulls, n = k.by_pose - force, 6 * system.nb
    largest = max(np.max(np.abs(a)) for a in (force, by_rate, pulls, k.rate_slope))
    for b in range(system.nb):
        for c in range(6):
            ahead, behind = (displaced(k, b, c, h, values) for h in (STEP, -STEP))
            found = (ahead - behind) / (2.0 * STEP)
            assert np.max(np.abs(found[:n] - column(k, force, b, c))) < SLOPES * largest
            assert np.max(np.abs(found[n : 2 * n] - column(k, pulls, b, c))) < SLOPES * largest
            rate = sum(k.rate_slope[e, :, c] * (np.repeat(k.body[:, e], np.diff(k.row)) == b) for e in range(2))
            assert np.max(np.abs(found[2 * n :] - rate)) < SLOPES * largest
            v = k.v[b, c]
            k.v[b, c] = v + STEP
            ahead = values()
            k.v[b, c] = v - STEP
            behind = values()
            k.v[b, c] = v
            assert np.max(np.abs((ahead - behind)[:n] / (2.0 * STEP) - column(k, by_rate, b, c))) < SLOPES * largest


def column(k: Kernel, blocks: np.ndarray, b: int, c: int) -> np.ndarray:
    """Slopes of all loads by component ``c`` of body ``b``."""
    out = np.zeros((len(k.mass), 6))
    for (a, moving), block in zip(k.pair, blocks, strict=True):
        if moving == b:
            out[a] = block[:, c]
    return out.ravel()


def displaced(k: Kernel, b: int, c: int, h: float, values: Callable[[], np.ndarray]) -> np.ndarray:
    """``values`` with body ``b`` moved by ``h`` in its c-th direction."""
    r, R = k.r[b].copy(), k.R[b].copy()
    if c < 3:
        k.r[b, c] += h
    else:
        k.R[b] = R @ so3.exp(h * np.eye(3)[c - 3])
    out = values()
    k.r[b], k.R[b] = r, R
    return out


def test_a_row_that_is_not_quadratic_has_no_mean() -> None:
    """The length of a driven link is a root."""
    with pytest.raises(ValueError, match="no mean rows"):
        mean_rows("driven distance", (0,), True)
