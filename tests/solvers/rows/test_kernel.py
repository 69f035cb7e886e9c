"""The kernel made from declarations against the judge's equations: rows, loads, accelerations, projections."""

import numpy as np
import pytest

from mbsbench.harness.mechanics import motion
from mbsbench.harness.mechanics.dynamics import accelerations
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.solvers.formulations.compiled.entries import Program
from mbsbench.solvers.formulations.compiled.kernel import Kernel, Made, make_kernel, start_at

from ..arbitrary_joints import all_joints, moving_rows
from ..arbitrary_systems import arbitrary, consistent, linkage

SYSTEMS = {"linkage": linkage(springs=True), "all joints": all_joints(), "moving rows": moving_rows(None)}
each_system = pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
ROUNDING = 1e-12  # relative


def at(system: MultibodySystem, state: State) -> Made:
    made = make_kernel(system)
    start_at(made.kernel, state)
    return made


def call(made: Made, name: str) -> None:
    Program.run(getattr(made.kernel, name))


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


@each_system
def test_rows_and_loads_are_the_judges(system: MultibodySystem) -> None:
    """phi, A, phi_t, gamma, and the applied loads, at an arbitrary state."""
    s = arbitrary(system, 1)
    s = State(s.r, s.R, s.v, s.Omega, 0.4)
    made = at(system, s)
    call(made, "rows")
    k, one = made.kernel, States.one(s)
    A = constraint_jacobian(system, s).toarray()
    assert np.max(np.abs(k.phi[k.order] - motion.constraint(system, one)[0])) < ROUNDING
    assert np.max(np.abs(jacobian(k)[k.order].reshape(A.shape) - A)) < ROUNDING
    v = np.concatenate((s.v, s.Omega), axis=1).ravel()
    assert np.max(np.abs(k.slip[k.order] + A @ v - motion.constraint_rate(system, one)[0])) < 10.0 * ROUNDING
    drift = motion.drift(system, one)[0]
    assert np.max(np.abs(k.gamma[k.order] - drift)) < 1e-8 * np.max(np.abs(drift))
    call(made, "applied")
    load = motion.applied(system, one)[0]
    assert np.max(np.abs(k.force - load)) < ROUNDING * np.max(np.abs(load))


@each_system
def test_accelerations_are_the_judges(system: MultibodySystem) -> None:
    """Index 1 on S against the singular values of A M^-1/2; the judge's A_dot v is a difference, good to 1e-8."""
    s = arbitrary(system, 2)
    made = at(system, s)
    call(made, "accelerate")
    k, judged = made.kernel, accelerations(system, s)
    found = np.concatenate((judged.v_dot, judged.Omega_dot), axis=1)
    assert k.state["rank"] == system.nrows
    assert np.max(np.abs(k.v_dot - found)) < 1e-7 * np.max(np.abs(found))
    assert np.max(np.abs(k.lam[k.order] - judged.reaction)) < 1e-7 * np.max(np.abs(judged.reaction))


@each_system
def test_projection_meets_the_constraints(system: MultibodySystem) -> None:
    """A few passes bring phi and phi_dot to rounding, since each leaves the square of what there was."""
    s = consistent(system, 1)
    made = at(system, State(s.r + 1e-4, s.R, s.v + 1e-4, s.Omega, s.t))
    for _ in range(4):
        call(made, "rows")
        call(made, "factorise")
        call(made, "project")
    k = made.kernel
    now = States.one(State(k.r, k.R, k.v[:, :3], k.v[:, 3:], k.t[0]))
    assert np.max(np.abs(motion.constraint(system, now))) < 1e-13
    assert np.max(np.abs(motion.constraint_rate(system, now))) < 1e-12
