"""Loops that move though rows, counted, forbid it: redundant on the constraints alone, and known to the reference."""

import numpy as np
import pytest

from mbsbench import State, StepControl, constraint_jacobian, independent_rows, so3
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint

KINDS = {"planar": None, "spherical": None, "bennett": 17, "sarrus": 29, "bricard": 29}  # rank
SEEDS = range(1, 9)
LINKAGES = pytest.mark.parametrize("linkage", KINDS)


def draw(linkage, seed, **more):
    return make_problem("random_linkage", {"linkage": linkage, "mechanism_seed": seed, **more})


def rank(problem, state):
    return int(np.linalg.matrix_rank(constraint_jacobian(problem.system, state).toarray(), tol=1e-9))


@LINKAGES
def test_rows_are_redundant_on_the_constraints_and_nowhere_else(linkage):
    """Where the bodies start the rank leaves a freedom; turned at random it is higher."""
    for seed in SEEDS:
        p = draw(linkage, seed)
        system, start = p.system, p.initial
        kept = len(independent_rows(system, start))
        most = KINDS[linkage] or {3: 17, 4: 22}[system.nb]
        assert kept == rank(p, start) == most < min(system.nrows, 6 * system.nb)
        random = np.random.default_rng(seed)
        turned = start.R @ so3.exp(1e-2 * random.standard_normal((system.nb, 3)))
        assert rank(p, State(start.r, turned, start.v, start.Omega)) > most


@LINKAGES
def test_a_linkage_keeps_its_rank_where_it_moves(linkage):
    """Not a shaky structure: it goes through finite angles, rows kept to rounding of the solver."""
    for seed in (1, 2):
        p = draw(linkage, seed, t_end=0.3)
        run = make_solver("rkmk_dop853").solve(p, StepControl(rtol=1e-10))
        assert run.t[-1] == p.t_end, run.message
        moved = np.max(np.linalg.norm(run.states.R - run.states.R[:1], axis=(2, 3)))
        assert moved > 0.05
        assert np.max(np.abs(constraint(p.system, run.states))) < 1e-8


def test_a_draw_is_the_same_motion_at_any_size():
    """Froude: lengths go with the size, times with its root."""
    ends = []
    for size in (1.0, 1e-4):
        p = draw("sarrus", 3, size=size, mass=size, t_end=0.2 * size**0.5)
        ends.append(make_solver("rkmk_dop853").solve(p, StepControl(rtol=1e-11)).states[-1].r / size)
    assert np.max(np.abs(ends[0] - ends[1])) < 1e-7
