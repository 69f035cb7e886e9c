"""Laws of ODE-GC's full Newton step, by plain NumPy: its matrix, norms, estimates, its filter, and a step that fails.

They see what a run hides, since its iteration comes to the same end by another way.
"""

from collections.abc import Collection
from typing import Any

import numpy as np

from mbsbench.harness.mechanics.joints import JointKind
from mbsbench.solvers.formulations.compiled.entries import BoundFunction, Program
from mbsbench.solvers.formulations.methods import gc_newton

from ..arbitrary_joints import one_joint
from ..methods.test_gc_newton import DT, SYSTEMS, arbitrary_step, dense, slopes
from .laws import Law

GC, AL = "gc_weak_form", "gc_augmented_lagrangian"
MATRICES = {  # settings of the step, beside those of the system
    "pins": ({}, {"gauge": 0.0, "corrective": 1, "c_bar": 2.0, "k_bar": 5.0, "use_f_bar": 0}),
    "springs": ({"use_f_bar": 0},),
}
ESTIMATES = ({}, {"gauge": 0.0, "keep_nu": 1}, {"extrapolate": 0.0})
PENALTY = 1e3
TOLERANCES = 10.0 ** -np.arange(0.0, 12.0, 0.5)  # of the filter's passes, from one to the most of them
EXACT = 1e-11  # of the size of a quantity, after solutions with the matrix


def make_newton_laws(solvers: Collection[str]) -> list[Law]:
    """Make the laws that belong to some solvers."""
    found = []
    if GC in solvers:
        found += [_of_matrix(name, choices) for name, own in MATRICES.items() for choices in own]
        found += [*map(_of_estimate, ESTIMATES), _of_norms()]
    if AL in solvers:
        found += [_of_filter(), _of_determinant(), *map(_of_failure, (1e7, 1.0))]
    return found


def _of_matrix(name: str, choices: dict[str, float]) -> Law:
    """The matrix of Eq. (79): central differences of the residual of (74) and (75).

    With C_bar or K_bar the step begins at phi = phi_dot = mu = lam = 0: slopes of M_bar are left out of the matrix.
    """

    def begin() -> Any:
        s = arbitrary_step(SYSTEMS[name], **choices)
        if "corrective" in choices:
            for x in (s.terms.lam0, s.terms.mu0, s.terms.phi0, s.terms.phi_dot0):
                x[:] = 0.0
            Program.run(s.begin_step)
        return s

    def evaluate() -> dict[str, np.ndarray]:
        s = begin()
        Program.run(s.evaluate)
        return {"entry of Newton's matrix": dense(s)}

    plain = {"entry of Newton's matrix": slopes(begin())}
    return Law(f"{GC} {choices}, {name}", evaluate, plain, 2e-8)


def _of_estimate(choices: dict[str, float]) -> Law:
    """The first estimate of a step, extrapolated from the last one, and what its end keeps for the next."""

    def begin() -> Any:
        s, random = arbitrary_step(SYSTEMS["pins"], **choices), np.random.default_rng(4)
        for x in (s.v_old, s.terms.nu_old, s.terms.nu_change):
            x[:] = random.standard_normal(x.shape)
        s.scheme["last"] = 0.7 * DT
        return s

    def evaluate() -> dict[str, np.ndarray]:
        s = begin()
        Program.run(s.estimate)
        found = s.kernel.v.copy(), s.terms.nu.copy()
        s.scheme["last"] = DT
        Program.run(BoundFunction(gc_newton.finish, s))
        return dict(zip(plain, (*found, s.v_old, s.terms.nu_change), strict=True))

    s, ratio = begin(), choices.get("extrapolate", 1.0) / 0.7
    v, old, change, start = s.v0 + ratio * (s.v0 - s.v_old), s.terms.nu_old, s.terms.nu_change, s.terms.nu_start
    nu = start + ratio * change if "keep_nu" in choices else ratio * (old + ratio * change)
    plain = {"velocity": v, "nu": nu, "v_old": s.v0, "change of nu": nu - (start if "keep_nu" in choices else old)}
    return Law(f"{GC} {choices}, estimate", evaluate, plain, 1e-14)


