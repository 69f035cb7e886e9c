"""Define options of solvers and parameters of problems: a default, a unit, a sentence, and the allowed values.

A solver's option is a dataclass field made by ``option``; a problem's parameter is a keyword with ``Annotated[float,
Parameter(...)]``. Both are listed by ``mbsbench list`` and parsed from text here.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from ..base.hints import format_value

SWITCHES = {"true": True, "on": True, "1": True, "yes": True, "false": False, "off": False, "0": False, "no": False}


@dataclass(frozen=True)
class Parameter:
    """The meaning of a value, its unit, and the values that are allowed."""

    doc: str
    unit: str = ""
    choices: tuple[Any, ...] = ()
    above: float | None = None  # the value must be > above
    at_least: float | None = None
    at_most: float | None = None


def option(default: Any, doc: str, unit: str = "", **limits: Any) -> Any:
    """Return a dataclass field for an option of a solver, with its ``Parameter``; ``limits`` are fields of that."""
    return dataclasses.field(default=default, metadata={"parameter": Parameter(doc, unit, **limits)})


def read_value(name: str, given: Any, default: Any, parameter: Parameter) -> Any:
    """Return the value of the parameter ``name``, ``given`` as text or number, in the type of its ``default``.

    Raise ValueError if it cannot be converted, is not finite, or is not among the values that ``parameter`` allows.
    """
    value = _convert_value(default, given, name)
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    if parameter.choices and value not in parameter.choices:
        raise ValueError(f"{name} must be one of {', '.join(map(str, parameter.choices))} (got {format_value(given)})")
    low, least, most = parameter.above, parameter.at_least, parameter.at_most
    for number in value if isinstance(value, tuple) else (value,):
        wanted = (
            "a finite number"
            if isinstance(number, float) and not math.isfinite(number)
            else f"> {low:g}"
            if low is not None and not number > low
            else f">= {least:g}"
            if least is not None and not number >= least
            else f"<= {most:g}"
            if most is not None and not number <= most
            else ""
        )
        if wanted:
            raise ValueError(f"{name} must be {wanted}{unit} (got {format_value(given)})")
    return value


def _convert_value(default: Any, given: Any, name: str) -> Any:
    """Return ``given`` in the type of ``default``; raise ValueError with the parameter's ``name`` if impossible.

    A tuple may be given as text, ``(1, 2, 3)``, and a switch as ``on`` or ``yes``.
    """
    wanted = "true or false"
    try:
        if isinstance(default, bool):
            return SWITCHES[str(given).lower()]
        if isinstance(default, int):
            wanted = "an integer"
            if isinstance(given, bool) or (isinstance(given, float) and not given.is_integer()):
                raise ValueError
            return int(given)
        if isinstance(default, float):
            wanted = "a number"
            return float(given)
        if isinstance(default, tuple):
            wanted = f"{len(default)} numbers"
            parts = given.strip("()").split(",") if isinstance(given, str) else list(given)
            if len(parts) != len(default):
                raise ValueError
            return tuple(map(float, parts))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be {wanted} (got {format_value(given)})") from None
    return str(given)
