"""Format options and parameters as they are typed on the command line, for cases, commands and pages."""

from collections.abc import Mapping
from typing import Any


def format_name(name: str, given: Mapping[str, Any]) -> str:
    """Format ``name[key=value,...]`` with the values ``given``; the name alone if there are none."""
    inside = ",".join(f"{k}={format_exactly(v)}" for k, v in sorted(given.items()))
    return f"{name}[{inside}]" if inside else name


def format_exactly(value: Any) -> str:
    """Format a value as text from which the same value is read back."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "(" + ",".join(map(format_exactly, value)) + ")"
    if isinstance(value, float):
        return f"{value:.12g}" if float(f"{value:.12g}") == value else repr(float(value))
    return str(value)
