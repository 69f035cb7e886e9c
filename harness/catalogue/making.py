"""Provide ``make_problem`` of the public interface, with parameters in a table or as keywords."""

from collections.abc import Mapping
from typing import Any

from ..mechanics.types import Problem
from . import registry


def make_problem(name: str, parameters: Mapping[str, Any] | None = None, /, **more: Any) -> Problem:
    """Return the problem ``name``, or the one in a mechanism's file, with its start checked.

    Parameters, numbers or text, are keywords or a table: ``make_problem("heavy_top", spin=60.0)``. Raise ValueError if
    they are invalid.
    """
    if not isinstance(name, str):
        raise ValueError(f"make_problem takes the name of a problem or of a mechanism's file (got {name!r:.40})")
    if parameters is not None and not isinstance(parameters, Mapping):
        words = f"parameters are keywords or a table, {{'t_end': 2.0}} (got {parameters!r:.40})"
        raise ValueError(f"make_problem({name!r}): {words}")
    if twice := sorted({*(parameters or {})} & {*more}):
        raise ValueError(f"make_problem({name!r}): {twice[0]} is given twice")
    return registry.make_problem(name, {**(parameters or {}), **more})
