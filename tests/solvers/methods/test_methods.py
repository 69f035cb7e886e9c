"""Methods on code of a whole mechanism and on loops over its joints, and on rows that a user might add."""

import dataclasses
from functools import partial

import numpy as np
import pytest

from mbsbench import Joint, JointKind, RigidBody, State, assemble
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.compiled.host import Method, integrate, tolerance_of
from mbsbench.solvers.formulations.compiled.mechanism import make_mechanism
from mbsbench.solvers.formulations.methods import rattle, rkmk
from mbsbench.solvers.formulations.methods.tableaux import DOPRI853, Tableau
from mbsbench.solvers.formulations.rows.means import mean_row_loop

PROBLEMS = {  # name: (t_end [s], dt [s]); pins, springs and dampers, line rows, drives, rows of velocities alone
    "heavy_top": (0.3, 1e-3), "chain": (0.1, 1e-3), "flyball_governor": (0.05, 1e-4), "damped_linkage": (0.3, 1e-3),
    "slider_crank": (0.3, 1e-3),
    "driven_slider_crank": (0.5, 1e-2), "stewart_platform": (0.2, 1e-2), "rolling_disc": (0.5, 1e-2),
}  # fmt: skip
SAME = 1e-9  # [m] of step sizes that differ by rounding; fixed steps below agree to the iteration's tolerance


def problem(name: str) -> Problem:
    return dataclasses.replace(registry.problems()[name].make(), t_end=PROBLEMS[name][0])


def explicit(tableau: Tableau) -> Method:
    return dataclasses.replace(rkmk.explicit_pair(tableau), explicit=False)


def symplectic(of: Problem) -> Method:
    return rattle.symplectic_steps(of.system, np.array([1.0]), tolerance_of(1e-13, of)[0], discrete=False, rate=0.0)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("steps", ["adaptive", "fixed"])
def test_code_of_a_whole_mechanism_gives_the_same_motion(name: str, steps: str) -> None:
    """Straight code instead of loops over joints: the same steps, the same motion and reactions to rounding."""
    of = problem(name)
    control = StepControl(rtol=1e-9) if steps == "adaptive" else StepControl(dt=PROBLEMS[name][1])
    method = explicit(DOPRI853) if steps == "adaptive" else symplectic(of)
    assert make_mechanism(of.system) is not None
    new, old = (integrate(of, control, dataclasses.replace(method, explicit=whole)) for whole in (True, False))
    assert len(new.t) == len(old.t)
    assert np.max(np.abs(new.states.r[-1] - old.states.r[-1])) < SAME
    assert np.max(np.abs(new.states.R[-1] - old.states.R[-1])) < SAME
    assert np.max(np.abs(new.reaction[-1] - old.reaction[-1])) < 1e3 * SAME * max(1.0, np.max(np.abs(old.reaction)))


def test_a_row_that_is_not_quadratic_has_no_mean() -> None:
    """The length of a driven link is a root."""
    with pytest.raises(ValueError, match="no mean rows"):
        mean_row_loop("driven distance", (0,), True)


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
    prepare = partial(rkmk.prepare, tableau=DOPRI853)
    return integrate(of, StepControl(rtol=1e-10), Method(prepare, rkmk.step, rkmk.finish, rkmk.start, order=8.0))


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
