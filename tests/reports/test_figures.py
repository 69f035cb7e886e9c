"""Figures: failures are starred, solvers keep their looks, peaks survive, the same records give the same bytes."""

import dataclasses
import re

import numpy as np
import pytest

from reports import curves, drawing, palette
from reports.figures.lines import Group
from reports.figures.plan import chapters
from reports.figures.scaling import scalings
from reports.motion import motion_of
from reports.reading import read_run
from tests.reports.conftest import put, record, series

CATALOGUE = ("gc_weak_form", "gc_augmented_lagrangian", "rk45_strong_form", "ndf_index1", "ida_index1", "ida_index3")


def test_failures_are_starred_where_they_stop(built):
    """A star for what stopped, a cross for what is wrong, the name in the legend for what never stepped."""
    folder, _, _ = built
    laws = (folder / "report" / "figures" / "pendulum-soundest-laws.svg").read_text(encoding="utf-8")
    assert laws.count('class="star-dd01"') == 4  # energy, phi, phi_dot, step
    assert laws.count('class="cross-bb01"') == 4
    assert "step underflow at 0.7 s" in laws
    for words in ("no step: refused", "no step: crashed"):
        assert words in laws
    work = (folder / "report" / "figures" / "pendulum-work.svg").read_text(encoding="utf-8")
    assert 'class="star-dd01"' in work and 'class="cross-bb01"' in work


def test_solver_keeps_its_colour_on_every_page(built):
    """In figures and beside names in tables; other settings change the dash only."""
    folder, _, html = built
    colour = palette.looks(r.solver for r in built[1])["alpha"].colour.lower()
    beside = re.findall(r'style="--c: (#\w+)">alpha<', html)
    assert beside and set(map(str.lower, beside)) == {colour}
    for name in ("pendulum-soundest-laws", "pendulum-as-printed-laws", "pendulum-work"):
        svg = (folder / "report" / "figures" / f"{name}.svg").read_text(encoding="utf-8").lower()
        assert colour in svg


def test_catalogue_has_colours_of_its_own_in_any_run():
    """The colour follows from the name, whoever else takes part."""
    together = palette.looks(CATALOGUE)
    assert len({look.colour for look in together.values()}) == len(CATALOGUE)
    assert len({look.marker for look in together.values()}) == len(CATALOGUE)
    for name in CATALOGUE:
        assert palette.looks([name])[name] == together[name]


def test_many_solvers_still_have_looks():
    """More than there are colours."""
    assert len(palette.looks(f"solver{k}" for k in range(20))) == 20


def test_finest_settings_are_solid(tmp_path):
    put(tmp_path, record("aa01", dt_s=0.01))
    put(tmp_path, record("aa02", dt_s=0.005))
    strokes = palette.dashes(read_run(tmp_path).cells)
    assert strokes["aa02"] == palette.DASHES[0] != strokes["aa01"]


def test_peaks_survive_decimation():
    """One sample out of 50,000 stands out: it must be seen."""
    t = np.linspace(0.0, 1.0, 50_000)
    a = 1e-6 * np.sin(900.0 * t)
    a[31_415] = -7.0
    assert curves.upper(t, a, 1.0).y.max() == 7.0
    assert curves.signed(t, a, 1.0).y.min() == -7.0
    assert len(curves.upper(t, a, 1.0)) <= curves.SPANS_UPPER
    assert len(curves.signed(t, a, 1.0)) <= 4 * curves.SPANS_SIGNED


@pytest.mark.parametrize("kind", [curves.upper, curves.signed, curves.band])
def test_decimation_takes_anything(kind):
    """Empty, one point, all NaN, a motion that blew up."""
    for t, a in (([], []), ([0.0], [1.0]), ([0.0, 1.0], [np.nan, np.nan]), ([0.0, 1.0, 2.0], [0.0, np.inf, 1e300])):
        curve = kind(np.array(t), np.array(a), 1.0)
        assert np.all(np.isfinite(curve.y))


def test_band_holds_smallest_and_largest():
    t = np.linspace(0.0, 1.0, 10_000)
    a = np.random.default_rng(0).lognormal(size=t.size)
    curve = curves.band(t, a, 1.0)
    assert curve.low is not None and curve.high is not None
    assert curve.low.min() == a.min() and curve.high.max() == a.max()


def test_same_records_give_the_same_bytes(tmp_path):
    """No date, no random name."""
    put(tmp_path, record("aa01"), series(50))
    run = read_run(tmp_path)
    motions = {c.record.cell: motion_of(run, c) for c in run.cells}
    drawn = chapters(run.posings[0], motions, palette.looks(run.solvers))[1].figures[0]
    one, two = drawing.write(drawn), drawing.write(drawn)
    assert one.svg == two.svg and one.png == two.png and one.inline == two.inline


def test_symbols_of_plugins_cannot_break_a_figure():
    """Mathematics that cannot be set is shown as the name."""
    assert drawing.symbol(r"\theta", "theta") == r"$\theta$"
    assert drawing.symbol(r"\frac{", "ratio") == "ratio"
    assert drawing.plain("a$b") == r"a\$b"


def test_slope_of_growth_is_that_of_the_data(tmp_path):
    """CPU per step proportional to the number of bodies: slope 1; a failure does not count."""
    cells = []
    for n in (3, 6, 12, 24):
        r = record(f"n{n:02}", problem_parameters=f'{{"links": {n}}}', cpu_median_s=0.01 * n)
        cells.append(put(tmp_path, r, series(20, bodies=n)))
    put(
        tmp_path,
        record("n99", status="diverged", problem_parameters='{"links": 99}', cpu_median_s=1e9),
        series(20, bodies=99),
    )
    run = read_run(tmp_path)
    bodies = {c.record.cell: motion_of(run, c).bodies for c in run.cells}
    (found,) = scalings(run.cells, bodies)
    assert found.bodies == (3, 6, 12, 24)
    assert found.slope == pytest.approx(1.0)
    assert not scalings(run.cells[:2], bodies)  # two sizes are no evidence


def test_lines_are_drawn_for_cells_without_an_observable(tmp_path):
    """Two plugins' cells of one problem need not hold the same series."""
    poor = series(30)
    poor = dataclasses.replace(poor, arrays={k: poor[k] for k in ("t", "energy_error")})
    put(tmp_path, record("aa01"), series(30))
    put(tmp_path, record("bb01", "beta"), poor)
    run = read_run(tmp_path)
    motions = {c.record.cell: motion_of(run, c) for c in run.cells}
    assert Group(tuple(motions.values()), {}).t_end == 2.0
    for chapter in chapters(run.posings[0], motions, palette.looks(run.solvers)):
        for drawn in chapter.figures:
            assert drawing.write(drawn).svg.startswith("<?xml")
