"""ODE-GC's full Newton step against other routes: mechanics in NumPy, central differences, dense linear algebra."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.mechanics.motion import evaluate_scaling_masses
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.system import GROUND, Joint, MultibodySystem, RigidBody, TorsionSpring, assemble
from mbsbench.harness.mechanics.user_forces import UserForce
from mbsbench.problems.random_mechanism import draw_body
from mbsbench.solvers.formulations.compiled.entries import Program
from mbsbench.solvers.formulations.compiled.kernel import make_kernel, set_state
from mbsbench.solvers.formulations.compiled.marching import make_control
from mbsbench.solvers.formulations.methods.choices import Settings
from mbsbench.solvers.formulations.methods.gc_newton import NEEDED, make_step
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.covering import diagonal

from ..arbitrary_joints import LOADS, MOVING, SPRING, all_joints, moving_row
from ..arbitrary_systems import arbitrary, law, linkage

DT = 0.05


def all_moving() -> MultibodySystem:
    """A row of bodies with moving rows of each kind between two neighbours, torsional springs and user forces."""
    random, nb = np.random.default_rng(7), len(MOVING)
    pins = [moving_row(kind, k, k - 1, random) for k, kind in enumerate(MOVING)]
    twist = [
        TorsionSpring(0, (0.3, -0.5, 0.8), GROUND, stiffness=3.0, rest_angle=0.4, damping=0.2),
        TorsionSpring(2, (0.3, 0.5, 0.8), 1, stiffness=2.0, rest_angle=0.1, damping=0.3),
    ]
    bodies = [draw_body(random) for _ in range(nb)]
    return assemble(bodies, pins, (1.1, -2.3, -9.5), [SPRING], LOADS, twist, [UserForce(law, 2, 0), UserForce(law, 1)])


SYSTEMS = {
    "pins": linkage(springs=False),
    "springs": linkage(springs=True),
    "all joints": all_joints(),
    "all moving rows": all_moving(),
}
each_system = pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
alive = []


def arbitrary_step(system: MultibodySystem, direction: int = 0, **choices: float) -> Any:
    """A step from an arbitrary state, with an arbitrary estimate of its end."""
    random = np.random.default_rng(3)
    k = make_kernel(system, NEEDED)
    alive.append(k)
    control = make_control(h=DT, dt=DT, t_end=1.0)
    s = make_step(k, control, system=system, settings=Settings(direction=direction, **choices))
    set_state(k, arbitrary(system, 5))
    Program.run(s.complete)
    Program.run(s.keep_end)
    s.r0[:], s.R0[:], s.v0[:] = k.r, k.R, k.v
    s.terms.lam0[:], s.terms.mu0[:] = random.standard_normal((2, system.nrows))
    if s.scheme["gauge"] == 0.0:
        s.terms.nu_start[:] = random.standard_normal(system.nrows)
    Program.run(s.begin_step)
    k.v[:] += 0.3 * random.standard_normal(k.v.shape)
    s.terms.nu[:] = random.standard_normal(system.nrows)
    return s


def unknown(s: Any) -> np.ndarray:
    """x = (v1, nu1), Eq. (77)."""
    return np.concatenate((s.kernel.v.ravel(), s.terms.nu))


def residual(s: Any, x: np.ndarray) -> np.ndarray:
    """(74), rotational rows turned back to space so that the turning itself is not differentiated, and (75)."""
    nv = s.kernel.v.size
    s.kernel.v[:] = x[:nv].reshape(s.kernel.v.shape)
    s.terms.nu[:] = x[nv:]
    Program.run(s.evaluate)
    R_v = s.residual.copy()
    R_v[:, 3:] = np.einsum("bij,bj->bi", s.kernel.R, R_v[:, 3:])
    return np.concatenate((R_v.ravel(), s.terms.residual))


def slopes(s: Any, of: Callable[[Any, np.ndarray], np.ndarray] = residual) -> np.ndarray:
    """Central differences of the residual, rotational rows in the body frame; leaves the residual of the step."""
    x, h = unknown(s), 1e-6
    out = np.stack([(of(s, x + d) - of(s, x - d)) / (2 * h) for d in h * np.eye(len(x))], axis=1)
    of(s, x)
    for b, R in enumerate(s.kernel.R):
        out[6 * b + 3 : 6 * b + 6] = R.T @ out[6 * b + 3 : 6 * b + 6]
    return out


def places(s: Any) -> np.ndarray:
    """Where the unknowns, bodies first, stand in elimination order."""
    nodes = [np.arange(a, a + 6) for a in s.lu.body_at]
    nodes += [np.arange(a, a + n) for a, n in zip(s.lu.joint_at, np.diff(s.kernel.row), strict=True)]
    return np.concatenate(nodes)


def dense(s: Any) -> np.ndarray:
    """The block matrix, bodies first."""
    Program.run(s.assemble)
    lu = s.lu
    out = np.zeros((lu.start[-1],) * 2)
    for node in range(len(lu.size)):
        m = lu.size[node]
        for k in range(lu.pair_start[node], lu.pair_start[node + 1]):
            at, width, place = lu.pair_column[k], lu.pair_width[k], lu.pair_place[k]
            rows = slice(lu.start[node], lu.start[node + 1])
            out[rows, at : at + width] += lu.blocks[place : place + m * width].reshape(m, width)
    return out[np.ix_(places(s), places(s))]


@pytest.mark.sampled(1)
@each_system
def test_weights_agree_with_the_batched_mechanics(system):
    """M_bar, computed twice, from the same definition by different code."""
    s = arbitrary_step(system)
    set_state(s.kernel, arbitrary(system, 5))
    Program.run(s.complete)
    one, order = States.one(arbitrary(system, 5)), s.kernel.order
    assert_close(s.terms.m_bar[order], evaluate_scaling_masses(system, one)[0], rtol=1e-12)


CHOICES = ({}, {"gauge": 0.0, "keep_nu": 1}, {"gauge": 0.0, "direction": 1}, {"use_f_bar": 0}, {"b_term": 0.0})


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("choices", "name"), diagonal(CHOICES, list(SYSTEMS)), ids=str)
def test_newton_matrix_is_the_derivative_of_the_residual(choices, name):
    """Central differences of step 1e-6 leave about 1e-9; how forces change f_bar is left out by design."""
    system = SYSTEMS[name]
    s = arbitrary_step(system, **(choices if not len(system.spring_k) else choices | {"use_f_bar": 0}))
    wanted = slopes(s)
    assert np.max(np.abs(dense(s) - wanted)) < 2e-8


CARRIED = {"gauge": 0.0, "keep_nu": 1, "carry_sigma": 1}


@pytest.mark.parametrize("choices", [{}, CARRIED, CARRIED | {"corrective": 1, "c_bar": 2.0, "k_bar": 5.0}], ids=str)
def test_translation_direction_has_its_derivative_too(choices):
    """c = (e_k, 0) for spherical joints: f_bar and M_bar are constant, and with M_bar the given C_bar and K_bar."""
    bodies = [RigidBody(1.0, np.diag([0.1, 0.2, 0.25])), RigidBody(2.0, np.diag([0.3, 0.2, 0.25]))]
    pins = [Joint(0, (0.1, 0.2, 0.3)), Joint(1, (0.0, 0.3, 0.1), 0, (-0.2, 0.0, 0.1))]
    s = arbitrary_step(assemble(bodies, pins, (0, 0, -9.81)), direction=2, **choices)
    wanted = slopes(s)
    assert np.max(np.abs(dense(s) - wanted)) < 2e-8


@each_system
def test_block_factors_solve_the_assembled_matrix(system):
    """Against dense LU, to rounding times the condition number (about 1e3)."""
    s = arbitrary_step(system)
    residual(s, unknown(s))
    matrix, at = dense(s), places(s)
    Program.run(s.factor_saddle)
    assert s.lu.state["singular"] == 0
    wanted = np.random.default_rng(1).standard_normal(len(matrix))
    s.lu.x[at] = matrix @ wanted
    Program.run(s.solve_saddle)
    assert_close(s.lu.x[at], wanted, atol=1e-10)


def test_lambda_bar_is_lam_minus_xi_phi():
    """Eq. (84): what lambda_bar adds to the row forces of Eq. (71) is -K_bar xi phi."""
    forces = []
    for on in (0, 1):
        s = arbitrary_step(
            SYSTEMS["springs"], gauge=0.0, corrective=1, by_forces=1, k_bar=30.0, active=1, penalty=1e3, lambda_bar=on
        )
        s.scheme["nested"] = 1
        Program.run(s.evaluate)
        forces.append(s.terms.G1.copy())
    added = -1e3 * s.terms.k_bar1 * s.terms.phi1
    assert np.max(np.abs(added)) > 1.0
    assert_close(forces[1] - forces[0], added, rtol=1e-12, atol=1e-9)
