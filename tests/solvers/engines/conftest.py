"""Tests that need an engine run with ``make test-engines`` alone: where engines are installed, others need not wait."""

import pytest


@pytest.hookimpl(tryfirst=True)  # before marks select
def pytest_collection_modifyitems(items):
    """Mark tests that say so where their engine is absent."""
    for item in items:
        if any("make test-engines" in mark.kwargs.get("reason", "") for mark in item.iter_markers("skipif")):
            item.add_marker("engine")
