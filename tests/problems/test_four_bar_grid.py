"""The grid: redundant joints, one freedom a row, and rows that fold flat in ``all_rows``."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.jacobian import independent_rows, singular_values
from mbsbench.problems import four_bar_grid
from mbsbench.problems.exact.passages import singular_passages


def test_the_grid_is_as_specified() -> None:
    """Sect. 5.5: 55 bodies, 80 joints (6 + 64 + 10), 400 rows of rank 325, 5 degrees of freedom."""
    p = make_problem("four_bar_grid")
    assert (p.system.nb, p.system.nj, p.system.nrows) == (55, 80, 400)
    assert len(independent_rows(p.system, p.initial)) == 325
    assert 6 * p.system.nb - 325 == 5


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 3), (3, 2)])
def test_every_row_has_one_freedom(rows: int, columns: int) -> None:
    """Away from singular places rank A = 6 nb - rows, whatever the size and the masses, and from a perturbed start."""
    p = make_problem("four_bar_grid", {"rows": rows, "columns": columns, "mass_spread": 0.5, "perturb": 1e-2})
    assert p.system.nb == rows * (2 * columns + 1)
    assert len(independent_rows(p.system, p.initial)) == 6 * p.system.nb - rows


def test_only_the_top_row_turns_in_top_row() -> None:
    """Sect. 5.5: the six top bars at 2 pi/3 rad/s; what hangs below translates with their feet."""
    p = make_problem("four_bar_grid")
    assert np.allclose(p.initial.Omega[:6, 2], 2.0 * np.pi / 3.0)
    assert not np.any(p.initial.Omega[6:])
    assert np.allclose(p.initial.v[6:], [0.0, 2.0 * np.pi / 3.0, 0.0])


def test_masses_spread_by_seed() -> None:
    """The same seed gives the same masses, another one others, all within the spread."""
    mass = [make_problem("four_bar_grid", {"mass_spread": 0.2, "mass_seed": k}).system.mass for k in (1, 1, 2)]
    assert np.array_equal(mass[0], mass[1])
    assert not np.array_equal(mass[0], mass[2])
    assert 0.01 < np.max(np.abs(mass[0] - 1.0)) <= 0.2


def test_rows_fold_flat_where_the_passages_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """At a passage A loses rank (one more singular value falls to rounding), and a millisecond before it has not."""
    monkeypatch.setattr(four_bar_grid, "SOUGHT", 1.5)
    p = make_problem("four_bar_grid", {"release": "all_rows", "columns": 2})
    passages = singular_passages(p, 1.2)
    assert len(passages) >= 3
    reference = p.reference()
    rank = 6 * p.system.nb - 5
    for t, _ in passages:
        at, before = (singular_values(p.system, reference.states(np.array([s]))[0])[rank - 1] for s in (t, t - 1e-3))
        assert at < 1e-9 < 1e-6 < before


def test_top_row_is_never_singular() -> None:
    """Its rows stay within 70 degrees of hanging in 10 s (here: the first 1.5 s)."""
    assert singular_passages(make_problem("four_bar_grid"), 10.0) == ()


@pytest.mark.slow
def test_thirty_two_passages_in_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """``all_rows`` as specified, certified to 1e-7 m there."""
    monkeypatch.setattr(four_bar_grid, "SOUGHT", 20.0)
    p = make_problem("four_bar_grid", {"release": "all_rows"})
    assert p.reference().error(np.array([10.0]))[0] < 1e-6
    assert len(singular_passages(p, 10.0)) == 32
    assert singular_passages(make_problem("four_bar_grid"), 10.0) == ()


def test_a_large_grid_is_cheap_to_set_up() -> None:
    """20 x 20: 820 bodies, checked at the start without a dense matrix."""
    p = make_problem("four_bar_grid", {"rows": 20, "columns": 20})
    assert (p.system.nb, p.system.nj) == (820, 21 + 19 * (2 * 2 + 19 * 3) + 2 * 1 + 19 * 2)
