"""A pinion rolls down a rack, and a rack hangs on a pinion: closed forms, over many turns."""

import numpy as np
import pytest

from mbsbench import Joint, JointKind, Problem, RigidBody, State, StepControl, assemble
from mbsbench.harness.base.tableaux import DOPRI853
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.harness.mechanics.types import Status, Trajectory
from mbsbench.solvers.formulations.compiled.host import integrate
from mbsbench.solvers.formulations.methods.rkmk import make_pair_method

X, Y, Z, O = (*np.eye(3), np.zeros(3))
MASS, J, RADIUS, G, SLOPE, T_END = 1.3, 0.04, 0.1, 9.81, 1.2, 1.0
TEETH = "rack and pinion"


def rolling() -> tuple[MultibodySystem, float, float]:
    """A pinion on a rack in the ground along x, under slanting gravity; its acceleration along x, and F along x."""
    wheel = RigidBody(MASS, np.diag([0.03, 0.05, J]))
    joints = [
        Joint(0, O, -1, O, None, X, kind=JointKind.ON_LINE),
        Joint(0, O, -1, O, Z, Z, kind=JointKind.CYLINDRICAL, rows=(2, 3)),  # its axis keeps its direction
        Joint(0, O, -1, O, Z, Z, "teeth", TEETH, X, X, RADIUS),
    ]
    pull = G * np.sin(SLOPE)
    acceleration = pull / (1.0 + J / (MASS * RADIUS**2))
    return assemble([wheel], joints, (pull, -G * np.cos(SLOPE), 0.0)), acceleration, MASS * (acceleration - pull)


def hanging() -> tuple[MultibodySystem, float, float]:
    """A rack that falls along x and turns a pinion on a hinge; its acceleration, and the force of the teeth on it."""
    bodies = [RigidBody(0.7, np.diag([0.03, 0.05, J])), RigidBody(MASS, np.eye(3))]
    joints = [
        Joint(0, O, -1, O, Z, Z, kind=JointKind.REVOLUTE),
        Joint(1, O, -1, 0.3 * Y, X, X, "slide", JointKind.PRISMATIC, Y, Y),
        Joint(0, O, 1, O, Z, Z, "teeth", TEETH, X, X, RADIUS),
    ]
    acceleration = MASS * G / (MASS + J / RADIUS**2)
    return assemble(bodies, joints, (G, 0.0, 0.0)), acceleration, MASS * (acceleration - G)


def by_steps(of: Problem) -> Trajectory:
    return integrate(of, StepControl(rtol=1e-10), make_pair_method(DOPRI853))


def by_symbols(of: Problem) -> Trajectory:
    return make_solver("rk45_strong_form").solve(of, StepControl(rtol=1e-10))


@pytest.mark.parametrize("made", [rolling, hanging])
@pytest.mark.parametrize("solved", [by_steps, by_symbols])
def test_teeth_hold_over_many_turns(made, solved) -> None:  # type: ignore[no-untyped-def]
    """x = a t^2 / 2, |theta| = x / r, several turns; the reaction is the force of the teeth."""
    system, a, force = made()
    nb = system.nb
    r = np.zeros((nb, 3))
    r[1:] = 0.3 * Y
    start = State(r, np.tile(np.eye(3), (nb, 1, 1)), np.zeros((nb, 3)), np.zeros((nb, 3)))
    out = solved(Problem("teeth", system, start, T_END, 1e-3, "", "made up"))
    assert out.status is Status.SUCCESS, out.message
    s, x = out.states, 0.5 * a * out.t**2
    assert x[-1] / RADIUS > 2.0 * np.pi  # beyond a turn
    turned = x / RADIUS if nb == 1 else -x / RADIUS
    assert np.max(np.abs(s.r[:, -1, 0] - x)) < 1e-8
    assert np.max(np.abs(s.R[:, 0, 0, 0] - np.cos(turned))) < 1e-7
    assert np.max(np.abs(s.R[:, 0, 1, 0] - np.sin(turned))) < 1e-7
    sign = -1.0 if nb == 1 else 1.0  # phi = r theta - x pushes the pinion with -lam along the rack
    assert np.max(np.abs(sign * out.reaction[1:, -1] - force)) < 1e-6


@pytest.mark.parametrize("name", ["gc_weak_form", "gc_augmented_lagrangian"])
def test_ode_gc_takes_it(name: str) -> None:
    """Constant acceleration along x: the trapezoidal rule has it to the tolerance."""
    system, a, _ = rolling()
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    out = make_solver(name).solve(Problem("teeth", system, start, 0.5, 1e-3, "", ""), StepControl(dt=1e-3))
    assert out.status is Status.SUCCESS
    assert np.max(np.abs(out.states.r[:, 0, 0] - 0.5 * a * out.t**2)) < 1e-7
