"""Offers of solvers: what experiments need of a solver's code, which they get from the catalogue and never import.

An offer is an attribute of a solver's class. So no room of the harness knows a file of ``solvers/``, and a copy without
that solver says what it lacks.
"""

from typing import Any

from . import registry

OFFERS = {  # the solver of each, by name of the attribute
    "accelerations": "rkmk_dop853",  # of index 1 at a state of any system, by compiled kernels
    "expressions": "dop853_joint",  # the equations of a mechanism in joint coordinates: an ``ExpressionWriter``
}


def find_offer(name: str) -> Any:
    """Return the attribute ``name`` of the solver's class that ``OFFERS`` names; raise ValueError if it is missing."""
    entry = registry.solvers().get(OFFERS[name])
    found = getattr(entry.make, name, None) if entry else None
    if found is None:
        raise ValueError(f"this needs the {name} of solver {OFFERS[name]}, which this copy of mbsbench does not have")
    return found
