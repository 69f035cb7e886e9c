"""Files: their text read, TOML and JSON parsed, and written whole or not at all. Every refusal is one line."""

import math
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from .places import NotOwn, Place, partial_name, read_whole

LARGEST = 2**28  # [bytes] of a text in a results folder: the claims of the paper with all their maps take 2**23


class FileError(ValueError):
    """A file that cannot be used; the message is one line with the place."""


def read_text(path: Path | Place, what: str) -> str:
    """The text of ``path`` without a mark of its order of bytes; ``what`` says in the message what it should hold.

    NotOwn for a place that is a link.
    """
    try:
        content = path.read(LARGEST) if isinstance(path, Place) else read_whole(path, LARGEST)
        return content.decode("utf-8-sig")
    except NotOwn:
        raise
    except (OSError, ValueError) as e:
        raise FileError(f"cannot read {what} {path}: {getattr(e, 'strerror', None) or e}") from None


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """The tables in ``text``; ``where`` names it in messages."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise FileError(f"{where}: nested too deeply") from None
    except ValueError as e:  # huge integers raise ValueError, not TOMLDecodeError
        raise FileError(f"{where}: {e}") from None


def parse_json(text: str | bytes, where: str) -> Any:
    """The JSON value in ``text``; NaN, Infinity and numbers beyond float64 are no JSON."""
    try:
        return msgspec.json.decode(text)
    except RecursionError:
        raise FileError(f"{where}: nested too deeply") from None
    except ValueError as e:
        raise FileError(f"{where}: not JSON: {e}") from None


def to_json(value: Any, *, indent: int = 0) -> str:
    """Strict JSON; a number that does not exist (NaN, infinite) is null."""
    text = msgspec.json.encode(value, enc_hook=lambda x: x.tolist())  # arrays and scalars of numpy
    return (msgspec.json.format(text, indent=indent) if indent else text).decode()


def exact(value: Any) -> Any:
    """A value for JSON that is read back as it was: NaN and infinities as text, which ``float`` takes."""
    return str(float(value)) if isinstance(value, float) and not math.isfinite(value) else value


def partial_of(path: Path, pid: int) -> Path:
    """The file that process ``pid`` writes before it becomes ``path``."""
    return path.with_name(partial_name(path.name, pid))


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A place to write what replaces ``path``, which the user named; nothing is left of it when the block fails."""
    partial = partial_of(path, os.getpid())
    try:
        yield partial
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path | Place, text: str) -> None:
    """Write whole or not at all."""
    if isinstance(path, Place):
        path.write(text)
        return
    with whole(path) as partial:
        partial.write_text(text, encoding="utf-8")
