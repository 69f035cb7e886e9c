"""The model check: compare an engine's model of a system, at the start, with the equations of ``harness.mechanics``.

An engine has its own velocities u; (r_dot, Omega) = T u. With the joints of its tree closed and M = blockdiag(m I, J)::

    mass matrix T^T M T,  forces at rest T^T f,  energies,  accelerations of bodies,  degrees of freedom 6 nb - rank A

Each difference is relative to the largest entry. A model that differs by more than ``SAME`` is refused.

In single precision accelerations say little: their errors grow with the condition number of the mass matrix. Their
residual does not, for elimination is backward stable. With the engine's unconstrained accelerations u_dot, and M, f of
``harness.mechanics``::

    |M u_dot - f| <= k eps S,   S = sum over bodies of |T| (|force| + |M| |a| + |terms of spatial cross products|)

S is the largest among velocities of one unit, m/s or rad/s; m |Omega| |v|, m v^2 and |Omega| |J Omega| are the sizes of
the terms of w x* I w; k = 6 (levels + 1) + nu counts roundings: three per product with a rotation, two such products
per level and two for inertias and positions, one for each velocity eliminated. The mass matrix and the rows of loops
may differ by k eps of their largest entry. A spring enters S by its terms k d and k d_0, whose difference is its force.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sl
from jaxtyping import Float

from ....harness.mechanics.cut_trees.tree import DEPENDENT, find_rank
from ....harness.mechanics.dynamics import accelerations
from ....harness.mechanics.jacobian import constraint_jacobian, independent_rows
from ....harness.mechanics.motion import applied_loads, evaluate_spring_line, kinetic_energy, potential_energy
from ....harness.mechanics.state import State, States
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.torsion import evaluate_torsion
from ....harness.mechanics.types import Problem

SAME = 1e-10  # rounding of intermediate sums is 1e-13 with 55 bodies
SINGLE = float(np.finfo(np.float32).eps)
SEED = 20


@dataclass(frozen=True)
class EngineModel:
    """An engine's model at the start."""

    T: Float[np.ndarray, "twists nu"]  # body by body
    mass_matrix: Float[np.ndarray, "nu nu"]
    rest_forces: Float[np.ndarray, " nu"]  # gravity and springs, all velocities zero
    kinetic: float  # [J]
    potential: float | None  # [J], None where the engine states none
    bias: Float[np.ndarray, "nb 6"]  # (r_ddot, Omega_dot) = T u_dot + bias
    forces: Float[np.ndarray, " nu"]  # all except those of constraints, gyroscopic ones included
    constraints: Float[np.ndarray, "nl nu"]  # Jacobian G of the constraints that its velocities leave, soft or not
    idle: tuple[Float[np.ndarray, "k nu"], Float[np.ndarray, " k"]] | None = None  # a u_dot = b moves no body


def measure_differences(problem: Problem, model: EngineModel) -> dict[str, float]:
    """Return by quantity how far an engine's model differs from this project's equations at the start of ``problem``.

    Differences of matrices, forces and accelerations are relative to the largest entry, those of energies to
    T + |V| + m |g| |r|, that of the number of degrees of freedom to the expected number.
    """
    system, start, T = problem.system, problem.initial, model.T
    one = States.one(start)
    rates = accelerations(system, start)
    exact = np.concatenate((rates.v_dot, rates.Omega_dot), axis=1)
    theirs = model.bias + (T @ _solve_rigid(model, exact)).reshape(-1, 6)
    load = applied_loads(system, States.one(replace(start, v=0.0 * start.v, Omega=0.0 * start.Omega)))[0]
    rest_forces, pulls = T.T @ load.ravel(), _sum_spring_terms(system, one)
    largest = _find_acceleration_scale(one, np.concatenate((exact, load[:, :3] / system.mass[:, None]), axis=1))
    kinetic, potential = float(kinetic_energy(system, one)[0]), float(potential_energy(system, one)[0])
    lift = float(system.mass @ np.linalg.norm(start.r, axis=1)) * float(np.linalg.norm(system.gravity))
    joules = kinetic + abs(potential) + lift
    freedom = 6 * system.nb - len(independent_rows(system, start))
    left = T.shape[1] - find_rank(model.constraints, float(np.max(np.abs(T), initial=0.0)))
    return {
        "mass matrix": _compare_arrays(model.mass_matrix, T.T @ make_mass_blocks(problem) @ T),
        "forces at rest": _compare_arrays(
            model.rest_forces, rest_forces, float(max(np.max(np.abs(load)), np.max(pulls)))
        ),
        "kinetic energy": abs(model.kinetic - kinetic) / (joules or 1.0),
        "potential energy": 0.0 if model.potential is None else abs(model.potential - potential) / (joules or 1.0),
        "acceleration of C": _compare_arrays(theirs[:, :3], exact[:, :3], largest),
        "angular acceleration": _compare_arrays(theirs[:, 3:], exact[:, 3:], largest),
        "degrees of freedom": abs(left - freedom) / freedom if freedom else float(left != 0),
    }


