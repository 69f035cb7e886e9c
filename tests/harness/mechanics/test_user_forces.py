"""Laws that a user writes: what is applied, and what is refused."""

import math

import numpy as np
import pytest
from jaxtyping import Float

from mbsbench import MultibodySystem, Problem, RigidBody, State, States, Status, StepControl, UserForce, assemble
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.foreign.description import describe_problem
from mbsbench.harness.mechanics import motion, work

from ...solvers.arbitrary_systems import arbitrary, consistent, law, with_user_forces

Rows = Float[np.ndarray, "2 3"]


def branched(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """A stop: nothing above the floor."""
    if r[0, 2] < 0.0:
        F[0, 2] = -100.0 * r[0, 2]


def mathematical(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    F[0, 0] = math.sin(t)


SYSTEM = with_user_forces()


def forces(s: MultibodySystem, state: State) -> np.ndarray:
    """(F_i, F_j, T_i, T_j) of the law as Python, twice, on the bodies, in space."""
    out = np.zeros((3, 2, 3))
    for i, j in ((0, 1), (1, -1)):
        ends = [(a[i], a[j] if j >= 0 else 0.0 * a[i]) for a in (state.r, state.v, state.Omega)]
        r, v, Omega = (np.array(two) for two in ends)
        R, F, T = np.array([state.R[i], state.R[j] if j >= 0 else np.eye(3)]), np.zeros((2, 3)), np.zeros((2, 3))
        law(state.t, r, R, v, Omega, F, T)
        for e, b in enumerate((i, j)):
            out[b] += F[e], T[e]
    return out[:2]


@pytest.mark.parametrize("seed", range(3))
def test_what_is_applied_is_the_law(seed: int) -> None:
    """Compiled and called by address, or as Python: force in space, torque in the body."""
    s = arbitrary(SYSTEM, seed)
    state = State(s.r, s.R, s.v, s.Omega, 0.4 + seed)
    found = motion.applied(SYSTEM, States.one(state))[0]
    F, T = np.swapaxes(forces(SYSTEM, state), 0, 1)
    assert np.max(np.abs(found[:, :3] - F - SYSTEM.mass[:, None] * SYSTEM.gravity)) < 1e-12
    assert np.max(np.abs(found[:, 3:] - np.einsum("bij,bi->bj", state.R, T))) < 1e-12
    omega = np.einsum("bij,bj->bi", state.R, state.Omega)
    assert work.power(SYSTEM, States.one(state))[0] == pytest.approx(np.sum(F * state.v + T * omega), rel=1e-12)


@pytest.mark.parametrize(
    ("own", "said"), [(branched, ": it branches on the state; "), (mathematical, "user force 0 symbolically")]
)
def test_a_law_that_is_no_expression_is_refused_by_symbols_and_taken_by_kernels(own, said: str) -> None:  # type: ignore[no-untyped-def]
    ball = assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(own, 0)])
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.array([[0.0, 0.0, -1.0]]), np.zeros((1, 3)))
    p = Problem("a stop", ball, start, 0.5, 1e-3, "", "made up")
    assert said in (make_solver("radau_index1").refuses(p, StepControl(rtol=1e-6)) or "")
    out = make_solver("rkmk_dopri5").solve(p, StepControl(rtol=1e-8))
    assert out.status == Status.SUCCESS
    if own is branched:  # half a period of 0.63 s on the floor, then up at the speed of the fall
        assert out.states.v[-1, 0, 2] == pytest.approx(1.0, abs=1e-5)


def divided(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """An error of Python's at t = 0.1 s."""
    F[0, 0] = 1.0 / (0.0 if t > 0.1 else 1.0)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the error, as C prints it
def test_a_law_that_raises_an_error_ends_the_run() -> None:
    """Not with zeros in its place, which would look like a success."""
    ball = assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(divided, 0)])
    at_rest = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    p = Problem("an error", ball, at_rest, 0.5, 1e-3, "", "made up")
    out = make_solver("rattle").solve(p, StepControl(dt=1e-2))
    assert out.status == Status.DIVERGED
    assert 0.05 < out.t[-1] < 0.15


def test_a_file_cannot_hold_a_law() -> None:
    """It is code."""
    with pytest.raises(ValueError, match="user forces, which are code"):
        describe_problem(Problem("user forces", SYSTEM, consistent(SYSTEM, 3), 0.2, 1e-3, "", "made up"))


def imports(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """Bytecode that Numba has no translation of."""
    import math as own

    F[0, 0] = own.sin(t)


class Bound:
    """A law as a method."""

    def law(self, t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
        F[0, 0] = t


@pytest.mark.parametrize(
    "own", [lambda t: None, 1, None, "abc", [], abs, np.sin, math.sin, Bound().law, Bound, imports]
)
def test_what_is_no_law_is_refused_by_its_number(own) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match="user force 1: numba does not compile law"):
        assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(law, 0), UserForce(own, 0)])
