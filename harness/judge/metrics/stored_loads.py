"""Store the joint loads of exact motions on disk, as runs of one problem with equal steps compare at the same instants.

Ten solvers with one fixed step need the same loads, which take half of the time to measure a run of the chain. A file
belongs to all that its numbers follow from: the code that measures, the system, and the exact states to the bit.
"""

import hashlib

import numpy as np
from jaxtyping import Float

from ...base.cache import read_sealed_file, write_sealed_file
from ...base.machine import name_arithmetic
from ...mechanics.state import States
from ...mechanics.types import Problem
from ...reference import orbit
from ...reference.held import peek_value, recall_value
from .reactions import compute_exact_loads

CODE = "code of measuring"  # key of the digest that a held problem has in the parent of runs
EVEN = 1e-6  # relative difference of steps that are equal but for rounding
LARGEST = 2**26  # [bytes] largest file that is read


def hold_code(problem: Problem, code: str) -> None:
    """Store ``code``, the digest of all code that measures, with a held problem, whose exact loads are then stored.

    Nothing happens for a problem that the parent of runs does not hold.
    """
    recall_value(problem, CODE, lambda: code)


def find_exact_loads(problem: Problem, t: Float[np.ndarray, " nt"], exact: States) -> Float[np.ndarray, "n nb 6"]:
    """Return the joint loads of ``compute_exact_loads`` for ``exact``, states at some of a run's times ``t`` [s].

    For a problem that the parent of runs holds (``hold_code``) and a run with equal steps, which other solvers take,
    too, they are read from a file, or computed and written to it. A system with user forces has no file.
    """
    system, code = problem.system, peek_value(problem, CODE)
    steps = np.diff(t)
    shared = code and not len(system.user_i) and np.ptp(steps) <= EVEN * np.max(steps)
    if not shared:
        return compute_exact_loads(system, exact)
    digest = hashlib.sha256(str(code).encode())
    states = (exact.times, exact.r, exact.R, exact.v, exact.Omega, *(() if exact.angles is None else (exact.angles,)))
    numbers = [a for _, a in sorted(vars(system).items()) if isinstance(a, np.ndarray) and a.dtype != object]
    for a in (*states, *numbers):
        digest.update(f"{a.shape}{a.dtype}".encode() + np.ascontiguousarray(a).tobytes())
    file = orbit.FOLDER / name_arithmetic() / f"loads-{digest.hexdigest()[:24]}.bin"
    shape = len(exact), system.nb, 6
    try:
        return np.frombuffer(read_sealed_file(file, LARGEST)).reshape(shape).copy()
    except (OSError, ValueError):  # absent, or damaged: computed anew
        found = compute_exact_loads(system, exact)
        write_sealed_file(file, np.ascontiguousarray(found).tobytes())
        return found
