"""The judgements of a results folder: ``<results>/judgement/*.json``, written for a diff, read with suspicion."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from ...files import FileError, parse_json, read_text, to_json
from ...places import Place
from ...shapes import convert_shape
from .claims import SCHEMA, Claim, Code, Published
from .runs import Drift, FalseSuccess, Order, Symmetry, Work

FOLDER = "judgement"
PUBLISHED = Place(Path(__file__).resolve().parents[3] / "results" / "published")
T = TypeVar("T")


@dataclass(frozen=True)
class File(Generic[T]):
    """One judgement file and its type."""

    name: str
    kind: type[T]
    schema: int = 0  # of a file that holds it beside digests of the code it comes from


CLAIMS = File("claims", tuple[Claim, ...], SCHEMA)
ORDERS = File("certificates", tuple[Order, ...])
DRIFTS = File("drift", tuple[Drift, ...])
SYMMETRIES = File("symmetries", tuple[Symmetry, ...])
WORK = File("work", Work)
WRONG = File("wrong", tuple[FalseSuccess, ...])


def read_judgement(file: File[T], folder: Place) -> T:
    """The judgement in ``folder``; FileError where it is not one, FileNotFoundError where there is none."""
    if not file.schema:
        return _read(folder, file.name, file.kind)  # type: ignore[no-any-return]
    return _restore_commands(_read(folder, file.name, Published))  # type: ignore[return-value]


def read_claims(folder: Place) -> tuple[Claim, ...] | None:
    """The claims judged in ``folder``; None where there are none."""
    try:
        return read_judgement(CLAIMS, folder)
    except FileNotFoundError:
        return None
    except FileError as error:
        raise FileError(f"{error}; --publish writes it anew") from None


def code_of_claims(folder: Place) -> Code:
    """Digests that the claims judged in ``folder`` come from; raises like ``read_judgement``."""
    return _read(folder, CLAIMS.name, Published).code  # type: ignore[no-any-return]


def _read(folder: Place, name: str, kind: Any) -> Any:
    path = folder / f"{name}.json"
    if not path.is_there():
        raise FileNotFoundError(path.path)
    where = f"{path.parent.name}/{path.name}"
    plain = parse_json(read_text(path, "the judgement"), where)
    schema = 1 if isinstance(plain, list) else plain.get("schema") if isinstance(plain, dict) else None
    if kind is Published and schema in range(1, SCHEMA):
        raise FileError(f"{where}: of an older version (schema {schema}, expected {SCHEMA})")
    return convert_shape(_restore_nan(plain, kind), kind, where)


def add_code(claims: Sequence[Claim], code: Code) -> Published:
    """The content of ``claims.json``; the command of a run, which is in rows of several claims, stands once."""
    commands = {m.settings_id: m.command for c in claims for m in c.map if m.command}
    replace = msgspec.structs.replace
    bare = (replace(c, map=tuple(replace(m, command="") for m in c.map)) for c in claims)
    return Published(SCHEMA, code, tuple(bare), dict(sorted(commands.items())))


def _restore_commands(found: Published) -> tuple[Claim, ...]:
    replace, commands = msgspec.structs.replace, found.commands
    rows = (tuple(replace(m, command=m.command or commands.get(m.settings_id, "")) for m in c.map)
            for c in found.claims)  # fmt: skip
    return tuple(replace(c, map=own) for c, own in zip(found.claims, rows, strict=True))


def shorten_claims(claims: Sequence[Claim]) -> tuple[Claim, ...]:
    """The claims as published: every row with its number, whether it holds, and its command, which has its settings."""
    return tuple(map(_shorten, claims))


def _shorten(c: Claim) -> Claim:
    replace = msgspec.structs.replace
    telling = {f.decision.telling for f in c.findings if f.decision}
    factors = {k: v for k, v in c.factors.items() if k in telling}
    rows = tuple(replace(m, at={}, case="") for m in c.map)
    return replace(c, settings_ids=(), against=(), factors=factors, map=rows)


def format_judgement(judged: Any) -> str:
    """Strict JSON of which a diff can be read: a line a row of every list of tables; NaN and infinity are null."""
    plain = json.loads(to_json(judged))
    if isinstance(judged, Published):
        return "{\n" + ",\n".join(f"{json.dumps(k)}: {_format(v, 0)}" for k, v in plain.items()) + "\n}\n"
    return _format(plain, 0) + "\n"


def _format(plain: Any, depth: int) -> str:
    pad = " " * (depth + 1)
    if isinstance(plain, dict) and plain and depth < 2:
        rows = [f"{json.dumps(k, ensure_ascii=False)}: {_format(v, depth + 1)}" for k, v in plain.items()]
        return "{\n" + ",\n".join(pad + r for r in rows) + "\n" + pad[:-1] + "}"
    if isinstance(plain, list) and any(isinstance(v, dict | list) for v in plain):
        return "[\n" + ",\n".join(pad + _format(v, depth + 1) for v in plain) + "\n" + pad[:-1] + "]"
    return json.dumps(plain, ensure_ascii=False)


def _restore_nan(plain: Any, kind: Any) -> Any:
    """``plain`` with NaN for null where ``kind`` is a number."""
    if plain is None:
        return math.nan if kind is float else None
    inner = get_args(kind)
    if isinstance(plain, list) and inner:
        return [_restore_nan(v, inner[0]) for v in plain]
    if isinstance(plain, dict):
        fields = dict.fromkeys(plain, inner[1]) if get_origin(kind) is dict else _field_types(kind)
        return {k: _restore_nan(v, fields.get(k)) for k, v in plain.items()}
    return plain


@cache
def _field_types(kind: Any) -> dict[str, Any]:
    for k in (kind, *get_args(kind)):
        if isinstance(k, type) and (issubclass(k, msgspec.Struct) or is_dataclass(k)):
            return get_type_hints(k)
    return {}
