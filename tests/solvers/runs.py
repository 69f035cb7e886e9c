"""Runs that must succeed, how far they are from the exact motion, and the orders of their errors."""

import dataclasses
from collections.abc import Sequence
from functools import cache

import numpy as np

from mbsbench import Problem, Trajectory
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.judge.order import measure_slopes
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.reference.computation import find_reference
from mbsbench.tests.factories import solve_run

from .arbitrary_systems import consistent, linkage

SYMBOLIC = ("rk45_strong_form", "ndf_index1", "ida_index1", "ida_index2", "ida_index3")
CONTESTANTS = {  # with fixed steps
    "alpha": ("generalized_alpha", {}),
    "alpha_index3": ("generalized_alpha", {"form": "index3"}),
    "al": ("al_index3", {}),
    "em": ("energy_momentum", {}),
    "hem": ("half_explicit", {}),
    "variational": ("lie_variational", {}),
}
ACCEPTED = 1e6  # a tolerance that accepts every step: max_step alone sets it


def error(problem: Problem, out: Trajectory, of: str = "r") -> float:
    """Largest distance from the exact motion."""
    exact = find_reference(problem).states(out.t)
    return float(np.max(np.linalg.norm(getattr(out.states, of) - getattr(exact, of), axis=2)))


def orders(errors: Sequence[float]) -> np.ndarray:
    """Observed orders from halvings of the step."""
    return measure_slopes(0.5 ** np.arange(len(errors)), errors)


def drift(problem: Problem, out: Trajectory) -> np.ndarray:
    """E - E(0) [J]."""
    E = energy(problem.system, out.states)
    return E - E[0]


def momentum(problem: Problem, out: Trajectory) -> np.ndarray:
    """Spatial angular momentum about the origin (nt, 3)."""
    spin = np.einsum("tbij,bjk,tbk->ti", out.states.R, problem.system.inertia, out.states.Omega)
    return spin + np.einsum("b,tbi->ti", problem.system.mass, np.cross(out.states.r, out.states.v))


def pendulum(t_end: float = 10.0, omega_z: float = 0.1) -> Problem:
    """Spatial, so that the B-term of ODE-GC counts."""
    return make_problem("spherical_pendulum", {"t_end": t_end, "omega_z": omega_z})


def sprung_linkage(t_end: float, seed: int = 2, *, damped: bool = True) -> Problem:
    """No two principal inertias alike, both kinds of joints, two spring-dampers, an arbitrary consistent start."""
    system = linkage(springs=True)
    if not damped:
        system = dataclasses.replace(system, spring_c=np.zeros(2))
    return Problem("springs", system, consistent(system, seed), t_end=t_end, dt=1e-3, section="", source="")


@cache
def end_of_strong_form(t_end: float, seed: int = 2) -> np.ndarray:
    """Where Eq. (65), another route, takes the linkage with springs (nb, 3)."""
    return solve_run(sprung_linkage(t_end, seed), 1e-12, "rk45_strong_form").states.r[-1]
