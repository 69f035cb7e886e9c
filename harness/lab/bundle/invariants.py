"""Describe the invariants of a problem in numbers: which momentum or rate, along which direction of space or body."""

import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from ...catalogue.registry import make_problem
from ...mechanics import so3
from ...mechanics.motion import angular_momentum, linear_momentum
from ...mechanics.state import States
from ...mechanics.types import Problem
from ...results.records import parse_settings

STATES, SEED, SAME = 8, 1, 1e-12  # random states at which invariants are compared; relative difference of equal ones


@cache
def describe_invariants(name: str, parameters: str) -> list[dict[str, Any]]:
    """Return name and unit of each invariant of a problem and, where it is recognised, its quantity and direction.

    It is recognised if it equals a candidate in random states. The list is empty if the problem cannot be made from its
    ``parameters``, a JSON text.
    """
    try:
        problem = make_problem(name, parse_settings(parameters))
    except (ValueError, KeyError):  # from a plugin that is not loaded, or from an older version of the code
        return []
    if not problem.invariants:
        return []
    random, nb = np.random.default_rng(SEED), problem.system.nb
    r, v, Omega, rotation = random.standard_normal((4, STATES, nb, 3))
    s = States(r, so3.exp(rotation), v, Omega)
    known, at_home = list(_list_candidates(problem, s)), problem.home(s)
    return [
        {"name": i.name, "unit": i.unit, **next((about for about, a in known if _is_same(i.of(at_home), a)), {})}
        for i in problem.invariants
    ]


def _list_candidates(problem: Problem, s: States) -> Iterator[tuple[dict[str, Any], Float[np.ndarray, " nt"]]]:
    """Yield quantities that may be conserved, in words and at the states ``s``.

    They are momenta and spins along the home axes, and angular rates of bodies along body axes.
    """
    system = problem.system
    spins = np.einsum("tbij,bjk,tbk->tbi", s.R, system.inertia, s.Omega)
    for e in problem.frame.T:
        along = e.tolist()
        yield {"quantity": "momentum", "along": along}, linear_momentum(system, s) @ e
        yield {"quantity": "angular momentum", "along": along}, angular_momentum(system, s) @ e
        for b in range(system.nb):
            yield {"quantity": "spin", "body": b, "along": along}, spins[:, b] @ e
    for b in range(system.nb):
        for k, e in enumerate(np.eye(3)):
            yield {"quantity": "rate", "body": b, "along": e.tolist()}, s.Omega[:, b, k]


def _is_same(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether two series are equal to rounding, relative to the largest of ``b``."""
    return bool(np.max(np.abs(a - b)) <= SAME * max(float(np.max(np.abs(b))), math.ulp(1.0)))
