"""Compiled user forces are loaded where nothing that they are made of has changed, and compiled where something has."""

import numpy as np
import pytest
from numba import njit
from numba.core.ccallback import CFunc

from mbsbench import RigidBody, State, States, UserForce, assemble
from mbsbench.harness.mechanics import kept_code
from mbsbench.harness.mechanics.motion import applied

SLOPE = 2.0


def law_of(stiffness, table=None):
    """A spring between two bodies, with numbers outside of it."""
    table = np.zeros(2) if table is None else table

    @njit
    def pull(d):
        return -stiffness * d

    def law(t, r, R, v, Omega, F, T):
        F[0] = pull(r[0] - r[1]) - SLOPE * v[0] + table[0]
        F[1] = -F[0]

    return law


def force(law) -> np.ndarray:
    """On the first of two bodies a metre apart, at 1 m/s."""
    system = assemble([RigidBody(1.0, np.eye(3))] * 2, user_forces=[UserForce(law, 0, 1)])
    r, v = np.array([[1.0, 0, 0], [0, 0, 0]]), np.array([[1.0, 0, 0], [0, 0, 0]])
    return applied(system, States.one(State(r, np.array([np.eye(3)] * 2), v, np.zeros((2, 3)))))[0, 0, :3]


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """How many laws were compiled, with an empty folder to begin with."""
    monkeypatch.setattr(kept_code, "cache_folder", lambda *_: tmp_path)
    count, own = [], CFunc._compile_uncached

    def compile_uncached(self):
        count.append(self)
        return own(self)

    monkeypatch.setattr(CFunc, "_compile_uncached", compile_uncached)
    return count


def test_a_law_is_compiled_once(compiled):
    """The same numbers in other objects: the machine code of the first, and its values."""
    first, again = force(law_of(3.0)), force(law_of(3.0))
    assert len(compiled) == 1 and np.array_equal(first, again) and first[0] == -5.0


@pytest.mark.parametrize("change", ["stiffness", "table", "global"])
def test_a_number_outside_of_a_law_is_part_of_it(change, compiled, monkeypatch):
    """In a closure of a function that it calls, in an array, in a global: each gives another force."""
    force(law_of(3.0))
    if change == "global":
        monkeypatch.setitem(globals(), "SLOPE", 4.0)
    law = law_of(4.0) if change == "stiffness" else law_of(3.0, np.ones(2) if change == "table" else None)
    assert force(law)[0] == {"stiffness": -6.0, "table": -4.0, "global": -7.0}[change]
    assert len(compiled) == 2


def test_a_damaged_file_is_compiled_anew(compiled, tmp_path):
    """Cut in half, as by a full disk."""
    force(law_of(3.0))
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(kept.read_bytes()[:100])
    assert force(law_of(3.0))[0] == -5.0 and len(compiled) == 2
    force(law_of(3.0))
    assert len(compiled) == 2