def _of_norms() -> Law:
    """The norms (80), (81) of a residual, less the part of (75) that no velocity changes."""

    def begin() -> tuple[Any, np.ndarray]:
        s = arbitrary_step(SYSTEMS["pins"])
        return s, np.random.default_rng(4).standard_normal(len(s.terms.left))

    def evaluate() -> dict[str, np.ndarray]:
        s, left = begin()
        s.terms.left[:] = left
        Program.run(s.evaluate)
        return {"(75)": s.terms.residual, "(80)": s.scheme["norm"].copy(), "(81)": s.scheme["slip"].copy()}

    s, left = begin()
    Program.run(s.evaluate)
    R_mu = s.terms.residual - left
    force, torque = s.residual[:, :3], s.residual[:, 3:]
    turn = np.linalg.solve(s.kernel.J, torque[:, :, None])[:, :, 0]
    total = np.sum(force**2 / s.kernel.mass[:, None]) + np.sum(torque * turn) + np.sum(s.terms.m_bar * R_mu**2)
    slip = np.sum(s.terms.m_bar * s.terms.phi_dot1**2)
    return Law(f"{GC}, norms", evaluate, {"(75)": R_mu, "(80)": np.sqrt(total), "(81)": np.sqrt(slip)}, 1e-13)


def _of_filter() -> Law:
    """Newton's correction without nu of redundant rows: what the saddle makes of (Xi M_bar)^-1 nu, again and again."""

    def begin(tolerance: float) -> Any:
        twice = one_joint(JointKind.REVOLUTE, ground=False, times=2)[0]
        s = arbitrary_step(twice, active=1, penalty=PENALTY, redundant=1, tolerance=tolerance, use_f_bar=0)
        Program.run(s.evaluate)
        s.terms.residual[:] += 1e-3 * np.random.default_rng(4).standard_normal(twice.nrows)  # copies disagree
        return s

    def correct(tolerance: float) -> list[np.ndarray]:
        s = begin(tolerance)
        start = s.kernel.v.copy(), s.terms.nu.copy()
        Program.run(s.refresh)
        Program.run(s.correct)
        return [s.kernel.v - start[0], s.terms.nu - start[1], s.terms.left, s.control["solves"] - 1]

    def correct_plainly(tolerance: float) -> list[np.ndarray]:
        s = begin(tolerance)
        M, n, terms = dense(s), s.kernel.v.size, s.terms
        x, passes = np.linalg.solve(M, -np.concatenate((s.residual.ravel(), terms.residual))), 0
        kept, change = x, np.inf
        while passes < gc_newton.MOST_PASSES and change >= gc_newton.SMALL_LEAK * tolerance:
            before = kept[n:]
            kept, passes = np.linalg.solve(M, np.concatenate((np.zeros(n), terms.softness * before))), passes + 1
            change = np.sqrt(np.sum(terms.m_bar * (terms.softness * (kept[n:] - before)) ** 2))
        x = x - kept
        return [x[:n].reshape(-1, 6), x[n:], -terms.softness * kept[n:], np.array(passes)]

    def of_all(way: Any) -> dict[str, np.ndarray]:
        names = "change of velocity", "change of nu", "phi_dot left", "passes of the filter"
        return dict(zip(names, map(np.array, zip(*map(way, TOLERANCES), strict=True)), strict=True))

    return Law(f"{AL}, filter", lambda: of_all(correct), of_all(correct_plainly), EXACT)


def _of_determinant() -> Law:
    """The change of the determinant from one factor to the next."""

    def evaluate() -> dict[str, np.ndarray]:
        s = arbitrary_step(SYSTEMS["pins"], active=1, penalty=PENALTY)
        Program.run(s.evaluate)
        s.scheme["log_det"] = 3.0
        Program.run(s.refresh)
        return {"fall of the determinant": s.scheme["log_det"] - s.scheme["fall"]}

    return Law(f"{AL}, determinant", evaluate, {"fall of the determinant": np.array(3.0)}, EXACT)


def _of_failure(penalty: float) -> Law:
    """A step that no loop solves: it is repeated with a penalty of soft / (omega dt)^2, and ends at its start."""

    def begin() -> Any:
        s = arbitrary_step(SYSTEMS["pins"], active=1, penalty=penalty, soft=0.1, max_newton=0)
        s.kernel.r[:], s.kernel.R[:], s.kernel.v[:] = s.r0, s.R0, s.v0
        return s

    def evaluate() -> dict[str, np.ndarray]:
        s = begin()
        Program.run(BoundFunction(gc_newton.take_step, s))
        return {"penalty": s.scheme["xi"].copy(), "r": s.kernel.r, "R": s.kernel.R, "velocity": s.kernel.v}

    s = begin()
    omega2 = np.max(np.sum(s.v0[:, 3:] ** 2, axis=1))
    plain = {"penalty": np.array(min(penalty, 0.1 / (omega2 * DT**2))), "r": s.r0, "R": s.R0, "velocity": s.v0}
    return Law(f"{AL}, failed step, penalty {penalty:g}", evaluate, plain, 1e-14)
