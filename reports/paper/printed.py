"""Settings as the paper prints them, by the solver that plays the part: what its figures have in common.

ODE-GC, ODE-45, DAE-FI and DAE-SE are the paper's names; ours are the solvers run in their place.
"""

from collections.abc import Mapping
from typing import Any

from .spec import Pick

EULER = {"coordinates": "euler313", "lambda_in_error_test": True}
GIVEN = {
    "ODE-45": ("rk45_strong_form", EULER),
    "DAE-FI": ("ida_index1", EULER),
    "DAE-SE": ("ndf_index1", {**EULER, "accelerations": "eliminated"}),
}
BAUMGARTE = "Baumgarte's gains C_B and K_B of Eq. (94) are not printed; the solvers' default is taken"
JACOBIANS = (
    "The solvers here take exact Jacobians; whether MATLAB's were given or approximated by differences, and which norm "
    "and order they used, is not printed: a run that ends otherwise than the paper's need not contradict it."
)
CHART = "the direction c_R of Eq. (31) is not printed: both choices are drawn"
STARTS = "starting values of sigma and mu are not printed: carried, and as the choice of c_R asks"


def classical(problem: str, name: str, rtol: float, max_step: float, **parameters: Any) -> Pick:
    """ODE-45, DAE-FI or DAE-SE with the printed tolerance and largest step."""
    solver, options = GIVEN[name]
    key = f"{name} {rtol:g}"
    return Pick(key, solver, problem, parameters, options, rtol=rtol, max_step=max_step)


def geometric(problem: str, dt: float, tolerance: float, **parameters: Any) -> tuple[Pick, Pick]:
    """ODE-GC accumulating mu and carrying sigma: with c_R = (e_R, 0), and with c_R = a / (a . a)."""
    carried: Mapping[str, Any] = {"gauge": "accumulate", "sigma0": "carried", "tolerance": tolerance}
    translation = {**carried, "direction": "translation", "mu0": "velocity"}
    return (
        Pick("ODE-GC", "gc_weak_form", problem, parameters, translation, dt=dt, words="c_R = (e_R, 0)"),
        Pick("ODE-GC 2", "gc_weak_form", problem, parameters, carried, dt=dt, words="c_R = a/(a·a)"),
    )


def sound(problem: str, solver: str, key: str = "", *, dt: float | None = None, rtol: float | None = None,
          **parameters: Any) -> Pick:  # fmt: skip
    """A solver with its defaults, which are its recommended settings."""
    return Pick(key or solver, solver, problem, parameters, dt=dt, rtol=rtol)


ROLES = {
    "gc_weak_form": "ODE-GC", "gc_augmented_lagrangian": "ODE-GC (AL)", "rk45_strong_form": "ODE-45",
    "ida_index1": "DAE-FI", "ndf_index1": "DAE-SE", "ida_index3": "index 3",
}  # fmt: skip


def role(pick: Pick) -> str:
    """Whose part in the paper a solver plays."""
    return ROLES[pick.solver]