def refuse_model(engine: str, problem: Problem, model: EngineModel) -> str | None:
    """Return the refusal of an engine's model where a quantity of ``measure_differences`` exceeds ``SAME``, or None.

    The refusal names the quantity with the largest difference.
    """
    found = measure_differences(problem, model)
    worst = max(found, key=lambda k: found[k] if np.isfinite(found[k]) else np.inf)
    if found[worst] <= SAME:
        return None
    words = f"its {worst} differs by {found[worst]:.3g} of the largest entry (allowed {SAME:g})"
    return f"the model made for {engine} is not that of {problem.name}: {words}"


def refuse_forces(
    engine: str, problem: Problem, model: EngineModel, loops: Float[np.ndarray, "nl nu"], levels: int, eps: float
) -> str | None:
    """Return the refusal of an engine's model in single precision that differs by more than rounding, or None.

    ``loops`` is the expected Jacobian of cut joints, ``levels`` the number of bodies on the longest path from the
    ground, ``eps`` the relative precision of the engine's numbers. Forces, loop rows and the mass matrix may differ by
    k ``eps``, with k = 6 (levels + 1) + number of velocities.
    """
    k = 6 * (levels + 1) + model.T.shape[1]
    found = {
        **measure_force_differences(problem, model),
        "rows of loops": measure_loop_difference(model.constraints, loops),
        "mass matrix": _compare_arrays(model.mass_matrix, model.T.T @ make_mass_blocks(problem) @ model.T),
    }
    worst = max(found, key=lambda name: found[name] if np.isfinite(found[name]) else np.inf)
    if found[worst] <= k * eps:
        return None
    words = f"its {worst} differs by {found[worst]:.3g} of the largest (allowed {k * eps:.2g}, {k} roundings)"
    return f"the model made for {engine} is not that of {problem.name}: {words}"


def measure_force_differences(problem: Problem, model: EngineModel) -> dict[str, float]:
    """Return the differences of an engine's generalised forces from the expected ones, "forces at rest" and "forces".

    The second are at the velocities of the start. Differences are relative to S of the module's docstring: the largest
    sum of magnitudes of the terms of a force, to which rounding is proportional.
    """
    system, start, T, nb = problem.system, problem.initial, model.T, problem.system.nb
    still = replace(start, v=0.0 * start.v, Omega=0.0 * start.Omega)
    m, J = system.mass, system.regular_inertia
    parts = np.linalg.norm(T.reshape(nb, 2, 3, -1), axis=2)  # (nb, 2, nu)
    turns = np.any(T.reshape(nb, 2, 3, -1)[:, 1] != 0.0, axis=(0, 1))
    out = {}
    for name, state, forces in (("forces at rest", still, model.rest_forces), ("forces", start, model.forces)):
        load, bias = applied_loads(system, States.one(state))[0], model.bias * (name == "forces")
        momentum = np.einsum("bij,bj->bi", J, state.Omega)
        load[:, 3:] -= np.cross(state.Omega, momentum)
        lacking = load - np.concatenate((m[:, None] * bias[:, :3], np.einsum("bij,bj->bi", J, bias[:, 3:])), axis=1)
        u_dot = np.linalg.lstsq(model.mass_matrix, forces, rcond=None)[0]
        rates = _measure_wrenches(bias) + np.einsum("bkn,n->bk", parts, np.abs(u_dot))
        v, spin = np.linalg.norm(state.v, axis=1), np.linalg.norm(state.Omega, axis=1)
        crossed = np.stack((m * spin * v, m * v**2 + spin * np.linalg.norm(momentum, axis=1)), axis=1)
        inertia = np.stack((m, np.linalg.norm(J, 2, axis=(1, 2))), axis=1)
        pulls = _sum_spring_terms(system, States.one(state))
        size = np.einsum("bkn,bk->n", parts, _measure_wrenches(load) + pulls + inertia * rates + crossed)
        size = np.where(turns, np.max(size[turns], initial=0.0), np.max(size[~turns], initial=0.0))
        out[name] = float(np.max(np.abs(forces - T.T @ lacking.ravel()) / np.where(size > 0.0, size, 1.0), initial=0.0))
    return out


def measure_loop_difference(theirs: Float[np.ndarray, "nl nu"], ours: Float[np.ndarray, "nl nu"]) -> float:
    """Return the relative difference of two Jacobians of loop rows, up to a common sign; inf if shapes differ."""
    if theirs.shape != ours.shape:
        return np.inf
    return min(_compare_arrays(theirs, ours), _compare_arrays(-theirs, ours))


