"""Convert parsed files to frozen structs, or refuse them in one line that names the faulty entry.

::

    class Limits(Shape, frozen=True):
        cpu_limit: Positive = 60.0

    convert_shape(parse_toml(text, "ci.toml"), Limits, "ci.toml")
    # FileError: ci.toml: unknown key 'wal_limit' - did you mean 'cpu_limit'?

The annotations are the rules: strict types, no key but the fields. Why msgspec: ``docs/decisions/schema.md``.
"""

import re
from enum import Enum
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from .files import FileError
from .hints import format_value, suggest_name

T = TypeVar("T")
LARGEST = 1.7976931348623157e308
Text = Annotated[str, Meta(pattern=r"\S", description="text, not blank")]
Finite = Annotated[float, Meta(ge=-LARGEST, le=LARGEST, description="a finite number")]
Positive = Annotated[float, Meta(gt=0.0, le=LARGEST, description="a finite number > 0")]
WORDS = {
    "str": "text",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing",
}


class Shape(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of a file: typed, read-only, with no key but the fields."""


def convert_shape(plain: Any, kind: type[T], where: str) -> T:
    """Convert ``plain`` (tables, lists, numbers, text) to ``kind``; raise FileError, naming ``where`` and the entry."""
    try:
        return msgspec.convert(plain, kind)
    except msgspec.ValidationError as e:
        said = _find_fault(plain, kind, str(e))
    except RecursionError:
        said = ["nested too deeply"]
    raise FileError(": ".join([where, *said])) from None


def _find_fault(plain: Any, kind: Any, said: str) -> list[str]:
    """Return the path to the faulty entry of ``plain``, name by name, and last what is wrong with it.

    For example ``["runs 2", "label must be ..."]`` where msgspec's message ``said`` ends in ``at `$.runs[1].label```;
    ``kind`` is the type that was expected.
    """
    words, _, path = said.partition(" - at `$")
    at: list[str] = []
    for field, index in re.findall(r"\.(\w+)|\[([\d.]+)\]", path):
        if index == "...":  # the library does not name the entry of a table: take the first that does not fit
            kind = _find_part_type(kind, {})
            key, value, inside = next((k, v, e) for k, v in plain.items() if (e := _describe_misfit(v, kind)))
            return [*at, key, *_find_fault(value, kind, inside)]
        kind, plain = _find_part_type(kind, field or 0), plain[field or int(index)]
        if field:
            at.append(field)
        else:
            at[-1:] = [f"{at[-1] if at else 'entry'} {int(index) + 1}"]
    if words.startswith("Object"):
        key = words.split("`")[1]
        known = sorted({k for option in _list_options(kind) for k in _list_fields(option)})
        return [*at, f"unknown key {key!r}{suggest_name(key, known)}" if "unknown" in words else f"{key} is missing"]
    if words.startswith("Invalid enum"):
        return [*at[:-1], f"unknown {at[-1]} {plain!r}{suggest_name(str(plain), _list_choices(kind))}"]
    if not words.startswith("Expected") and "out of range" not in words:  # a rule between fields, of __post_init__
        return [*at, words]
    return [*at[:-1], " ".join([*at[-1:], _describe_type(words, plain, kind)])]


def _describe_misfit(plain: Any, kind: Any) -> str:
    """Return msgspec's message on why ``plain`` does not fit the type ``kind``; empty if it fits."""
    try:
        msgspec.convert(plain, kind)
    except msgspec.ValidationError as e:
        return str(e)
    return ""


def _describe_type(words: str, plain: Any, kind: Any) -> str:
    """Return what was expected and got, as in ``must be a number > 0 (got -1)``, from msgspec's message ``words``."""
    got = format_value(plain)
    described = [m.description for o in (kind, *_list_options(kind)) for m in get_args(o)[1:] if isinstance(m, Meta)]
    if any(described):
        return f"must be {described[0]} (got {got})"
    if "out of range" in words:
        return f"is too large (got {got})"
    wanted = re.sub(r", got `\w+`", "", words.removeprefix("Expected "))
    wanted = re.sub(r"`([^`]*)`", lambda m: " or ".join(WORDS.get(w, w) for w in m[1].split(" | ")), wanted)
    wanted = re.sub(r" \d[\d.e+]*$", lambda m: f" {float(m[0]):g}", wanted)
    return f"must be {wanted} (got {got})"


def _list_options(kind: Any) -> tuple[Any, ...]:
    """Return the types of a union; any other type is its only option."""
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _list_fields(kind: Any) -> dict[str, Any]:
    """Return the types of a struct's or dataclass's fields, by their names in files; empty for any other type."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return {f.encode_name: f.type for f in msgspec.structs.fields(kind)}
    return get_type_hints(kind, include_extras=True) if hasattr(kind, "__dataclass_fields__") else {}


def _find_part_type(kind: Any, step: Any) -> Any:
    """Return the type of a field (``step`` is its name), of a list's entries (``step`` 0) or of a table's values ({}).

    ``Any`` where ``kind`` has no such part.
    """
    for option in _list_options(kind):
        if isinstance(step, str) and step in _list_fields(option):
            return _list_fields(option)[step]
        inside = get_args(get_args(option)[0] if get_origin(option) is Annotated else option)
        if not isinstance(step, str) and inside:
            return inside[-1 if step == {} else 0]
    return Any


def _list_choices(kind: Any) -> list[str]:
    """Return the values that an enumeration or a ``Literal`` allows, as text."""
    enums = [o for o in _list_options(kind) if isinstance(o, type) and issubclass(o, Enum)]
    literals = [c for o in _list_options(kind) if get_origin(o) is Literal for c in get_args(o)]
    return [str(c) for c in (*literals, *(member.value for e in enums for member in e))]
