"""Split a system into mechanisms: groups of bodies that joints or forces connect, each measured by its own scales."""

import dataclasses
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int
from scipy.sparse.csgraph import connected_components

from ...mechanics.state import State, States
from ...mechanics.system import GROUND, MultibodySystem

HOLDS = ("joint", "spring", "user")  # parts that can tie a body to the ground
TIES = (*HOLDS, "torsion")  # all parts that connect two bodies; drives are joints


def split_mechanisms(system: MultibodySystem) -> list[Int[np.ndarray, " _"]]:
    """Return the indices of the bodies of each mechanism; bodies that only share the ground are not connected."""
    i, j = (np.concatenate([getattr(system, f"{kind}_{e}") for kind in TIES]) for e in "ij")
    both = (i != GROUND) & (j != GROUND)
    links = sp.coo_array((np.ones(np.sum(both)), (i[both], j[both])), shape=(system.nb, system.nb))
    count, of_body = connected_components(links, directed=False)
    return [np.flatnonzero(of_body == k) for k in range(count)]


def is_free(system: MultibodySystem) -> bool:
    """Return whether no joint, spring or user force connects anything to the ground."""
    return all(GROUND not in ends for ends in (getattr(system, f"{kind}_j") for kind in HOLDS))


def extract_subsystem(system: MultibodySystem, bodies: Int[np.ndarray, " n"]) -> MultibodySystem:
    """Return the system of these bodies (indices) alone, with all joints and forces that act on them, without names.

    The given system itself is returned if it has no other bodies.
    """
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


def extract_states(s: States, bodies: Int[np.ndarray, " n"]) -> States:
    """Return the motion of these bodies (indices) alone, without the angles of torsional springs.

    ``s`` itself is returned, with its angles, if it has no other bodies.
    """
    if len(bodies) == s.nb:
        return s
    # contiguous, as compiled laws take them: else they would compile once more
    r, R, v, Omega = (np.ascontiguousarray(a[:, bodies]) for a in (s.r, s.R, s.v, s.Omega))
    return States(r, R, v, Omega, s.t)


def extract_state(s: State, bodies: Int[np.ndarray, " n"]) -> State:
    """Return the state of these bodies at one instant."""
    return extract_states(States.one(s), bodies)[0]


def subtract_common_motion(system: MultibodySystem, s: States) -> States:
    """Return the motion with positions and velocities relative to the common centre of mass."""
    share = system.mass / np.sum(system.mass)
    r, v = (np.einsum("b,tbi->ti", share, a)[:, None] for a in (s.r, s.v))
    return States(s.r - r, s.R, s.v - v, s.Omega, s.t)
