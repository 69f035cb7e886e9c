"""Laws that a user writes: what is applied, refused, compiled once, and told apart."""

import math
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import pytest
from jaxtyping import Float
from numba import njit
from numba.core.ccallback import CFunc

from mbsbench import MultibodySystem, Problem, RigidBody, State, States, Status, StepControl, UserForce, assemble
from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.description import describe_problem
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.columns.identity import compute_fingerprint
from mbsbench.harness.mechanics import kept_code, motion, work
from mbsbench.tests.comparing import assert_same

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
    found = motion.applied_loads(SYSTEM, States.one(state))[0]
    F, T = np.swapaxes(forces(SYSTEM, state), 0, 1)
    assert np.max(np.abs(found[:, :3] - F - SYSTEM.mass[:, None] * SYSTEM.gravity)) < 1e-12
    assert np.max(np.abs(found[:, 3:] - np.einsum("bij,bi->bj", state.R, T))) < 1e-12
    omega = np.einsum("bij,bj->bi", state.R, state.Omega)
    assert work.compute_power(SYSTEM, States.one(state))[0] == pytest.approx(np.sum(F * state.v + T * omega), rel=1e-12)


@pytest.mark.sampled(0)
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


SLOPE = 2.0


def pulling(stiffness, table=None):
    """A spring between two bodies, with numbers outside of it."""
    table = np.zeros(2) if table is None else table

    @njit
    def pull(d):
        return -stiffness * d

    def law(t, r, R, v, Omega, F, T):
        F[0] = pull(r[0] - r[1]) - SLOPE * v[0] + table[0]
        F[1] = -F[0]

    return law


def force_of(law) -> np.ndarray:
    """On the first of two bodies a metre apart, at 1 m/s."""
    system = assemble([RigidBody(1.0, np.eye(3))] * 2, user_forces=[UserForce(law, 0, 1)])
    r, v = np.array([[1.0, 0, 0], [0, 0, 0]]), np.array([[1.0, 0, 0], [0, 0, 0]])
    return motion.applied_loads(system, States.one(State(r, np.array([np.eye(3)] * 2), v, np.zeros((2, 3)))))[0, 0, :3]


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """How many laws were compiled, with an empty folder to begin with."""
    monkeypatch.setattr(kept_code, "make_cache_folder", lambda *_: tmp_path)
    count, own = [], CFunc._compile_uncached

    def compile_uncached(self):
        count.append(self)
        return own(self)

    monkeypatch.setattr(CFunc, "_compile_uncached", compile_uncached)
    return count


def test_a_law_is_compiled_once(compiled):
    """The same numbers in other objects: the machine code of the first, and its values."""
    first, again = force_of(pulling(3.0)), force_of(pulling(3.0))
    assert len(compiled) == 1
    assert_same(first, again)
    assert first[0] == -5.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("change", ["stiffness", "table", "global"])
def test_a_number_outside_of_a_law_is_part_of_it(change, compiled, monkeypatch):
    """In a closure of a function that it calls, in an array, in a global: each gives another force."""
    force_of(pulling(3.0))
    if change == "global":
        monkeypatch.setitem(globals(), "SLOPE", 4.0)
    law = pulling(4.0) if change == "stiffness" else pulling(3.0, np.ones(2) if change == "table" else None)
    assert force_of(law)[0] == {"stiffness": -6.0, "table": -4.0, "global": -7.0}[change]
    assert len(compiled) == 2


def test_a_damaged_file_is_compiled_anew(compiled, tmp_path):
    """Cut in half, as by a full disk."""
    force_of(pulling(3.0))
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(kept.read_bytes()[:100])
    assert force_of(pulling(3.0))[0] == -5.0 and len(compiled) == 2
    force_of(pulling(3.0))
    assert len(compiled) == 2


PLUGIN = '''
import numpy as np
from mbsbench import Problem, RigidBody, State, UserForce, assemble, problem

def pull(t, r, R, v, Omega, F, T):
    for k in range(3):
        F[0, k] = -4.0 * r[0, k]

@problem("pulled")
def pulled() -> Problem:
    """A body on a spring."""
    system = assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(pull, 0)])
    start = State(np.array([[1.0, 0.0, 0.0]]), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    return Problem("pulled", system, start, t_end=0.5, dt=0.01, section="", source="a test")
'''
HEAD = "def law(t, r, R, v, Omega, F, T):\n    "


def written(body: str, before: str = "") -> Callable[..., None]:
    """A law of its own each time, from text."""
    known: dict[str, object] = {"np": np, "numba": numba}
    exec(f"{before}\n{HEAD}{body}", known)
    return known["law"]  # type: ignore[return-value]


def number(*laws: Callable[..., None]) -> float:
    system = assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(one, 0) for one in laws])
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    return compute_fingerprint(Problem("p", system, start, 1.0, 0.1, "", ""))


def test_a_run_with_a_user_force_has_a_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "own.py").write_text(PLUGIN)
    given = ("--plugin", str(tmp_path / "own.py"), "--out", str(tmp_path / "x.npz"), "--set", "rtol=1e-8")
    assert main(["solve", "pulled", "rkmk_dopri5", *given]) == 0, capsys.readouterr()
    with np.load(tmp_path / "x.npz", allow_pickle=False) as file:
        assert str(file["status"]) == "success"
        assert file["r"][-1, 0, 0] == pytest.approx(np.cos(2.0 * 0.5), abs=1e-6)


PLAIN = "F[0, 0] = np.sin(t)"
USED = "F[0, 0] = part(t) * A"
LINEAR, SQUARE = "A = 2.0\npart = numba.njit(lambda t: t)", "A = 2.0\npart = numba.njit(lambda t: t * t)"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((PLAIN,), ("F[0, 0] = np.cos(t)",)),
        ((PLAIN,), ("F[0, 0] = 2.0 * np.sin(t)",)),
        (("F[0, 0] = 2.0 * t",), ("F[0, 0] = 2.001 * t",)),
        ((USED, LINEAR), (USED, LINEAR.replace("2.0", "2.001"))),
        ((USED, LINEAR), (USED, SQUARE)),
        (("F[0] = A", "A = np.zeros(3)"), ("F[0] = A", "A = np.ones(3)")),
    ],
)
def test_another_law_is_another_problem(one: tuple[str, ...], other: tuple[str, ...]) -> None:
    """By its operations, its constants, and the constants and functions that it takes from its module."""
    same = number(written(*one))
    assert same == number(written(*one))
    assert abs(number(written(*other)) / same - 1.0) > 1e-7


def test_order_and_number_of_laws_count() -> None:
    """Each has its place."""
    a, b = written(PLAIN), written("T[0, 0] = -t")
    assert len({number(a, b), number(b, a), number(a), number(a, a), number()}) == 5
