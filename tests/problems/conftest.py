"""Certified motions are computed anew in tests (a file from an older equation must not vouch for it), and short."""

from collections.abc import Iterator

import pytest

from mbsbench.harness.reference import orbit
from mbsbench.problems import chain, four_bar_grid, n_four_bar


@pytest.fixture(scope="package", autouse=True)
def fresh_references(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """References kept in a folder of this session, sought for 1.5 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(orbit, "FOLDER", tmp_path_factory.mktemp("references"))
        patch.setattr(chain, "SOUGHT", 1.5)
        patch.setattr(four_bar_grid, "SOUGHT", 1.5)
        patch.setattr(n_four_bar, "SOUGHT", 1.5)
        yield
