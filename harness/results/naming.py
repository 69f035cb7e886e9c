"""Options and parameters as one types them on the command line: in cases, in commands, on pages."""

from collections.abc import Mapping
from typing import Any


def format_name(name: str, given: Mapping[str, Any]) -> str:
    """``name[key=value,...]``; the name alone where all are defaults."""
    inside = ",".join(f"{k}={text_of(v)}" for k, v in sorted(given.items()))
    return f"{name}[{inside}]" if inside else name


def text_of(value: Any) -> str:
    """The text that is read back as the same value, to the last bit."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "(" + ",".join(map(text_of, value)) + ")"
    if isinstance(value, float):
        return f"{value:.12g}" if float(f"{value:.12g}") == value else repr(value)
    return str(value)
