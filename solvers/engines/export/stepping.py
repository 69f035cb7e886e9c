"""Adapters of engines that return poses of bodies and no mass matrix, whose model check compares steps.

Rows are (r, quaternion (w, x, y, z), v, Omega) body by body, so that gaps of joints are recorded. The model check
compares accelerations of all bodies at the start, and at its pose with two random admissible velocities::

    a = 2 a(h/2) - a(h),   a(h) = (v(2 h) - v(h))/h,   h = eps^(1/3) T,   T the shortest time of the motion

with ``eps`` of the engine's numbers. The second step is taken, since constraints evaluated at the end of the last step
turn their velocities one step late. The extrapolation leaves h^2, which balances the rounding eps/h of velocities: the
difference is of size eps^(2/3). A hundred times that is allowed, 2.4e-3.
"""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from ....harness.mechanics.cut_trees.tree import make_matrices
from ....harness.mechanics.dynamics import accelerations
from ....harness.mechanics.types import Problem, States, StepControl
from .model_check import SINGLE, list_check_states
from .protocol import Adapter, Model

ALLOWED = 100.0  # multiple of eps^(2/3)


class BodyAdapter(Adapter):
    """Base class of adapters whose rows are poses and velocities of bodies, (13 nb,)."""

    eps: ClassVar[float] = SINGLE

    def stiffen(self) -> "BodyAdapter":
        """Return the adapter whose steps the model check compares; by default this one.

        An override may change damping, stabilisation and iterations, but not the model.
        """
        return self

    def build(self, problem: Problem, control: StepControl) -> Model:
        """Build the engine's model, whose rows are poses and velocities of bodies, and return it."""
        return BodyModel(self, problem, control)

    def compare_model(self, problem: Problem, control: StepControl) -> str | None:
        """Return the refusal of a model whose steps have other than the exact accelerations, or None if they agree."""
        allowed = ALLOWED * self.eps ** (2.0 / 3.0)
        for which, state in list_check_states(problem):
            found = measure_acceleration_error(self.stiffen(), replace(problem, initial=state), self.eps ** (1.0 / 3.0))
            if not found <= allowed:
                words = f"accelerations {which} differ by {found:.3g} of the largest (allowed {allowed:.2g})"
                return f"the model made for {self.name} is not that of {problem.name}: {words}"
        return None


class BodyModel(Model):
    """A model whose rows are poses and velocities of bodies."""

    def states(self, rows: Float[np.ndarray, "k n"]) -> States:
        """Convert rows of ``advance`` to poses and velocities of the bodies."""
        by_body = rows.reshape(len(rows), len(self.tree.limbs), 13)
        R = make_matrices(by_body[..., 3:7].reshape(-1, 4)).reshape(*by_body.shape[:2], 3, 3)
        return States(by_body[..., :3], R, by_body[..., 7:10], by_body[..., 10:])


def measure_acceleration_error(adapter: BodyAdapter, problem: Problem, step: float) -> float:
    """Return the largest relative difference of an engine's accelerations at the start from the exact ones.

    They follow from second steps of two sizes, of which ``step`` is the larger one in units of the shortest time of the
    motion, T = 1 / sqrt(max(Omega^2, |Omega_dot|, |v_dot| / arm)).
    """
    system, start = problem.system, problem.initial
    rates = accelerations(system, start)
    exact = np.stack((rates.v_dot, rates.Omega_dot))
    size = np.array([np.max(np.abs(rates.v_dot), initial=0.0), np.max(np.abs(rates.Omega_dot), initial=0.0)])
    arm = max(float(np.max(np.abs(start.r))), float(np.max(system.gyration)))
    fastest = max(float(np.max(start.Omega**2, initial=0.0)), size[1], size[0] / arm)
    time = 1.0 / np.sqrt(fastest or 1.0)
    size = np.maximum(size, np.array([arm, 1.0]) * fastest)
    coarse, fine = (_measure_acceleration(adapter, problem, h) for h in (step * time, 0.5 * step * time))
    apart = np.max(np.abs(2.0 * fine - coarse - exact), axis=(1, 2), initial=0.0)
    return float(np.max(apart / np.where(size > 0.0, size, 1.0)))


def _measure_acceleration(adapter: BodyAdapter, problem: Problem, h: float) -> Any:
    """Return (v_dot, Omega_dot) of all bodies, (2, nb, 3), as changes over the engine's second step of ``h`` [s]."""
    model = adapter.build(problem, StepControl(dt=h))
    after = model.states(model.advance(2, h))
    return np.stack((after.v[1] - after.v[0], after.Omega[1] - after.Omega[0])) / h
