"""Certified motions are computed anew in tests (a file from an older equation must not vouch for it), and short."""

from collections.abc import Generator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from mbsbench.harness.reference import orbit
from mbsbench.problems import chain, four_bar_grid, n_four_bar

HERE, FRESH = Path(__file__).parent, TemporaryDirectory()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """References kept in a folder of this process, sought for 1.5 s, while a test of this folder runs."""
    with pytest.MonkeyPatch.context() as patch:
        if item.path.is_relative_to(HERE):
            patch.setattr(orbit, "FOLDER", Path(FRESH.name))
            for problem in (chain, four_bar_grid, n_four_bar):
                patch.setattr(problem, "SOUGHT", 1.5)
        return (yield)
