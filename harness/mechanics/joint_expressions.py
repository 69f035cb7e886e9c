"""Declare the expressions of a mechanism in joint coordinates, which a solver writes and experiments work on.

A solver that writes its equations for code has them as expressions. It offers them to whoever differentiates or expands
them (``harness/catalogue/offers.py``), so that neither knows the other.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from .joint_tree import Tree
from .system import MultibodySystem
from .types import Problem

if TYPE_CHECKING:
    import casadi as ca


class JointExpressions(NamedTuple):
    """A mechanism at ``t`` [s] and y = (q, u), coordinates and velocities of its tree, as CasADi's expressions."""

    t: "ca.SX"
    y: "ca.SX"  # (ny,)
    rate: "ca.SX"  # (ny,) y_dot of the motion
    closed: "ca.SX"  # (ny,) y after a Newton step of least change onto unit quaternions, phi = 0 and phi_dot = 0
    r: "ca.SX"  # (3 nb,) [m] of C, space
    R: "ca.SX"  # (9 nb,) body to space, by rows
    V: "ca.SX"  # (6 nb,) v of C in space, Omega in the body, body by body
    T: "ca.SX"  # (nq, nu) of q_dot = T u
    H: "ca.SX"  # (nu, nu) of 2 T_kin = u^T H u
    gaps: "ca.SX"  # (n,) phi and phi_dot of independent rows of loops; rows of velocities alone have no phi
    rows: int  # rows of loops, dependent ones included


class ExpressionWriter(NamedTuple):
    """The functions by which a solver offers the expressions of any mechanism."""

    refuse: Callable[[Problem], str | None]  # why there are none, as far as that is known beforehand
    digest: Callable[[MultibodySystem, Tree], str]  # key of the equations; ValueError where there are none
    write: Callable[[MultibodySystem, Tree], JointExpressions]  # ValueError where there are none
