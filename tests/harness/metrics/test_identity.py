"""The number of a problem: which changes of a user force it tells apart."""

from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import pytest

from mbsbench import Problem, RigidBody, State, UserForce, assemble
from mbsbench.cli.__main__ import main
from mbsbench.harness.metrics.identity import fingerprint

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


def law(body: str, before: str = "") -> Callable[..., None]:
    """A law of its own each time, from text."""
    known: dict[str, object] = {"np": np, "numba": numba}
    exec(f"{before}\n{HEAD}{body}", known)
    return known["law"]  # type: ignore[return-value]


def number(*laws: Callable[..., None]) -> float:
    system = assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(one, 0) for one in laws])
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    return fingerprint(Problem("p", system, start, 1.0, 0.1, "", ""))


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
    same = number(law(*one))
    assert same == number(law(*one))
    assert abs(number(law(*other)) / same - 1.0) > 1e-7


def test_order_and_number_of_laws_count() -> None:
    a, b = law(PLAIN), law("T[0, 0] = -t")
    assert len({number(a, b), number(b, a), number(a), number(a, a), number()}) == 5
