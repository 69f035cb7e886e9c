"""Engines that hand out the poses of bodies and no mass matrix: checked by their steps.

Rows are (r, quaternion (w, x, y, z), v, Omega) body by body, gaps of joints included. The model check compares
accelerations of all bodies at the start, and at its pose with two random velocities that the joints allow::

    a = 2 a(h/2) - a(h),   a(h) = (v(2 h) - v(h))/h,   h = eps^p T,   T the shortest time of the motion

with ``eps`` of the engine's numbers. The second step is taken, as joints that hold where the last step ended turn their
velocities one step late. The extrapolation leaves h^2. Velocities that are states are known to eps, and
p = 1/3 balances their rounding eps/h with that; velocities that are differences of positions are known to eps T/h, and
p = 1/4. Either way the difference is of size eps^2p; a hundred times that is allowed: 2.4e-3 and 3.5e-2.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.linalg as sl
from jaxtyping import Float

from ....harness.mechanics.dynamics import accelerations
from ....harness.mechanics.jacobian import constraint_jacobian
from ....harness.mechanics.state import State
from ....harness.types import Problem, States, StepControl
from .model_check import DEPENDENT
from .protocol import Adapter, Model
from .tree import matrices

SINGLE = float(np.finfo(np.float32).eps)
ALLOWED = 100.0  # times eps^2p
SEED = 20


class Stepped(Adapter):
    """An engine of bodies."""

    eps: ClassVar[float] = SINGLE

    @property
    def power(self) -> float:
        """p of the model check."""
        return 1.0 / 3.0

    @property
    def allowed(self) -> float:
        """Allowed difference of accelerations, as a part of the largest."""
        return ALLOWED * self.eps ** (2.0 * self.power)

    @property
    def parts(self) -> int:
        """Steps that make up h: many where rounding is in velocities, which a sum of them is free of."""
        return 1

    def stiffest(self) -> "Stepped":
        """The settings of the model check: the same model, loops as stiff and iterations as many as sensible."""
        return self

    def build(self, problem: Problem, control: StepControl) -> Model:
        return Bodies(self, problem, control)

    def differing(self, problem: Problem, control: StepControl) -> str | None:
        """A step from each state of the check."""
        for which, state in check_states(problem):
            found = acceleration_errors(self.stiffest(), replace(problem, initial=state), self.eps**self.power)
            if not found <= self.allowed:
                words = f"accelerations {which} differ by {found:.3g} of the largest (allowed {self.allowed:.2g})"
                return f"the model made for {self.name} is not that of {problem.name}: {words}"
        return None


class Bodies(Model):
    """A model whose rows are of bodies."""

    def states(self, rows: Float[np.ndarray, "k n"]) -> States:
        """States from rows of bodies."""
        by_body = rows.reshape(len(rows), len(self.tree.limbs), 13)
        R = matrices(by_body[..., 3:7].reshape(-1, 4)).reshape(*by_body.shape[:2], 3, 3)
        return States(by_body[..., :3], R, by_body[..., 7:10], by_body[..., 10:])


def acceleration_errors(adapter: Stepped, problem: Problem, step: float) -> float:
    """Largest difference of accelerations at the start, of the largest one; ``step`` in times of the motion."""
    system, start = problem.system, problem.initial
    rates = accelerations(system, start)
    exact = np.stack((rates.v_dot, rates.Omega_dot))
    size = np.array([np.max(np.abs(rates.v_dot), initial=0.0), np.max(np.abs(rates.Omega_dot), initial=0.0)])
    arm = max(float(np.max(np.abs(start.r))), float(np.max(system.gyration)))
    fastest = max(float(np.max(start.Omega**2, initial=0.0)), size[1], size[0] / arm)
    time = 1.0 / np.sqrt(fastest or 1.0)
    size = np.maximum(size, np.array([arm, 1.0]) * fastest)
    coarse, fine = (_acceleration(adapter, problem, h) for h in (step * time, 0.5 * step * time))
    apart = np.max(np.abs(2.0 * fine - coarse - exact), axis=(1, 2), initial=0.0)
    return float(np.max(apart / np.where(size > 0.0, size, 1.0)))


def _acceleration(adapter: Stepped, problem: Problem, h: float) -> Any:
    n = adapter.parts
    model = adapter.build(problem, StepControl(dt=h / n))
    after = model.states(model.advance(2 * n, h / n))
    return np.stack((after.v[-1] - after.v[n - 1], after.Omega[-1] - after.Omega[n - 1])) / h


def check_states(problem: Problem) -> Iterator[tuple[str, State]]:
    """The start, and its pose with two random velocities that the joints allow."""
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
