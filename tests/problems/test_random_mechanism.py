"""Mechanisms drawn at random: the same motion at any size, and a reference that knows no metre."""

import numpy as np
import pytest

from mbsbench import State, States, Status, StepControl, independent_rows, so3
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.judge.metrics.measure import _compute_laws
from mbsbench.harness.mechanics.motion import energy, kinetic_energy
from mbsbench.harness.reference.computation import compute_reference
from mbsbench.solvers.formulations.rank import rows_to_keep

SIZES = pytest.mark.parametrize("size", [1e-5, 1e5])
DRAW = {"bodies": 3, "mechanism_seed": 1}  # slides, an axis and a link: point rows beside axis rows


def at_root(size: float) -> dict[str, float]:
    """The draw at ``size``, mass as large, for the same share of its time."""
    return {**DRAW, "size": size, "mass": size, "t_end": 0.3 * size**0.5}


@SIZES
def test_the_motion_is_the_same_at_any_size(size):
    """Froude: lengths go with the size, times with its root."""
    one, other = (compute_reference(make_problem("random_mechanism", at_root(s))) for s in (1.0, size))
    t = np.linspace(0.0, 0.3, 7)
    a, b = one.states(t), other.states(t * size**0.5)
    assert other.horizon == pytest.approx(one.horizon * size**0.5)
    assert np.max(np.abs(a.r - b.r / size)) < 1e-8
    assert np.max(np.abs(a.R - b.R)) < 1e-8


@SIZES
def test_the_rank_does_not_depend_on_the_metre(size):
    """Axis rows have no length, point rows have arms: compared as they are, arms of 1e5 m make axes look dependent."""
    for seed in range(1, 9):
        given = {"bodies": 3, "mechanism_seed": seed, "repeated": 1}
        one, other = (make_problem("random_mechanism", {**given, "size": s}) for s in (1.0, size))
        rank = len(rows_to_keep(one.system, one.initial))
        assert (
            rank == len(rows_to_keep(other.system, other.initial)) == len(independent_rows(other.system, other.initial))
        )


@SIZES
def test_a_hinge_is_judged_alike_at_any_size(size):
    """Hinges a little open in all rows: |phi| in metres, over the reach that it is compared with, has no unit."""
    shares = []
    for s in (1.0, size):
        p = make_problem("random_mechanism", {"bodies": 3, "mechanism_seed": 3, "size": s, "mass": s})
        assert len(p.system.axis_rows().row)
        turned = so3.exp(1e-3 * np.arange(9.0).reshape(3, 3))
        apart = State(p.initial.r, p.initial.R @ turned, p.initial.v, p.initial.Omega)
        shares.append(_compute_laws(p.system, States.one(apart))[3][0] / s)
    assert shares[1] == pytest.approx(shares[0], rel=1e-6)


@pytest.mark.parametrize(("size", "mass"), [(1e-5, 1e-10), (1e5, 1e10)])
@pytest.mark.parametrize("solver", ["gc_weak_form", "gc_augmented_lagrangian"])
def test_the_geometric_solvers_know_no_joule(solver, size, mass):
    """The energy drift is the same share of the energy at any size; c_R = a/(a.a) alone mixes metres and radians.

    With the tolerance in joules as it stands, 0.2 of the energy goes at 1e-5 m, and steps underflow at 1e5 m.
    """
    shares = []
    for s, m in ((1.0, 1.0), (size, mass)):
        p = make_problem("random_mechanism", {**at_root(s), "mass": m, "springs": 0, "loads": 0})
        out = make_solver(solver).solve(p, StepControl(dt=2e-3 * s**0.5))
        assert out.status == Status.SUCCESS
        E, T = energy(p.system, out.states), kinetic_energy(p.system, out.states)
        shares.append(np.max(np.abs(E - E[0])) / np.max(T))
    assert shares[1] == pytest.approx(shares[0], rel=0.3)
