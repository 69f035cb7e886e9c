"""Rows and pushes from declarations against the judge's laws, and their slopes against differences of the judge's."""

from collections.abc import Iterator

import casadi as ca
import numpy as np
import pytest

from mbsbench.harness.mechanics import motion, so3
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.joints import DECLARED, KINDS
from mbsbench.harness.mechanics.moving_rows import moving
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import GROUND, MultibodySystem
from mbsbench.solvers.formulations.rows.expressions import (
    force_numbers,
    joint_numbers,
    push_expressions,
    row_expressions,
)

from ..arbitrary_joints import all_joints, moving_rows
from ..arbitrary_systems import arbitrary

SYSTEMS = (all_joints(), moving_rows(None))
ROUNDING = 1e-13  # relative to the largest number: a hundred operations
DIFFERENCES = 1e-7  # central, with steps of 1e-5
STEP = 1e-5
seeds = pytest.mark.parametrize("seed", range(3))


def timed(system: MultibodySystem, seed: int) -> State:
    s = arbitrary(system, seed)
    return State(s.r, s.R, s.v, s.Omega, 0.37 + 0.1 * seed)


def ends(s: State, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses (24,) and velocities (12,) of two bodies."""
    ground = np.concatenate((np.zeros(3), np.eye(3).ravel())), np.zeros(6)
    each = [
        (np.concatenate((s.r[b], s.R[b].ravel())), np.concatenate((s.v[b], s.Omega[b]))) if b != GROUND else ground
        for b in (i, j)
    ]
    return np.concatenate([x for x, _ in each]), np.concatenate([V for _, V in each])


def joints_of(kind: str) -> Iterator[tuple[MultibodySystem, int]]:
    for system in SYSTEMS:
        for k in np.flatnonzero(system.joint_sort == KINDS.index(kind)):
            yield system, int(k)


@seeds
@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_those_of_the_judge(kind: str, seed: int) -> None:
    """phi, phi_dot, A and phi_t agree to rounding; gamma to that of the judge's sixth-order differences."""
    e = row_expressions(kind)
    evaluated = ca.Function("rows", [e.x, e.V, e.t, e.numbers], [e.phi, e.phi_dot, e.A, e.gamma, e.phi_t])
    tested = 0
    for system, k in joints_of(kind):
        s, rows = timed(system, seed), np.arange(system.row_start[k], system.row_start[k + 1])
        i, j = int(system.joint_i[k]), int(system.joint_j[k])
        x, V = ends(s, i, j)
        found = evaluated(x, V, s.t, joint_numbers(system, np.array([k]))[0])
        phi, phi_dot, A, gamma, phi_t = (np.array(a) for a in found)
        assert np.max(np.abs(phi[:, 0] - motion.constraint(system, States.one(s))[0, rows])) < 10.0 * ROUNDING
        assert np.max(np.abs(phi_dot[:, 0] - motion.constraint_rate(system, States.one(s))[0, rows])) < 10.0 * ROUNDING
        full = constraint_jacobian(system, s).toarray()[rows].reshape(len(rows), system.nb, 6)
        for end, b in enumerate((i, j)):
            if b != GROUND:
                assert np.max(np.abs(A[:, 6 * end : 6 * end + 6] - full[:, b])) < 10.0 * ROUNDING
        drift = motion.drift(system, States.one(s))[0, rows]
        assert np.max(np.abs(gamma[:, 0] - drift)) < 1e-8 * max(1.0, np.max(np.abs(drift)))
        push = moving(system, States.one(s))
        own = np.isin(push.row, rows)
        if np.any(own):
            assert np.max(np.abs(phi_t[:, 0] - push.phi_t[0, own])) < 10.0 * ROUNDING
        tested += 1
    assert tested


@seeds
@pytest.mark.parametrize("kind", KINDS)
def test_slopes_of_rows_are_derivatives(kind: str, seed: int) -> None:
    """dW/d(pose) and d(phi_dot)/d(pose) by central differences of the load and of the rates."""
    e = row_expressions(kind)
    inputs = [e.x, e.V, e.t, e.numbers, e.lam]
    value = ca.Function("value", inputs, [ca.vertcat(e.A.T @ e.lam, e.phi_dot)])
    slope = ca.Function("slope", inputs, [ca.vertcat(e.load_slopes, e.rate_slopes)])
    for system, k in joints_of(kind):
        s = timed(system, seed)
        x, V = ends(s, int(system.joint_i[k]), int(system.joint_j[k]))
        rest = V, s.t, joint_numbers(system, np.array([k]))[0], np.cos(1.0 + np.arange(e.lam.numel()))
        exact = np.array(slope(x, *rest))
        for c in range(12):
            ahead, behind = (np.array(value(moved(x, c, h), *rest))[:, 0] for h in (STEP, -STEP))
            assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - exact[:, c])) < DIFFERENCES


