"""Engines of environments of their own, imported here where versions allow it."""

import importlib.util
import sys

import pytest

from mbsbench.solvers.engines.export import process


def import_engine(engine: str):
    """The engine's module, or a skip where it is installed neither here nor for itself."""
    python = process.find_environment(engine)
    if python is not None and importlib.util.find_spec(engine) is None:
        sys.path += map(str, python.parent.parent.glob("lib/python*/site-packages"))  # last: all else is ours
    return pytest.importorskip(engine, reason=f"{engine} is not installed: make engines")
