"""ODE-GC's simplified step on the kernel's entries against the solvers of the catalogue: the same motion."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.compiled.host import Method, integrate
from mbsbench.solvers.formulations.methods.choices import Settings
from mbsbench.solvers.formulations.geometric.driver import at_nodes
from mbsbench.solvers.formulations.methods.compositions import COMPOSITIONS
from mbsbench.solvers.formulations.methods import gc_composed, gc_extrapolated, gc_weak_form
from mbsbench.solvers.gc_composed import GcComposed
from mbsbench.solvers.gc_extrapolated import GcExtrapolated
from mbsbench.solvers.gc_weak_form import GcWeakForm

PROBLEMS = {"heavy_top": (0.2, 1e-3), "chain": (0.1, 1e-3), "four_bar_grid": (0.1, 1e-2), "bricard": (0.1, 1e-3)}
SAME = 1e-10  # iterations stop at 1e-12 sqrt(J)


def problem(name: str) -> Problem:
    return dataclasses.replace(registry.problems()[name].make(), t_end=PROBLEMS[name][0])


def solved(of: Problem, control: StepControl, module: Any, settings: Settings, order: float = 0.0, **more: Any) -> Any:
    """By a method whose entries are kept alive as long as it runs."""
    names = ("gauge", "b_term", "tolerance", "refresh", "direction", "use_f_bar", "keep_nu")
    choices = {name: getattr(settings, name) for name in names}
    alive = []

    def prepare(kernel: Any, state: np.ndarray) -> Any:
        bundle, keeps = module.prepare(kernel, state, system=of.system, choices=choices, **more)
        alive.append(keeps)
        return bundle

    method = Method(prepare, module.step, module.finish, module.start, order=order, counters=("iterations", "rejected"))
    return integrate(of, control, method)


def is_same(new: Trajectory, old: Trajectory, tolerance: float) -> None:
    assert new.status is old.status is Status.SUCCESS
    assert np.max(np.abs(new.states.r[-1] - old.states.r[-1])) < tolerance
    assert np.max(np.abs(new.states.R[-1] - old.states.R[-1])) < tolerance
    assert np.max(np.abs(new.reaction[-1] - old.reaction[-1])) < 10.0 * tolerance * np.max(np.abs(old.reaction))


@pytest.mark.parametrize("name", PROBLEMS)
def test_compositions_are_those_of_the_catalogue(name: str) -> None:
    """Suzuki's five sub-steps."""
    of, control, solver = problem(name), StepControl(dt=PROBLEMS[name][1]), GcComposed()
    settings, gamma = solver._step.settings(of), np.array(COMPOSITIONS["suzuki4"][0])
    is_same(solved(of, control, gc_composed, settings, gamma=gamma), solver.solve(of, control), SAME)


@pytest.mark.parametrize("name", ["heavy_top", "chain"])
@pytest.mark.parametrize("gauge", ["symmetric", "zero", "accumulate"])
@pytest.mark.parametrize("direction", ["a", "mass"])
def test_the_weak_form_is_that_of_the_catalogue(name: str, gauge: str, direction: str) -> None:
    """Reactions are means over steps."""
    of, control = problem(name), StepControl(dt=PROBLEMS[name][1])
    solver = GcWeakForm(gauge=gauge, direction=direction, tolerance=1e-12)
    new = solved(of, control, gc_weak_form, solver.settings(of))
    new = dataclasses.replace(new, reaction=at_nodes(np.diff(new.t), new.reaction[1:]))
    is_same(new, solver.solve(of, control), SAME)


@pytest.mark.parametrize("use", [{"b_term": False}, {"f_bar": False}, {"direction": "translation"}])
def test_other_choices_of_the_weak_form_are_those_of_the_catalogue(use: dict) -> None:
    """Without the B term of Eq. (71), without f_bar, and c = (e_k, 0), on a spherical joint."""
    of, control, solver = problem("heavy_top"), StepControl(dt=1e-3), GcWeakForm(tolerance=1e-12, **use)
    new, old = solved(of, control, gc_weak_form, solver.settings(of)), solver.solve(of, control)
    assert np.max(np.abs(new.states.r[-1] - old.states.r[-1])) < SAME


@pytest.mark.parametrize("name", PROBLEMS)
def test_extrapolation_holds_the_error_of_the_catalogue(name: str) -> None:
    """Steps differ, since the one march controls them; both are that near to the motion at a tighter tolerance."""
    of, solver = problem(name), GcExtrapolated()
    run: Callable[[StepControl], Trajectory] = partial(
        solved, of, module=gc_extrapolated, settings=solver._step.settings(of), order=5.0, columns=3
    )
    control, sharp = StepControl(rtol=1e-6), solver.solve(of, StepControl(rtol=1e-9)).states.r[-1]
    new, old = (np.max(np.abs(out.states.r[-1] - sharp)) for out in (run(control=control), solver.solve(of, control)))
    assert new < 3.0 * old + 1e-8
