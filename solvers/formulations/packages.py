"""Optional packages: a solver whose package is missing refuses with a line that says how to install it."""

import importlib.util

from ...harness.mechanics.types import NotInstalled

ENGINES = "pip install 'mbsbench[engines]'"


def find_remedy(module: str, package: str = "", remedy: str = ENGINES) -> NotInstalled | None:
    """Return how to install the Python ``module`` if it is missing, else None.

    ``package`` is its name in the package registry if that differs, ``remedy`` the advice how to install it.
    """
    try:
        found = importlib.util.find_spec(module) is not None
    except ValueError:  # planted in sys.modules without a spec
        found = False
    return None if found else NotInstalled(package or module, remedy)
