"""Conditions of Newton's matrices, and inertia and damping of Eq. (32), against what is known of them."""

import numpy as np
import pytest
import scipy.linalg as sl

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.judge.referee.claims.equations import make_index3_matrix, make_newton_matrix
from mbsbench.harness.judge.referee.claims.measures import evaluate
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.factories import make_record


@pytest.mark.parametrize("problem", ["spherical_pendulum", "heavy_top"])
def test_newtons_matrix_is_the_saddle_of_mass_and_rows(problem):
    """As dt goes to zero it is [[M, -A^T], [A, 0]], to order dt; the pendulum starts at rest."""
    made = make_problem(problem, {})
    system, s = made.system, made.initial
    A, n = constraint_jacobian(system, s).toarray(), 6 * system.nb
    off = []
    for dt in (1e-3, 1e-4):
        K = make_newton_matrix(system, s, dt)
        assert_close(K[n:, n:], 0.0, atol=1e-6)
        off.append(max(np.max(np.abs(K[:n, n:] + A.T)), np.max(np.abs(K[n:, :n] - A))))
    assert off[0] < 0.1 and off[1] < 0.2 * off[0] + 1e-8


@pytest.mark.parametrize("problem", ["spherical_pendulum", "heavy_top"])
def test_the_condition_of_ode_gc_does_not_depend_on_the_step(problem):
    """To a fifth from 1e-2 to 1e-5 s, where it is that of the saddle [[M, -A^T], [A, 0]]."""
    made = make_problem(problem, {})
    A = constraint_jacobian(made.system, made.initial).toarray()
    M = sl.block_diag(made.system.mass[0] * np.eye(3), made.system.inertia[0])
    size = np.linalg.cond(np.block([[M, -A.T], [A, np.zeros((3, 3))]]))
    found = [
        evaluate("condition", make_record(problem=problem, dt_s=dt), None, {"of": "ODE-GC"})
        for dt in (1e-2, 1e-3, 1e-5)
    ]
    assert max(found) < 1.2 * min(found) and found[2] == pytest.approx(size, rel=1e-3)


def test_the_condition_of_index_3_grows_as_the_step_shrinks():
    """As the inverse of h at least: unscaled, a decade of h costs a decade and more."""
    found = [
        evaluate("condition", make_record(problem="heavy_top", max_step_s=h), None, {"of": "index 3"})
        for h in (1e-3, 1e-4)
    ]
    assert found[1] > 10.0 * found[0]
    made = make_problem("heavy_top", {})
    K = make_index3_matrix(made.system, made.initial, 1e-2)
    assert K.shape == (15, 15) and np.linalg.matrix_rank(K) == 15


def test_gravity_damps_no_row_and_every_row_has_inertia():
    """Forces that do not depend on velocities: C_bar of Eq. (32) is zero; with a damper it is not."""
    for problem in ("spherical_pendulum", "chain", "heavy_top"):
        assert evaluate("eq 32", make_record(problem=problem), None, {"of": "damping"}) == pytest.approx(0.0, abs=1e-9)
        assert evaluate("eq 32", make_record(problem=problem), None, {"of": "inertia"}) > 0.0
    assert evaluate("eq 32", make_record(problem="damped_linkage"), None, {"of": "damping"}) > 1e-9
