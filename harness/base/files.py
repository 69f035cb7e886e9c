"""Read text files, parse TOML and JSON, and write files atomically; every error is one line."""

import math
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from .confined_paths import ConfinedPath, UnsafeFile, format_partial_name, read_whole

LARGEST = 2**28  # [bytes] of a text in a results folder: the paper's claims with all maps take 2**23


class FileError(ValueError):
    """A file that cannot be used; the message is one line that names it."""


def read_text(path: Path | ConfinedPath, what: str) -> str:
    """Read the text of ``path`` without a byte-order mark; ``what`` names its expected content in messages.

    Raise FileError if it cannot be read, UnsafeFile for a link, a device or the like in a results folder.
    """
    try:
        content = path.read(LARGEST) if isinstance(path, ConfinedPath) else read_whole(path, LARGEST)
        return content.decode("utf-8-sig")
    except UnsafeFile:
        raise
    except (OSError, ValueError) as e:
        raise FileError(f"cannot read {what} {path}: {getattr(e, 'strerror', None) or e}") from None


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Parse TOML; ``where`` names the file in the message of a FileError."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise FileError(f"{where}: nested too deeply") from None
    except ValueError as e:  # huge integers raise ValueError, not TOMLDecodeError
        raise FileError(f"{where}: {e}") from None


def parse_json(text: str | bytes, where: str) -> Any:
    """Parse JSON; raise FileError, which names ``where``, also for NaN, Infinity and numbers beyond float64."""
    try:
        return msgspec.json.decode(text)
    except RecursionError:
        raise FileError(f"{where}: nested too deeply") from None
    except ValueError as e:
        raise FileError(f"{where}: not JSON: {e}") from None


def to_json(value: Any, *, indent: int = 0) -> str:
    """Format a value, arrays of NumPy included, as strict JSON: NaN and infinities become null.

    It is one line, or indented by ``indent`` spaces a level.
    """
    text = msgspec.json.encode(value, enc_hook=lambda x: x.tolist())  # arrays and scalars of numpy
    return (msgspec.json.format(text, indent=indent) if indent else text).decode()


def encode_nonfinite(value: Any) -> Any:
    """Return a value that JSON keeps exactly: NaN and infinities as text that ``float`` reads, all else unchanged."""
    return str(float(value)) if isinstance(value, float) and not math.isfinite(value) else value


def name_partial(path: Path, pid: int) -> Path:
    """Return the file that process ``pid`` writes before it becomes ``path``."""
    return path.with_name(format_partial_name(path.name, pid))


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Provide a path for the block to write a file to: it then replaces ``path``, or is removed if the block fails."""
    partial = name_partial(path, os.getpid())
    try:
        yield partial
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path | ConfinedPath, text: str) -> None:
    """Write ``text`` to ``path`` in UTF-8, atomically: a reader finds the old file or the whole new one."""
    if isinstance(path, ConfinedPath):
        path.write(text)
        return
    with write_atomically(path) as partial:
        partial.write_text(text, encoding="utf-8")
