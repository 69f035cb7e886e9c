"""Packages that a system may lack: the solver that needs one refuses in a line that says how to get it."""

import importlib.util

from ...harness.types import NotInstalled

ENGINES = "pip install 'mbsbench[engines]'"


def missing(module: str, package: str = "", remedy: str = ENGINES) -> NotInstalled | None:
    """Return the remedy where ``module`` (of ``package``, if that has another name) is not installed, or None."""
    try:
        found = importlib.util.find_spec(module) is not None
    except ValueError:  # planted in sys.modules without a spec
        found = False
    return None if found else NotInstalled(package or module, remedy)
