"""Format values, and suggestions for misspelt names, as messages show them."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any


def suggest_name(name: str, known: Mapping[str, Any] | list[str]) -> str:
    """Return a hint for a misspelt name, `` - did you mean 'x'?``, or the known names if none is similar."""
    match = get_close_matches(name, list(known), n=1)
    return f" - did you mean {match[0]!r}?" if match else f" - known: {', '.join(known) or 'none'}"


def format_value(value: Any) -> str:
    """Return ``value`` as text for a message, at most 40 characters, even for an integer that Python does not print."""
    try:
        return (str(value) if isinstance(value, int | float) else repr(value))[:40]
    except ValueError:
        return "a number of thousands of digits"
