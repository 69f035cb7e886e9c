"""Measure a problem's equations, which no run changes: sizes, and the operators of Lagrange and Newton."""

import json
from typing import Any

import casadi as ca
import numpy as np

from ....catalogue import registry
from ....mechanics.jacobian import constraint_jacobian
from ....mechanics.system import MultibodySystem
from ....results.records import RunRecord
from ....results.series import Series
from .measures import NAN, measure

STATES = 5  # number of states at which the operators are compared


@measure("of", series=False, until="known", of_problem=True, natural="firm")
def number(record: RunRecord, series: Series | None, of: str) -> float:
    """Return how many bodies, joints, coordinates (six per body), constraint rows or freedoms the problem has.

    ``of`` is that word: ``bodies``, ``joints``, ``coordinates``, ``rows`` or ``freedoms``; any other gives NaN.
    """
    problem = registry.make_problem(record.problem, json.loads(record.problem_parameters))
    system = problem.system
    if of == "freedoms":
        return float(6 * system.nb - np.linalg.matrix_rank(constraint_jacobian(system, problem.initial).toarray()))
    sizes = {"bodies": system.nb, "joints": len(system.joint_i), "coordinates": 6 * system.nb, "rows": system.nrows}
    return float(sizes.get(of, NAN))


@measure("of", series=False, until="known", of_problem=True, natural="firm")
def operators(record: RunRecord, series: Series | None, of: str) -> float:
    """Return the largest relative difference between the operator of Lagrange, Eq. (45), and Newton's, for one body.

    The body turns about its joint, in ``STATES`` random states. ``of`` names the form of Lagrange's operator: ``natural
    basis`` (in Euler angles, converted to the body frame), ``body frame`` (of velocities in that frame), or
    ``corrected`` (the latter with the terms of Eq. (47), c_ki^m p_m v^k, added); any other gives NaN.
    """
    compared = _operators(registry.make_problem(record.problem, json.loads(record.problem_parameters)).system)
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(STATES):
        newton, *others = (np.array(x).ravel() for x in compared(*random.uniform(0.3, 1.3, (3, 3))))
        lagrange = dict(zip(("natural basis", "body frame", "corrected"), others, strict=True)).get(of)
        if lagrange is None:
            return NAN
        worst = max(worst, float(np.linalg.norm(newton - lagrange) / np.linalg.norm(newton)))
    return worst


def _operators(system: MultibodySystem) -> Any:
    """Return a CasADi function that gives Newton's operator and Lagrange's three [N m], each (3,) in the body frame.

    Its arguments are the 3-1-3 angles and their first and second derivatives.
    """
    angle, rate, second = (ca.SX.sym(name, 3) for name in ("angle", "rate", "second"))
    arm = system.joint_s_i[0]
    J = ca.DM(system.inertia[0] + system.mass[0] * (arm @ arm * np.eye(3) - np.outer(arm, arm)))

    theta, psi = angle[1], angle[2]
    B = ca.vertcat(
        ca.horzcat(ca.sin(theta) * ca.sin(psi), ca.cos(psi), 0),
        ca.horzcat(ca.sin(theta) * ca.cos(psi), -ca.sin(psi), 0),
        ca.horzcat(ca.cos(theta), 0, 1),
    )  # maps rates of 3-1-3 angles to Omega in the body frame
    Omega = B @ rate
    Omega_dot = B @ second + ca.jacobian(Omega, angle) @ rate
    T = 0.5 * Omega.T @ J @ Omega
    p = ca.jacobian(T, rate).T
    natural = ca.jacobian(p, angle) @ rate + ca.jacobian(p, rate) @ second - ca.jacobian(T, angle).T
    newton = J @ Omega_dot + ca.cross(Omega, J @ Omega)
    body = J @ Omega_dot  # T of the velocities in the body frame does not depend on the angles
    hamel = ca.vertcat(
        *(
            sum((int(k != i) * _sign(i, k, m) * Omega[k] * (J @ Omega)[m] for k in range(3) for m in range(3)), 0)
            for i in range(3)
        )
    )
    return ca.Function("operators", [angle, rate, second], [newton, ca.solve(B.T, natural), body, body + hamel])


def _sign(i: int, k: int, m: int) -> int:
    """Return the structure constant of the body frame's axes, [e_i, e_k] = sign e_m: 1, -1 or 0."""
    return (i - k) * (k - m) * (m - i) // 2
