"""Problems that try every part of an export: loops, both kinds of joints, floating bodies, springs, redundant rows."""

from mbsbench import Problem, make_problem
from mbsbench.harness.mechanics.presentation import Presentation

from ...harness.reference.mechanisms import problem, slider_crank, sprung
from ..arbitrary_systems import consistent, linkage


def closed_chain() -> Problem:
    """Spherical and revolute joints in a loop, springs and dampers, tilted inertias, moving."""
    system = linkage(springs=True)
    return problem("closed_chain", system, consistent(system, 3), 0.5)


def grid() -> Problem:
    """Two by two: redundant rows, revolute loops."""
    return make_problem("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.5, "rotation": (0.3, -0.5, 0.7)})


def duplicated() -> Problem:
    """The second joint is declared twice."""
    made = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.5})
    return problem("duplicated", Presentation(duplicate=2).system(made.system), made.initial, 0.5)


def perturbed_chain() -> Problem:
    """Bars out of their plane."""
    return make_problem("chain", {"perturb": 0.1, "t_end": 0.1})


PROBLEMS = {f.__name__: f for f in (closed_chain, grid, duplicated, perturbed_chain)} | {
    "slider_crank": lambda: slider_crank(hinged=True), "sprung": lambda: sprung(0.7),
}  # fmt: skip
