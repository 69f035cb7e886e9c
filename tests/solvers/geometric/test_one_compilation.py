"""Code compiled for one system serves all: compilation is paid before the clock of the first run starts."""

import gc

import numba
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.mechanics.types import StepControl

SOLVERS = (
    "gc_weak_form",
    "gc_augmented_lagrangian",
    "gc_composed",
    "gc_extrapolated",
    "generalized_alpha",
    "energy_momentum",
    "al_index3",
    "half_explicit",
    "radau_ggl",
)
STEP = 1e-3  # [s]


def signatures() -> dict[str, int]:
    """Number of compiled signatures of every kernel (``isinstance`` would ask weak proxies that are dead)."""
    gc.unfreeze()  # those that were there before the first test
    kernels = [k for k in gc.get_objects() if issubclass(type(k), numba.core.dispatcher.Dispatcher)]
    return {f"{k.py_func.__module__}.{k.py_func.__qualname__}": len(k.signatures) for k in kernels}


def take_steps(solver: str, problem: str) -> None:
    """Two steps, where the solver takes the problem."""
    made, posed = registry.make_solver(solver), registry.make_problem(problem, {"t_end": 2 * STEP})
    control = StepControl(dt=STEP) if registry.solvers()[solver].control == "dt" else StepControl(rtol=1e-6)
    if made.refuses(posed, control) is None:
        made.solve(posed, control)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("solver", SOLVERS)
def test_no_second_compilation_for_another_system(solver):
    for problem in ("heavy_top", "spring_pendulum", "four_bar_grid", "andrews"):  # narrow and wide rows, redundant ones
        take_steps(solver, problem)
    before = signatures()
    for problem in ("chain", "torque_free_body", "bricard", "stewart_platform"):
        take_steps(solver, problem)
    again = {name: n for name, n in signatures().items() if n > before.get(name, 0)}
    assert not again, f"compiled anew: {again}"
