"""Judgement files of a run as pages see them: rows whose texts are texts and whose numbers are numbers or NaN."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

JUDGE = "mbsbench judge"
FOLDER = "judgement"
PUBLISHED = Path(__file__).resolve().parents[2] / "results" / "published"


@dataclass(frozen=True)
class Entry:
    """One row; what is missing or of another kind than asked for is nothing, never an error."""

    given: Mapping[str, Any]

    def text(self, key: str) -> str:
        """As text; empty for nothing."""
        value = self.given.get(key)
        return "" if value is None else value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)

    def number(self, key: str) -> float:
        return number_in(self.given.get(key))

    def flag(self, key: str) -> bool | None:
        value = self.given.get(key)
        return value if isinstance(value, bool) else None

    def numbers(self, key: str) -> tuple[float, ...]:
        return tuple(number_in(v) for v in self._list(key))

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts; a lone text is a list of one."""
        value = self.given.get(key)
        if isinstance(value, str):
            return (value,) if value else ()
        return tuple(v if isinstance(v, str) else json.dumps(v, ensure_ascii=False) for v in self._list(key))

    def entries(self, key: str) -> tuple["Entry", ...]:
        return tuple(Entry(v) for v in self._list(key) if isinstance(v, dict))

    def _list(self, key: str) -> list[Any]:
        value = self.given.get(key)
        return value if isinstance(value, list) else []


@dataclass(frozen=True)
class Judged:
    """The rows of one file, or why there are none."""

    rows: tuple[Entry, ...] = ()
    why: str = ""


def judged(folder: Path, name: str, part: str = "") -> Judged:
    """The rows of ``judgement/<name>.json``, or of its list ``part``."""
    path = folder / FOLDER / f"{name}.json"
    return rows_of(path, part, f"{JUDGE} {folder.name}")


def rows_of(path: Path, part: str = "", command: str = JUDGE) -> Judged:
    """The rows in a file, or what is the matter with it and the command that makes it."""
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return Judged(why=f"There is no {path.parent.name}/{path.name} yet. This makes it: {command}")
    except (OSError, ValueError) as error:
        return Judged(why=f"{path.parent.name}/{path.name} cannot be read ({error}). This makes it anew: {command}")
    if part and isinstance(plain, dict):
        plain = plain.get(part)
    if not isinstance(plain, list):
        return Judged(why=f"{path.parent.name}/{path.name} does not hold the list expected. Make it anew: {command}")
    return Judged(tuple(Entry(row) for row in plain if isinstance(row, dict)))


def number_in(value: Any) -> float:
    """A JSON number, also one written as a text (``"inf"``); NaN for anything else."""
    if isinstance(value, bool) or value is None:
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan
