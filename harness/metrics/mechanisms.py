"""The mechanisms of a system: bodies that joints or forces connect. Each is measured by its own sizes."""

import dataclasses
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int
from scipy.sparse.csgraph import connected_components

from ..mechanics.state import State, States
from ..mechanics.system import GROUND, MultibodySystem

HOLDS = ("joint", "spring", "user")  # what can hold a body to a place
TIES = (*HOLDS, "torsion")  # all parts with two ends; drives are joints


def mechanisms(system: MultibodySystem) -> list[Int[np.ndarray, " _"]]:
    """Bodies of each; the ground connects none."""
    i, j = (np.concatenate([getattr(system, f"{kind}_{e}") for kind in TIES]) for e in "ij")
    both = (i != GROUND) & (j != GROUND)
    links = sp.coo_array((np.ones(np.sum(both)), (i[both], j[both])), shape=(system.nb, system.nb))
    count, of_body = connected_components(links, directed=False)
    return [np.flatnonzero(of_body == k) for k in range(count)]


def is_free(system: MultibodySystem) -> bool:
    """Whether no joint, spring or user force holds anything to the ground."""
    return all(GROUND not in ends for ends in (getattr(system, f"{kind}_j") for kind in HOLDS))


def part(system: MultibodySystem, bodies: Int[np.ndarray, " n"]) -> MultibodySystem:
    """The system of these bodies alone, with all joints and forces at them."""
    if len(bodies) == system.nb:
        return system
    new = np.full(system.nb + 1, GROUND)  # the last entry, at -1, is the ground
    new[bodies] = np.arange(len(bodies))
    changes: dict[str, Any] = {"mass": system.mass[bodies], "inertia": system.inertia[bodies]}
    for kind in TIES:
        i, j = (getattr(system, f"{kind}_{e}") for e in "ij")
        own = np.isin(i, bodies) | np.isin(j, bodies)
        arrays = {k: a[own] for k, a in vars(system).items() if k.startswith(kind) and isinstance(a, np.ndarray)}
        changes |= {**arrays, f"{kind}_i": new[i[own]], f"{kind}_j": new[j[own]]}
    own = np.isin(system.load_i, bodies)
    changes |= {k: a[own] for k, a in vars(system).items() if k.startswith("load_")}
    changes["load_i"] = new[changes["load_i"]]
    return dataclasses.replace(system, **changes, body_names=(), joint_names=())


def states_of(s: States, bodies: Int[np.ndarray, " n"]) -> States:
    """The motion of these bodies."""
    if len(bodies) == s.nb:
        return s
    # contiguous, as compiled laws take them: else they would compile once more
    r, R, v, Omega = (np.ascontiguousarray(a[:, bodies]) for a in (s.r, s.R, s.v, s.Omega))
    return States(r, R, v, Omega, s.t)


def state_of(s: State, bodies: Int[np.ndarray, " n"]) -> State:
    """The same at one instant."""
    return states_of(States.one(s), bodies)[0]


def without_common_motion(system: MultibodySystem, s: States) -> States:
    """Positions and velocities relative to the centre of mass of all bodies."""
    share = system.mass / np.sum(system.mass)
    r, v = (np.einsum("b,tbi->ti", share, a)[:, None] for a in (s.r, s.v))
    return States(s.r - r, s.R, s.v - v, s.Omega, s.t)