def make_mass_blocks(problem: Problem) -> Float[np.ndarray, "twists twists"]:
    """Return the mass matrix blockdiag(m I, J) of (r_dot, Omega), body by body."""
    masses = zip(problem.system.mass, problem.system.regular_inertia, strict=True)
    return np.array(sl.block_diag(*(b for m, J in masses for b in (m * np.eye(3), J))))


def _sum_spring_terms(system: MultibodySystem, one: States) -> Float[np.ndarray, "nb 2"]:
    """Return the sums k d + k d_0 of the spring forces [N] and torques [N m] on each body: the scale of rounding.

    The two terms of a spring cancel where it is at rest, their rounding does not.
    """
    out, (stretched, _, _) = np.zeros((system.nb + 1, 2)), evaluate_torsion(system, one)  # the last one is the ground
    for k, stiffness in enumerate(system.spring_k):
        pull = stiffness * (np.linalg.norm(evaluate_spring_line(system, one, k)[0]) + system.spring_d0[k])
        for b, p in ((system.spring_i[k], system.spring_p_i[k]), (system.spring_j[k], system.spring_p_j[k])):
            out[b] += pull * np.array([1.0, np.linalg.norm(p)])
    for k, stiffness in enumerate(system.torsion_k):
        for b in (system.torsion_i[k], system.torsion_j[k]):
            out[b, 1] += stiffness * (abs(stretched[0, k]) + abs(system.torsion_rest[k]))
    return out[:-1]


def _measure_wrenches(wrenches: Float[np.ndarray, "nb 6"]) -> Float[np.ndarray, "nb 2"]:
    """Return the magnitudes of the force and of the torque of each wrench, or of both parts of a motion."""
    return np.linalg.norm(wrenches.reshape(-1, 2, 3), axis=2)


def _solve_rigid(model: EngineModel, exact: Float[np.ndarray, "nb 6"]) -> Float[np.ndarray, " nu"]:
    """Return the accelerations u_dot that the engine's model would have if its constraints were rigid.

    They satisfy M u_dot = f + G^T lam, with G u_dot that of the ``exact`` accelerations of bodies; redundant rows are
    allowed. So M, f and G are compared, but not the softness of the engine's constraints.
    """
    rows, values = model.idle or (np.zeros((0, model.T.shape[1])), np.zeros(0))
    u_dot = np.linalg.lstsq(
        np.concatenate((model.T, rows)), np.concatenate(((exact - model.bias).ravel(), values)), rcond=None
    )[0]
    diagonal = np.diag(model.mass_matrix)
    # scale of velocities, which makes the null space uniform
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    M, f, G = scale[:, None] * model.mass_matrix * scale, scale * model.forces, model.constraints * scale
    N, particular = sl.null_space(G, rcond=DEPENDENT) if G.size else np.eye(len(f)), u_dot / scale
    return scale * (particular + N @ np.linalg.solve(N.T @ M @ N, N.T @ (f - M @ particular)))


def _compare_arrays(a: np.ndarray, b: np.ndarray, size: float = 0.0) -> float:
    """Return the largest difference of ``a`` and ``b`` over the largest entry of ``b``, or over ``size`` if larger.

    It is absolute where both of these are zero.
    """
    size = max(size, float(np.max(np.abs(b), initial=0.0)))
    return float(np.max(np.abs(a - b), initial=0.0)) / (size or 1.0)


def _find_acceleration_scale(one: States, accelerations: np.ndarray) -> float:
    """Return the scale of ``accelerations``: their largest entry, or Omega^2 if larger, since terms may cancel."""
    return float(max(np.max(np.abs(accelerations), initial=0.0), np.max(one.Omega**2, initial=0.0)))


def list_check_states(problem: Problem) -> Iterator[tuple[str, State]]:
    """Yield a label and a state for each model check: the start, then its pose with two random velocities.

    These satisfy the constraints, and are scaled by the velocities at the start.
    """
    start, system = problem.initial, problem.system
    yield "at the start", start
    A = constraint_jacobian(system, start).toarray()
    allowed = sl.null_space(A, rcond=DEPENDENT) if len(A) else np.eye(6 * system.nb)
    random = np.random.default_rng(SEED)
    speed = float(np.sqrt(np.mean(start.v**2) + np.mean(start.Omega**2))) or 1.0
    for _ in range(2):
        u = allowed @ random.normal(size=allowed.shape[1])
        u = (speed / (float(np.sqrt(np.mean(u**2))) or 1.0) * u).reshape(-1, 6)
        yield "at random velocities", replace(start, v=u[:, :3], Omega=u[:, 3:])
