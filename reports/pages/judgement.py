"""Judgements of results as pages see them: what was read, or why nothing was and the command that makes it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from ...harness.results.judgements import FOLDER, File, JudgementError, read

JUDGE = "mbsbench judge"
T = TypeVar("T")


@dataclass(frozen=True)
class Judged(Generic[T]):
    """The content of one file, or why there is none."""

    found: T | None = None
    why: str = ""


def judged(results: Path, file: File[T]) -> Judged[T]:
    """``judgement/<name>.json`` of a results folder."""
    return read_or_why(results / FOLDER, file, f"{JUDGE} {results.name}")


def read_or_why(folder: Path, file: File[T], command: str) -> Judged[T]:
    """The judgement in ``folder``; ``command`` makes it."""
    try:
        return Judged(read(file, folder))
    except FileNotFoundError:
        return Judged(why=f"There is no {folder.name}/{file.name}.json yet. To make it: {command}")
    except JudgementError as error:
        return Judged(why=f"{error}. To make it anew: {command}")
