"""Is it our model? What an engine made of a system, compared at the start with the equations of ``formulations``.

An engine has its own velocities u; (r_dot, Omega) = T u. With the joints of its tree closed and M = blockdiag(m I, J)::

    mass matrix T^T M T,  forces at rest T^T f,  energies,  accelerations of bodies,  degrees of freedom 6 nb - rank A

Each difference is relative to the largest entry. No engine starts on a model that differs by more than ``SAME``.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sl
from jaxtyping import Float

from ....harness.mechanics.dynamics import accelerations
from ....harness.mechanics.jacobian import independent_rows
from ....harness.mechanics.motion import applied_loads, kinetic_energy, potential_energy
from ....harness.mechanics.state import States
from ....harness.types import Problem

SAME = 1e-10  # rounding of the sums on the way is 1e-13 with 55 bodies
DEPENDENT = 1e-9  # singular values of constraint rows, of the largest


@dataclass(frozen=True)
class EngineModel:
    """An engine's model at the start."""

    T: Float[np.ndarray, "twists nu"]  # body by body
    mass_matrix: Float[np.ndarray, "nu nu"]
    rest_forces: Float[np.ndarray, " nu"]  # of gravity and springs, all velocities zero
    kinetic: float  # [J]
    potential: float | None  # [J], None where the engine states none
    bias: Float[np.ndarray, "nb 6"]  # (r_ddot, Omega_dot) = T u_dot + bias
    forces: Float[np.ndarray, " nu"]  # all but those of constraints, gyroscopic ones included
    constraints: Float[np.ndarray, "nl nu"]  # Jacobian G of what its velocities leave to constraints, soft or not
    idle: tuple[Float[np.ndarray, "k nu"], Float[np.ndarray, " k"]] | None = None  # a u_dot = b moves no body


def differences(problem: Problem, model: EngineModel) -> dict[str, float]:
    """By quantity, relative."""
    system, start, T = problem.system, problem.initial, model.T
    one, blocks = States.one(start), [b for m, J in zip(system.mass, system.regular_inertia, strict=True)
                                      for b in (m * np.eye(3), J)]  # fmt: skip
    rates = accelerations(system, start)
    exact = np.concatenate((rates.v_dot, rates.Omega_dot), axis=1)
    theirs = model.bias + (T @ _rigid(model, exact)).reshape(-1, 6)
    load = applied_loads(system, States.one(replace(start, v=0.0 * start.v, Omega=0.0 * start.Omega)))[0]
    rest_forces = T.T @ load.ravel()
    largest = _rates(one, np.concatenate((exact, load[:, :3] / system.mass[:, None]), axis=1))
    kinetic, potential = float(kinetic_energy(system, one)[0]), float(potential_energy(system, one)[0])
    lift = float(system.mass @ np.linalg.norm(start.r, axis=1)) * float(np.linalg.norm(system.gravity))
    joules = kinetic + abs(potential) + lift
    freedom = 6 * system.nb - len(independent_rows(system, start))
    left = T.shape[1] - rank(model.constraints, float(np.max(np.abs(T), initial=0.0)))
    return {
        "mass matrix": _apart(model.mass_matrix, T.T @ sl.block_diag(*blocks) @ T),
        "forces at rest": _apart(model.rest_forces, rest_forces, float(np.max(np.abs(load), initial=0.0))),
        "kinetic energy": abs(model.kinetic - kinetic) / (joules or 1.0),
        "potential energy": 0.0 if model.potential is None else abs(model.potential - potential) / (joules or 1.0),
        "acceleration of C": _apart(theirs[:, :3], exact[:, :3], largest),
        "angular acceleration": _apart(theirs[:, 3:], exact[:, 3:], largest),
        "degrees of freedom": abs(left - freedom) / freedom if freedom else float(left != 0),
    }


def model_refusal(engine: str, problem: Problem, model: EngineModel, same: float = SAME) -> str | None:
    """Why a race with this model would be one with another problem, or None; ``same`` is more in single precision."""
    found = differences(problem, model)
    worst = max(found, key=lambda k: found[k] if np.isfinite(found[k]) else np.inf)
    if found[worst] <= same:
        return None
    words = f"its {worst} differs by {found[worst]:.3g} of the largest entry (allowed {same:g})"
    return f"the model made for {engine} is not that of {problem.name}: {words}"


def rank(G: Float[np.ndarray, "nl nu"], largest: float = 0.0) -> int:
    """Rank of constraint rows; entries that are rounding beside ``largest`` count as zero."""
    size = np.linalg.svd(G, compute_uv=False) if G.size else np.zeros(1)
    return int(np.sum(size > DEPENDENT * max(size[0], largest)))


def _rigid(model: EngineModel, exact: Float[np.ndarray, "nb 6"]) -> Float[np.ndarray, " nu"]:
    """u_dot of M u_dot = f + G^T lam where G u_dot is that of the exact motion; redundant rows allowed.

    Accelerations along the constraints are then the engine's; what G leaves open is not compared with soft constraints.
    """
    rows, values = model.idle or (np.zeros((0, model.T.shape[1])), np.zeros(0))
    u_dot = np.linalg.lstsq(
        np.concatenate((model.T, rows)), np.concatenate(((exact - model.bias).ravel(), values)), rcond=None
    )[0]
    diagonal = np.diag(model.mass_matrix)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))  # of velocities: the null space is then of one size
    M, f, G = scale[:, None] * model.mass_matrix * scale, scale * model.forces, model.constraints * scale
    N, particular = sl.null_space(G, rcond=DEPENDENT) if G.size else np.eye(len(f)), u_dot / scale
    return scale * (particular + N @ np.linalg.solve(N.T @ M @ N, N.T @ (f - M @ particular)))


def _apart(a: np.ndarray, b: np.ndarray, size: float = 0.0) -> float:
    size = max(size, float(np.max(np.abs(b), initial=0.0)))
    return float(np.max(np.abs(a - b), initial=0.0)) / (size or 1.0)


def _rates(one: States, accelerations: np.ndarray) -> float:
    """Largest acceleration of any kind, those of free bodies and spin squared included: others may cancel to zero."""
    return float(max(np.max(np.abs(accelerations), initial=0.0), np.max(one.Omega**2, initial=0.0)))
