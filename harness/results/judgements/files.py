"""The judgements of a results folder: ``<results>/judgement/*.json``, written for a diff, read with suspicion."""

import json
import math
from dataclasses import dataclass, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from ...files import parse_json, read_text, to_json
from ...places import Place
from ...shapes import shaped
from .claims import Claim
from .runs import Drift, FalseSuccess, Order, Symmetry, Work

FOLDER = "judgement"
PUBLISHED = Place(Path(__file__).resolve().parents[3] / "results" / "published")
T = TypeVar("T")


class JudgementError(ValueError):
    """A file that is missing or has another shape; the message is one line."""


@dataclass(frozen=True)
class File(Generic[T]):
    """One judgement file and its type."""

    name: str
    kind: type[T]


CLAIMS = File("claims", tuple[Claim, ...])
ORDERS = File("certificates", tuple[Order, ...])
DRIFTS = File("drift", tuple[Drift, ...])
SYMMETRIES = File("symmetries", tuple[Symmetry, ...])
WORK = File("work", Work)
WRONG = File("wrong", tuple[FalseSuccess, ...])


def read(file: File[T], folder: Place) -> T:
    """The judgement in ``folder``; JudgementError where it is not one, FileNotFoundError where there is none."""
    path = folder / f"{file.name}.json"
    if not path.is_there():
        raise FileNotFoundError(path.path)
    where = f"{path.parent.name}/{path.name}"
    plain = parse_json(read_text(path, "the judgement", JudgementError), where, JudgementError)
    return shaped(_numbers(plain, file.kind), file.kind, where, JudgementError)


def as_text(judged: Any) -> str:
    """Strict JSON of which a diff can be read: a line a row of every list of tables; NaN and infinity are null."""
    return _text(json.loads(to_json(judged)), 0) + "\n"


def _text(plain: Any, depth: int) -> str:
    pad = " " * (depth + 1)
    if isinstance(plain, dict) and plain and depth < 2:
        rows = [f"{json.dumps(k, ensure_ascii=False)}: {_text(v, depth + 1)}" for k, v in plain.items()]
        return "{\n" + ",\n".join(pad + r for r in rows) + "\n" + pad[:-1] + "}"
    if isinstance(plain, list) and any(isinstance(v, dict | list) for v in plain):
        return "[\n" + ",\n".join(pad + _text(v, depth + 1) for v in plain) + "\n" + pad[:-1] + "]"
    return json.dumps(plain, ensure_ascii=False)


def _numbers(plain: Any, kind: Any) -> Any:
    """``plain`` with NaN for null where ``kind`` is a number."""
    if plain is None:
        return math.nan if kind is float else None
    inner = get_args(kind)
    if isinstance(plain, list) and inner:
        return [_numbers(v, inner[0]) for v in plain]
    if isinstance(plain, dict):
        fields = dict.fromkeys(plain, inner[1]) if get_origin(kind) is dict else _fields(kind)
        return {k: _numbers(v, fields.get(k)) for k, v in plain.items()}
    return plain


@cache
def _fields(kind: Any) -> dict[str, Any]:
    for k in (kind, *get_args(kind)):
        if isinstance(k, type) and (issubclass(k, msgspec.Struct) or is_dataclass(k)):
            return get_type_hints(k)
    return {}
