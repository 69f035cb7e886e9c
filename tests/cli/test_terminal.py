"""What fits a terminal, and series in a few characters."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from mbsbench.cli.terminal import BARS, Column, fit_table, sparkline


def test_a_sparkline_shows_growth_by_decades():
    """One bar a power of ten; the largest of each stretch, whatever its sign."""
    assert sparkline([10.0**-k for k in range(8)], 8) == BARS[::-1]
    assert sparkline([1.0, -1e-3, 1e-3, 1.0, 1e-7, 1e-7], 3) == "██▁"
    assert sparkline([1.0, 1.0, 1.0], 3) == "███"
    assert sparkline([1.0, 2.0, 3.0], 3, log=False) == "▁▅█" or sparkline([1.0, 2.0, 3.0], 3, log=False) == "▁▄█"


def test_what_is_not_there_is_blank():
    """NaN is a gap, zero and rounding are the bottom."""
    assert sparkline([math.nan, 1.0, 0.0, 1e-30], 4) == " █▁▁"
    assert sparkline([math.nan, math.inf], 2) == "  " and sparkline([], 5) == "" and sparkline([0.0, 0.0], 9) == "▁▁"


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.lists(st.floats(), max_size=60), st.integers(1, 30), st.booleans())
def test_any_series_has_a_sparkline(values, width, log):
    """As long as asked for, or as the series."""
    assert len(sparkline(values, width, log=log)) == min(width, len(values))


@pytest.mark.parametrize("width", [40, 60, 80, 200])
def test_tables_fit(width):
    """Columns of large rank go first, then text folds at blanks; numbers are never broken."""
    columns = (
        Column("case", right=False, fold=True),
        Column("kept"),
        Column("x" * 20, rank=1),
        Column("y" * 20, rank=2),
    )
    rows = [("p s[first_option=1,second_option=2,third_option=3]", "1.23e-05", "1", "2")]
    out = Console(width=width)
    with out.capture() as caught:
        out.print(fit_table(columns, rows, width))
    text = caught.get()
    assert all(len(line) <= width for line in text.splitlines()) and "1.23e-05" in text
    assert ("y" * 20 in text) == (width >= 80) and ("x" * 20 in text) == (width >= 60)
    assert "third_option=3" in text.replace("\n", "") and "first_option=1" in text
