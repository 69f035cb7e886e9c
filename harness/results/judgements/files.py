"""Read and write the judgements of a results folder, ``<results>/judgement/*.json``; their contents are validated."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from ...base.confined_paths import ConfinedPath
from ...base.files import FileError, parse_json, read_text, to_json
from ...base.shapes import convert_shape
from .claims import SCHEMA, CodeDigests, JudgedClaim, PublishedClaims
from .runs import Drift, FalseSuccess, Order, Symmetry, Work

FOLDER = "judgement"
PUBLISHED = ConfinedPath(Path(__file__).resolve().parents[3] / "results" / "published")
T = TypeVar("T")


@dataclass(frozen=True)
class File(Generic[T]):
    """The name of a judgement file and the type of its content."""

    name: str
    kind: type[T]
    schema: int = 0  # schema of a file that also holds the digests of its code


CLAIMS = File("claims", tuple[JudgedClaim, ...], SCHEMA)
FIELD_CLAIMS = File("field", tuple[JudgedClaim, ...], SCHEMA)
ORDERS = File("certificates", tuple[Order, ...])
DRIFTS = File("drift", tuple[Drift, ...])
SYMMETRIES = File("symmetries", tuple[Symmetry, ...])
WORK = File("work", Work)
WRONG = File("wrong", tuple[FalseSuccess, ...])


def read_judgement(file: File[T], folder: ConfinedPath) -> T:
    """Read the judgement in ``folder``; raise FileError if it is invalid, FileNotFoundError if there is none."""
    if not file.schema:
        return _read(folder, file.name, file.kind)  # type: ignore[no-any-return]
    return _restore_commands(_read(folder, file.name, PublishedClaims))  # type: ignore[return-value]


def read_claims(folder: ConfinedPath, file: File[tuple[JudgedClaim, ...]] = CLAIMS) -> tuple[JudgedClaim, ...] | None:
    """Read the claims judged in ``folder``; return None if there are none; raise FileError if they are invalid."""
    try:
        return read_judgement(file, folder)
    except FileNotFoundError:
        return None
    except FileError as error:
        raise FileError(f"{error}; --publish writes it anew") from None


def read_claims_code(folder: ConfinedPath, file: File[tuple[JudgedClaim, ...]] = CLAIMS) -> CodeDigests:
    """Return the digests of the code that judged the claims in ``folder``; raise as ``read_judgement`` does."""
    return _read(folder, file.name, PublishedClaims).code  # type: ignore[no-any-return]


def _read(folder: ConfinedPath, name: str, kind: Any) -> Any:
    """Return the content of ``<name>.json`` in ``folder`` as the type ``kind``, with null numbers as NaN.

    Raise FileNotFoundError if there is no such file, FileError if it is invalid or of an older version.
    """
    path = folder / f"{name}.json"
    if not path.is_there():
        raise FileNotFoundError(path.path)
    return _parse(read_text(path, "the judgement"), f"{path.parent.name}/{path.name}", kind)


@lru_cache(maxsize=2)  # of the published claims, a command asks for verdicts and for digests
def _parse(text: str, where: str, kind: Any) -> Any:
    """Return the JSON ``text`` of a file as the type ``kind``; raise FileError as ``_read`` does, naming ``where``.

    The latest results are cached.
    """
    plain = parse_json(text, where)
    schema = 1 if isinstance(plain, list) else plain.get("schema") if isinstance(plain, dict) else None
    if kind is PublishedClaims and schema in range(1, SCHEMA):
        raise FileError(f"{where}: of an older version (schema {schema}, expected {SCHEMA})")
    return convert_shape(_restore_nan(plain, kind), kind, where)


def add_code(claims: Sequence[JudgedClaim], code: CodeDigests) -> PublishedClaims:
    """Return the content of a file of claims: the claims, the digests of their code, and the commands that repeat runs.

    The commands are moved from the rows of the claims into one table by ``settings_id``, since claims share runs.
    """
    commands = {m.settings_id: m.command for c in claims for m in c.map if m.command}
    replace = msgspec.structs.replace
    bare = (replace(c, map=tuple(replace(m, command="") for m in c.map)) for c in claims)
    return PublishedClaims(SCHEMA, code, tuple(bare), dict(sorted(commands.items())))


def _restore_commands(found: PublishedClaims) -> tuple[JudgedClaim, ...]:
    """Return the claims of a file, whose rows get back the commands that ``add_code`` has moved into one table."""
    replace, commands = msgspec.structs.replace, found.commands
    rows = (
        tuple(replace(m, command=m.command or commands.get(m.settings_id, "")) for m in c.map) for c in found.claims
    )
    return tuple(replace(c, map=own) for c, own in zip(found.claims, rows, strict=True))


def shorten_claims(claims: Sequence[JudgedClaim]) -> tuple[JudgedClaim, ...]:
    """Return the claims as they are published, without what the pages do not need.

    Every row keeps its number, whether the claim holds, and its command; lists of runs and of counts are left out.
    """
    return tuple(map(_shorten, claims))


def _shorten(c: JudgedClaim) -> JudgedClaim:
    """Return a claim in its published form: without lists of runs.

    Counts stay for the dimension alone that separates best. Rows keep neither their case nor the values of dimensions.
    """
    replace = msgspec.structs.replace
    telling = {f.decision.telling for f in c.findings if f.decision}
    factors = {k: v for k, v in c.factors.items() if k in telling}
    rows = tuple(replace(m, at={}, case="") for m in c.map)
    return replace(c, settings_ids=(), against=(), factors=factors, map=rows)


def format_judgement(judged: Any) -> str:
    """Format a judgement as strict JSON that suits a diff: a line per row of each list; NaN and infinity become null.

    A file of claims has a line per key of its top level.
    """
    plain = json.loads(to_json(judged))
    if isinstance(judged, PublishedClaims):
        return "{\n" + ",\n".join(f"{json.dumps(k)}: {_format(v, 0)}" for k, v in plain.items()) + "\n}\n"
    return _format(plain, 0) + "\n"


def _format(plain: Any, depth: int) -> str:
    """Return plain data as JSON text, with a line per row of a list of objects, and per key of the first two levels.

    ``depth`` is the level of ``plain`` itself, 0 for the whole.
    """
    pad = " " * (depth + 1)
    if isinstance(plain, dict) and plain and depth < 2:
        rows = [f"{json.dumps(k, ensure_ascii=False)}: {_format(v, depth + 1)}" for k, v in plain.items()]
        return "{\n" + ",\n".join(pad + r for r in rows) + "\n" + pad[:-1] + "}"
    if isinstance(plain, list) and any(isinstance(v, dict | list) for v in plain):
        return "[\n" + ",\n".join(pad + _format(v, depth + 1) for v in plain) + "\n" + pad[:-1] + "]"
    return json.dumps(plain, ensure_ascii=False)


def _restore_nan(plain: Any, kind: Any) -> Any:
    """Return plain JSON data with null replaced by NaN wherever the type ``kind`` has a float."""
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
    """Return the types of the fields of a struct or dataclass, also inside ``X | None``; empty for other types."""
    for k in (kind, *get_args(kind)):
        if isinstance(k, type) and (issubclass(k, msgspec.Struct) or is_dataclass(k)):
            return get_type_hints(k)
    return {}
