"""Options of solvers and parameters of problems: a default, a unit, a sentence, and the values that make sense.

A solver's option is a dataclass field made by ``option``; a problem's parameter is a keyword with
``Annotated[float, Parameter(...)]``. Both are listed by ``mbsbench list`` and parsed from text here.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any


@dataclass(frozen=True)
class Parameter:
    """What a value means and which are allowed."""

    doc: str
    unit: str = ""
    choices: tuple[Any, ...] = ()
    above: float | None = None  # the value must be > above
    at_least: float | None = None
    at_most: float | None = None


def option(default: Any, doc: str, unit: str = "", **limits: Any) -> Any:
    """A dataclass field with its ``Parameter``."""
    return dataclasses.field(default=default, metadata={"parameter": Parameter(doc, unit, **limits)})


def nearest(name: str, known: Mapping[str, Any] | list[str]) -> str:
    """A hint for a misspelt name: `` - did you mean 'x'?``, else the names there are."""
    match = get_close_matches(name, list(known), n=1)
    return f" - did you mean {match[0]!r}?" if match else f" - known: {', '.join(known) or 'none'}"


def read_value(name: str, given: Any, default: Any, parameter: Parameter) -> Any:
    """``given`` (text or number) as the type of ``default``, within ``parameter``'s limits, or ValueError."""
    value = _as_type_of(default, given, name)
    if parameter.choices and value not in parameter.choices:
        wanted = ", ".join(map(str, parameter.choices))
        raise ValueError(f"{name} must be one of {wanted} (got {given!r})")
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, float) and not math.isfinite(number):
            raise ValueError(f"{name} must be a finite number{_in(parameter)} (got {given!r})")
        if parameter.above is not None and not number > parameter.above:
            raise ValueError(f"{name} must be > {parameter.above:g}{_in(parameter)} (got {given!r})")
        if parameter.at_least is not None and not number >= parameter.at_least:
            raise ValueError(f"{name} must be >= {parameter.at_least:g}{_in(parameter)} (got {given!r})")
        if parameter.at_most is not None and not number <= parameter.at_most:
            raise ValueError(f"{name} must be <= {parameter.at_most:g}{_in(parameter)} (got {given!r})")
    return value


def _in(parameter: Parameter) -> str:
    return f" [{parameter.unit}]" if parameter.unit else ""


def _as_type_of(default: Any, given: Any, name: str) -> Any:
    if isinstance(default, bool):
        words = {
            "true": True,
            "on": True,
            "1": True,
            "yes": True,
            "false": False,
            "off": False,
            "0": False,
            "no": False,
        }
        if isinstance(given, bool):
            return given
        if str(given).lower() in words:
            return words[str(given).lower()]
        raise ValueError(f"{name} must be true or false (got {given!r})")
    try:
        if isinstance(default, int):
            return _integer(given)
        if isinstance(default, float):
            return float(given)
        if isinstance(default, tuple):
            parts = given.split(",") if isinstance(given, str) else list(given)
            if len(parts) != len(default):
                raise ValueError
            return tuple(float(part) for part in parts)
    except (TypeError, ValueError):
        wanted = {
            int: "an integer",
            float: "a number",
            tuple: f"{len(default) if isinstance(default, tuple) else 0} numbers",
        }
        raise ValueError(f"{name} must be {wanted[type(default)]} (got {given!r})") from None
    return str(given)


def _integer(given: Any) -> int:
    if isinstance(given, bool) or (isinstance(given, float) and not given.is_integer()):
        raise ValueError
    return int(given)