def moved(x: np.ndarray, c: int, h: float) -> np.ndarray:
    """A pose moved in its c-th direction."""
    out, (e, part) = x.copy(), divmod(c, 6)
    if part < 3:
        out[12 * e + part] += h
    else:
        R = out[12 * e + 3 : 12 * e + 12].reshape(3, 3)
        out[12 * e + 3 : 12 * e + 12] = (R @ so3.exp(h * np.eye(3)[part - 3])).ravel()
    return out


@seeds
def test_loads_of_forces_are_those_of_the_judge(seed: int) -> None:
    """Springs, torsional springs and loads, summed over the system, with gravity: the judge's applied loads."""
    for system in SYSTEMS:
        s, total = timed(system, seed), np.zeros((system.nb + 1, 6))
        total[:-1, :3] = system.mass[:, None] * system.gravity
        for kind in ("spring", "torsion", "load"):
            e, numbers = push_expressions(kind), force_numbers(system, kind)
            evaluated = ca.Function("load", [e.x, e.V, e.t, e.numbers], [e.load])
            for m, own in enumerate(numbers):
                i = int(getattr(system, f"{kind}_i")[m])
                j = GROUND if kind == "load" else int(getattr(system, f"{kind}_j")[m])
                load = np.array(evaluated(*ends(s, i, j), s.t, own)).reshape(2, 6)
                total[i] += load[0]
                total[j] += load[1]
        judged = motion.applied(system, States.one(s))[0]
        assert np.max(np.abs(total[:-1] - judged)) < ROUNDING * np.max(np.abs(judged))


@seeds
@pytest.mark.parametrize("kind", ["spring", "torsion", "load"])
def test_slopes_of_forces_are_derivatives(kind: str, seed: int) -> None:
    """By poses and by velocities, by central differences of the load."""
    e, system = push_expressions(kind), SYSTEMS[1]
    inputs = [e.x, e.V, e.t, e.numbers]
    value = ca.Function("value", inputs, [e.load])
    slope = ca.Function("slope", inputs, [e.pose_slopes, e.velocity_slopes])
    s = timed(system, seed)
    x, V = ends(s, 0, system.nb - 1)
    rest = s.t, force_numbers(system, kind)[0]
    by_pose, by_velocity = (np.array(a) for a in slope(x, V, *rest))
    for c in range(12):
        ahead, behind = (np.array(value(moved(x, c, h), V, *rest))[:, 0] for h in (STEP, -STEP))
        assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - by_pose[:, c])) < DIFFERENCES * 10
        ahead, behind = (np.array(value(x, V + h * np.eye(12)[c], *rest))[:, 0] for h in (STEP, -STEP))
        assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - by_velocity[:, c])) < DIFFERENCES


def test_every_kind_has_its_number() -> None:
    """Kept files name kinds by number: they are 0, 1, 2, ... without gap."""
    assert [one.number for one in DECLARED.values()] == list(range(len(DECLARED)))
