"""Bundles to attack, made once for all."""

import pytest


@pytest.fixture(scope="session")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, bytes]]:
    """The files of a thinned and of a lossless bundle of ten runs."""
    from .bundles import make_bundles  # a copy of the core lacks what it imports

    return make_bundles(tmp_path_factory.mktemp("attacked"))
